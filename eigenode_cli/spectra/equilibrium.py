"""The equilibrium of a vector field, its derivative in the field's parameters, and the spectrum there."""

from collections.abc import Callable

import numpy as np
import torch
from scipy.optimize import root
from torch import Tensor

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.jacobian import jacobian

SMALL = 1e-9
"""Largest rate at an equilibrium, relative to the largest one along the states that it was looked for from."""


def zero_of(rate: Callable[[Floats], Floats], slope: Callable[[Floats], Floats], states: Floats) -> Floats | None:
    """Return a state `(n,)` at which `rate` is zero, near the mean of `states (N, n)`; None where none is found.

    By Powell's hybrid method (`scipy.optimize.root`).

    Args:
        rate: derivatives `(..., n)` of states `(..., n)`.
        slope: the Jacobian `(n, n)` at one state.
        states: where the system has been; rows that are not finite are left out.
    """
    known = states[np.isfinite(states).all(axis=1)]
    if not known.size:
        return None
    with np.errstate(all="ignore"):
        found = root(rate, known.mean(axis=0), jac=slope)
    size = float(np.abs(rate(known)).max())
    at_rest = np.isfinite(found.x).all() and np.abs(rate(found.x)).max() <= SMALL * max(size, 1e-300)
    return found.x if at_rest else None


def equilibrium(field: Callable[[Tensor], Tensor], states: Floats) -> Floats | None:
    """Return a state `(n,)` at which `field` is zero, near the mean of `states (N, n)`; None where none is found."""

    def rate(x: Floats) -> Floats:
        with torch.no_grad():
            return field(torch.from_numpy(np.array(x))).numpy()

    def slope(x: Floats) -> Floats:
        return _exact_jacobian(field, torch.from_numpy(np.array(x))).detach().numpy()

    return zero_of(rate, slope, states)


def followed(field: Callable[[Tensor], Tensor], rest: Floats) -> Tensor | None:
    """Return the equilibrium `(n,)` near `rest (n,)` as a function of the parameters of `field`, None for none.

    One step of Newton's method with the Jacobian held: its value is the equilibrium, its derivative is that of the
    implicit function, `dx = -A^-1 df`, as A is exact at `rest`. There is none where A is singular.
    """
    state = torch.from_numpy(rest)
    matrix = _exact_jacobian(field, state).detach()
    step, info = torch.linalg.solve_ex(matrix, field(state))
    return None if int(info) or not bool(torch.isfinite(step).all()) else state - step


def spectrum_at(field: Callable[[Tensor], Tensor], state: Floats) -> Complexes:
    """Return the eigenvalues `(n,)` in 1/s of the Jacobian of `field` at a state `(n,)`."""
    return eigvals(_exact_jacobian(field, torch.from_numpy(state)).detach())[0].numpy()


def _exact_jacobian(field: Callable[[Tensor], Tensor], state: Tensor) -> Tensor:
    """Return A `(n, n)` at a state `(n,)`, in closed form where there is one: torch takes a second to differentiate."""
    closed = getattr(field, "has_symbolic_jacobian", False)
    return jacobian(field, state, "symbolic" if closed else "autodiff")
