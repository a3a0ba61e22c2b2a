"""What computes the loss Jacobian at each stage of a training: no solve yet, a growing horizon, the whole of it."""

from dataclasses import replace
from functools import partial

import numpy as np

from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.engines.base import Engine, Evaluation, Floats, LossJacobian
from eigenode_cli.engines.select import build_engine
from eigenode_cli.field import VectorField
from eigenode_cli.problem import Problem
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.user import UserTerm

SPECTRAL = NAMES[1:]
"""The terms that need no solution, only states to take a spectrum at."""


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

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`."""
        return self._solved.evaluate(theta, times)


def build_stages(
    config: TrainConfig,
    field: VectorField,
    problem: Problem,
    user_terms: dict[str, UserTerm],
    whole: Engine,
) -> tuple[Engine, ...]:
    """The engines of all stages in their order: with `trainer.spectral_steps` first one that solves nothing.

    Args:
        config: of the run.
        field: the vector field.
        problem: over the whole horizon.
        user_terms: the user's own terms by name.
        whole: engine of `problem`, which is the last stage where that takes all terms from one solve.
    """
    make = partial(build_engine, config, field, user_terms=user_terms, announce=_unheard)
    lead = [make(problem.unsolved())] if config.trainer.spectral_steps > 0 else []
    spectral = tuple(term for term in problem.terms if term in SPECTRAL)
    rest = tuple(term for term in problem.terms if term not in SPECTRAL)
    split = config.eigen.at == "data" and spectral and rest

    def stage(fraction: float) -> Engine:
        if not split:
            return whole if fraction == 1.0 else make(problem.until(fraction))
        unsolved = make(replace(problem.unsolved(), terms=spectral))
        return SplitEngine(
            problem.terms, make(replace(problem.until(fraction), terms=rest)), unsolved, problem.stabilise
        )

    return (*lead, *map(stage, config.trainer.horizons))


def _unheard(_message: str) -> None:
    """Say nothing: the engine of the whole has announced what there is to say."""
