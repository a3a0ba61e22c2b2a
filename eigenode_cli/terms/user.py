"""The user's own terms: plain torch functions, for either engine."""

import importlib
from collections.abc import Callable
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

UserTerm = Callable[[Tensor, Tensor, Tensor], Tensor]
"""`(trajectory (N, n), spectra (T, n) complex, data times (N,)) -> scalar`."""

ArrayTerm = Callable[[Floats, Complexes], tuple[float, Floats, Complexes]]
"""The same with its derivatives: `(trajectory, spectra) -> (value, dl/dx (N, n), dl/dRe + i dl/dIm (T, n))`."""


def load_user_terms(paths: dict[str, str]) -> dict[str, UserTerm]:
    """The user's own terms, imported from their `module:function`.

    Raises:
        ValueError: a path that does not lead to a function.
    """
    terms: dict[str, UserTerm] = {}
    for name, path in paths.items():
        module, _, function = path.partition(":")
        try:
            candidate = cast(UserTerm, getattr(importlib.import_module(module), function))
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"terms.{name}={path}: {error}") from error
        if not callable(candidate):
            raise ValueError(f"terms.{name}={path}: not a function")
        terms[name] = candidate
    return terms


def on_arrays(term: UserTerm, times: Tensor) -> ArrayTerm:
    """A user's term with its derivatives in trajectory and spectra, from arrays to arrays, by autograd."""

    def value_and_slopes(trajectory: Floats, spectra: Complexes) -> tuple[float, Floats, Complexes]:
        states = torch.from_numpy(trajectory).requires_grad_()
        eigenvalues = torch.from_numpy(spectra).requires_grad_()
        value = term(states, eigenvalues, times)
        slopes = torch.autograd.grad(value, (states, eigenvalues), materialize_grads=True)
        return float(value.detach()), slopes[0].numpy(), slopes[1].resolve_conj().numpy()

    return value_and_slopes
