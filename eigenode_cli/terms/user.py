"""The user's own terms: plain torch functions, for either engine."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.model import VectorField, load_flat
from eigenode_cli.terms.arguments import arguments_of
from eigenode_cli.terms.array_term import ArrayTerm


class TermFailed(Exception):
    """A term of the user's own raised, or returned what is no value; one line that begins with `terms.NAME=...`."""


@dataclass(frozen=True)
class UserTerm:
    """A function that returns a scalar, called with what the names of its arguments ask for.

    `trajectory` (N, n) at the data times; `spectra` (T, n) complex in 1/s; `times` (N,) of the data in s; `data`
    (N, n), the observed states, NaN where nothing is observed; `field`, the vector field: states (..., n) to
    derivatives (..., n), differentiable in both and in its parameters.

    Attributes:
        function: the user's.
        takes: names of its arguments, some of `ARGUMENTS`.
        label: the setting that it comes from, for messages.
    """

    function: Callable[..., Tensor]
    takes: tuple[str, ...]
    label: str = "a term of your own"

    @property
    def needs_solve(self) -> bool:
        """Whether it looks at the solution, so that it is undefined where a solve fails."""
        return "trajectory" in self.takes or "spectra" in self.takes

    def __call__(self, **known: Any) -> Tensor:
        """Its value, from all the `ARGUMENTS` of which it takes its own.

        Raises:
            TermFailed: the function raised, or its value is none.
        """
        try:
            value = self.function(**{name: known[name] for name in self.takes})
        except Exception as error:  # the user's code may raise anything
            raise TermFailed(f"{self.label}: {described(error)}") from error
        fault = value_fault(value)
        if fault is not None:
            raise TermFailed(f"{self.label}: {fault}")
        return value

    def gradient(self, value: Tensor, inputs: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """Its derivatives in the inputs, zero where one does not enter; the graph can be used again.

        Raises:
            TermFailed: autograd cannot differentiate it.
        """
        try:
            return torch.autograd.grad(value, inputs, retain_graph=True, materialize_grads=True)
        except Exception as error:
            raise TermFailed(f"{self.label}: no gradient, {described(error)}") from error


def described(error: Exception) -> str:
    """Return an exception of the user's code in one line."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def value_fault(value: Any) -> str | None:
    """Return what keeps `value` from being that of a term, or None."""
    if not isinstance(value, Tensor):
        return f"returns {'None' if value is None else f'a {type(value).__name__}'}; it must return a torch tensor"
    if value.shape != ():
        return f"returns a tensor of shape {tuple(value.shape)}; it must return a scalar, for example with .mean()"
    if not value.is_floating_point():
        return f"returns {str(value.dtype).removeprefix('torch.')}; it must return a real floating-point number"
    return None


def user_term(function: Callable[..., Tensor], label: str = UserTerm.label) -> UserTerm:
    """Return a user's function as a term.

    Raises:
        ValueError: it asks for something that there is not.
    """
    return UserTerm(function, arguments_of(function), label)


def recorded_only(term: UserTerm, announce: Callable[[str], None]) -> UserTerm:
    """Return a term that trains nothing: NaN where it fails, which is announced once, and without derivatives."""
    silent = False

    def value_or_nan(**known: Any) -> Tensor:
        nonlocal silent
        try:
            return term(**known).detach()
        except TermFailed as failed:
            if not silent:
                announce(f"{failed} (only recorded, so the run goes on; its column is empty)")
            silent = True
            return torch.tensor(torch.nan, dtype=torch.float64)

    return replace(term, function=value_or_nan)


def load_user_terms(
    paths: Mapping[str, str], trained: Sequence[str], announce: Callable[[str], None]
) -> dict[str, UserTerm]:
    """Return the user's own terms, imported from their `module:function`, in the order of their names.

    Args:
        paths: by name.
        trained: names of the terms that train; the others are only recorded.
        announce: told of the first failure of a term that is only recorded.

    Raises:
        ValueError: a path that does not lead to a function, or a function that asks for something that there is not.
    """
    terms: dict[str, UserTerm] = {}
    for name, path in sorted(paths.items()):
        module, _, function = path.partition(":")
        label = f"terms.{name}={path}"
        try:
            candidate = getattr(importlib.import_module(module), function)
            if not callable(candidate):
                raise ValueError("not a function")
            term = user_term(cast(Callable[..., Tensor], candidate), label)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"{label}: {error}") from error
        terms[name] = term if name in trained else recorded_only(term, announce)
    return terms


def on_arrays(term: UserTerm, times: Floats, data: Floats, field: VectorField) -> ArrayTerm:
    """Return a user's term from arrays to arrays, differentiated by autograd.

    Args:
        term: the term.
        times: of the data in s `(N,)`.
        data: observed states `(N, n)`, NaN where nothing is observed.
        field: the vector field, whose parameters are overwritten at each call of a term that takes it.
    """
    known = {"times": torch.from_numpy(times), "data": torch.from_numpy(data), "field": field}
    parameters = tuple(field.parameters()) if "field" in term.takes else ()

    def value_and_slopes(
        theta: Floats, trajectory: Floats, spectra: Complexes
    ) -> tuple[float, Floats, Complexes, Floats | float]:
        if parameters:
            load_flat(field, theta)
        states = torch.from_numpy(trajectory).requires_grad_()
        eigenvalues = torch.from_numpy(spectra).requires_grad_()
        value = term(trajectory=states, spectra=eigenvalues, **known)
        if not value.requires_grad:  # a constant, if only in the branch that it took
            return float(value), np.zeros_like(trajectory), np.zeros_like(spectra), 0.0
        inputs = (states, eigenvalues, *parameters)
        in_states, in_eigenvalues, *rows = term.gradient(value, inputs)
        direct = torch.cat([row.reshape(-1) for row in rows]).numpy() if rows else 0.0
        return float(value.detach()), in_states.numpy(), in_eigenvalues.resolve_conj().numpy(), direct

    return ArrayTerm(value_and_slopes, term.needs_solve)
