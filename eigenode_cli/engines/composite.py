"""Terms of a solve and terms of the data states in one loss Jacobian."""

from dataclasses import replace

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import Advance, Engine, Evaluation, LossJacobian, ResidualJacobian, single_step
from eigenode_cli.engines.update import Update
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import SPECTRAL


class SplitEngine:
    """The spectral terms at all data states, the others from a solve: `eigen.at=data`.

    What the solve has not reached, or reached wrongly, is then held by its spectra all the same.

    Args:
        terms: names `(L,)` in the order of the rows.
        solved: gives those of them that need a solve.
        spectral: gives the others without one.
        stabilise: whether the spectral terms go on where the solve fails; otherwise all are NaN there.
    """

    def __init__(self, terms: tuple[str, ...], solved: Engine, spectral: Engine, stabilise: bool) -> None:
        self.name = solved.name
        self._solved, self._spectral, self._stabilise = solved, spectral, stabilise
        self._rows = np.array([term not in SPECTRAL for term in terms])

    @property
    def compile_seconds(self) -> float:
        """See `Engine.compile_seconds`."""
        return self._solved.compile_seconds + self._spectral.compile_seconds

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        """See `Engine.loss_jacobian`; trajectory, status and solver steps are those of the solve."""
        solved, spectral = self._solved.loss_jacobian(theta), self._spectral.loss_jacobian(theta)
        values = np.full(self._rows.size, np.nan)
        gradients = np.full((self._rows.size, theta.size), np.nan)
        values[self._rows], gradients[self._rows] = solved.values, solved.gradients
        if self._stabilise or solved.status is Status.OK:
            values[~self._rows], gradients[~self._rows] = spectral.values, spectral.gradients
        guards = solved.guard_count + spectral.guard_count
        return replace(solved, values=values, gradients=gradients, guard_count=guards)

    def residual_jacobian(self, theta: Floats, differentiated: bool = True) -> ResidualJacobian:
        """See `Engine.residual_jacobian`: there is none where spectra are taken apart from the solution."""
        del theta, differentiated
        raise ValueError("residuals are those of the six terms along a solution")

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: one step."""
        return single_step(self, theta, update, rates, halt)

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`."""
        return self._solved.evaluate(theta, times)
