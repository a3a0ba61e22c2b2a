"""The equilibrium of a vector field, and the spectrum there."""

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


def equilibrium(field: Callable[[Tensor], Tensor], states: Floats) -> Floats | None:
    """Return a state `(n,)` at which `field` is zero, near the mean of `states (N, n)`; None where none is found.

    By Powell's hybrid method (`scipy.optimize.root`), with the exact Jacobian.
    """
    known = states[np.isfinite(states).all(axis=1)]
    if not known.size:
        return None

    def rate(x: Floats) -> Floats:
        with torch.no_grad():
            return field(torch.from_numpy(np.array(x))).numpy()

    def slope(x: Floats) -> Floats:
        return jacobian(field, torch.from_numpy(np.array(x)), "autodiff").detach().numpy()

    with np.errstate(all="ignore"):
        found = root(rate, known.mean(axis=0), jac=slope)
    with torch.no_grad():
        size = float(field(torch.from_numpy(known)).abs().max())
    at_rest = np.isfinite(found.x).all() and np.abs(rate(found.x)).max() <= SMALL * max(size, 1e-300)
    return found.x if at_rest else None


def spectrum_at(field: Callable[[Tensor], Tensor], state: Floats) -> Complexes:
    """Return the eigenvalues `(n,)` in 1/s of the Jacobian of `field` at a state `(n,)`."""
    matrix = jacobian(field, torch.from_numpy(state), "autodiff").detach()
    return eigvals(matrix)[0].numpy()
