"""The scaled terms of one engine as one function of the parameters: what a line search minimises."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import Engine, LossJacobian
from eigenode_cli.solve.status import Status
from eigenode_cli.training.bfgs import Point


@dataclass(frozen=True)
class Evaluated(Point):
    """A point with the loss Jacobian that it comes from."""

    jacobian: LossJacobian

    @property
    def status(self) -> Status:
        """How the solve ended."""
        return self.jacobian.status

    @property
    def values(self) -> Floats:
        """Of the named terms `(L,)`."""
        return self.jacobian.values

    @property
    def guard_count(self) -> int:
        """Eigenvalue sensitivities that the condition guard bounded."""
        return self.jacobian.guard_count


class Objective:
    """Sum of the scaled terms; infinite where the solve fails or a term has no finite value and gradient.

    Remembers the last point: a line search ends where the next iteration begins.

    Args:
        engine: gives the loss Jacobian.
        scales: factor of each named term `(L,)`.
        trained: which parameters it is a function of `(P,)`, None for all.
    """

    def __init__(self, engine: Engine, scales: Floats, trained: NDArray[np.bool_] | None = None) -> None:
        self.engine = engine
        self._trained = trained
        self._scales = scales
        self._theta = np.empty(0)
        self._last: Evaluated | None = None

    def at(self, theta: Floats) -> Evaluated:
        """Value and gradient at `theta (P,)`."""
        if self._last is None or not np.array_equal(theta, self._theta):
            self._theta, self._last = theta.copy(), self._evaluate(theta)
        return self._last

    def _evaluate(self, theta: Floats) -> Evaluated:
        jacobian = self.engine.loss_jacobian(theta)
        value = float(self._scales @ jacobian.values)
        gradient = self._scales @ jacobian.gradients
        if self._trained is not None:
            gradient[~self._trained] = 0.0
        if jacobian.status is not Status.OK or not (math.isfinite(value) and np.isfinite(gradient).all()):
            value = math.inf
        return Evaluated(value, gradient, jacobian)


FLAT = 1e-5
"""Largest change of a function, relative to its size, that counts as none."""


def stationary(gradient: Floats, theta: Floats, size: float) -> bool:
    """Whether a function of this size is as good as flat at the parameters `theta (P,)`, where it has this gradient.

    To first order, no parameter that changes by as much as itself (at least by 1) changes the function by more than
    `FLAT` of its size (J. E. Dennis, R. B. Schnabel, Numerical Methods for Unconstrained Optimization, 1983, Sec. 7.2).
    """
    return bool((np.abs(gradient) * np.maximum(np.abs(theta), 1.0)).max() <= FLAT * size)
