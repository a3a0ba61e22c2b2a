"""The user's own terms: plain torch functions, for either engine."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.engines.base import ArrayTerm, Complexes, Floats
from eigenode_cli.field import VectorField, load_flat
from eigenode_cli.terms.arguments import arguments_of


@dataclass(frozen=True)
class UserTerm:
    """A function that returns a scalar, called with what the names of its arguments ask for.

    `trajectory` (N, n) at the data times; `spectra` (T, n) complex in 1/s; `times` (N,) of the data in s; `data`
    (N, n), the observed states, NaN where nothing is observed; `field`, the vector field: states (..., n) to
    derivatives (..., n), differentiable in both and in its parameters.

    Attributes:
        function: the user's.
        takes: names of its arguments, some of `ARGUMENTS`.
    """

    function: Callable[..., Tensor]
    takes: tuple[str, ...]

    @property
    def needs_solve(self) -> bool:
        """Whether it looks at the solution, so that it is undefined where a solve fails."""
        return "trajectory" in self.takes or "spectra" in self.takes

    def __call__(self, **known: Any) -> Tensor:
        """Its value, from all the `ARGUMENTS` of which it takes its own."""
        return self.function(**{name: known[name] for name in self.takes})


def user_term(function: Callable[..., Tensor]) -> UserTerm:
    """A user's function as a term.

    Raises:
        ValueError: it asks for something that there is not.
    """
    return UserTerm(function, arguments_of(function))


def load_user_terms(paths: dict[str, str]) -> dict[str, UserTerm]:
    """The user's own terms, imported from their `module:function`, in the order of their names.

    Raises:
        ValueError: a path that does not lead to a function, or a function that asks for something that there is not.
    """
    terms: dict[str, UserTerm] = {}
    for name, path in sorted(paths.items()):
        module, _, function = path.partition(":")
        try:
            candidate = getattr(importlib.import_module(module), function)
            if not callable(candidate):
                raise ValueError("not a function")
            terms[name] = user_term(cast(Callable[..., Tensor], candidate))
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"terms.{name}={path}: {error}") from error
    return terms


def on_arrays(term: UserTerm, times: Floats, data: Floats, field: VectorField) -> ArrayTerm:
    """A user's term from arrays to arrays, differentiated by autograd.

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
        in_states, in_eigenvalues, *rows = torch.autograd.grad(value, inputs, materialize_grads=True)
        direct = torch.cat([row.reshape(-1) for row in rows]).numpy() if rows else 0.0
        return float(value.detach()), in_states.numpy(), in_eigenvalues.resolve_conj().numpy(), direct

    return ArrayTerm(value_and_slopes, term.needs_solve)
