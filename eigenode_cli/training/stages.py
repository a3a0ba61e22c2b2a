"""A training is a list of stages: what trains, over which horizon, where spectra are taken, for how many steps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.composite import SplitEngine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import trained_mask
from eigenode_cli.terms import SPECTRAL


@dataclass(frozen=True)
class Stage:
    """One part of a training.

    Attributes:
        steps: how many training steps it takes; None for an equal share of those that no other stage names.
        terms: names of the terms whose gradients train, in canonical order; None for those of the training.
        horizons: leading fractions of the data's horizon that share the steps equally, one after another.
        spectra: where the spectral terms are taken: along the `trajectory`, up to the horizon, or at all `data` states.
        solve: whether anything is solved; without it the spectral terms train alone, at the data states.
        trained: names of the blocks of parameters that train, the others are held; None for all.

    Raises:
        ValueError: a fraction is not in (0, 1], there is none, or the place of the spectra is unknown.
    """

    steps: int | None = None
    terms: tuple[str, ...] | None = None
    horizons: tuple[float, ...] = (1.0,)
    spectra: str = "trajectory"
    solve: bool = True
    trained: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not self.horizons or not all(0.0 < fraction <= 1.0 for fraction in self.horizons):
            raise ValueError(f"horizons={self.horizons}: must be fractions above 0 and at most 1")
        if self.spectra not in ("trajectory", "data"):
            raise ValueError(f"spectra={self.spectra}: choose from trajectory, data")


@dataclass(frozen=True)
class Phase:
    """Training steps that one engine takes: a part of a phase.

    Attributes:
        first: number of the first of them; the phase lasts to that of the next one.
        engine: computes the loss Jacobian of L terms.
        scales: factor of each of these terms' gradients `(L,)`.
        trained: which parameters train `(P,)`, the others are held; None for all.
    """

    first: int
    engine: Engine
    scales: Floats
    trained: NDArray[np.bool_] | None = None


def stage_lengths(stages: Sequence[Stage], steps: int) -> list[int]:
    """Return how many steps each stage has of `steps` in all.

    Raises:
        ValueError: those that stages name do not fit: they are more, or fewer and no stage takes the rest.
    """
    named = sum(stage.steps or 0 for stage in stages)
    open_ones = sum(stage.steps is None for stage in stages)
    rest = steps - named
    if rest < open_ones or (rest > 0 and open_ones == 0):
        raise ValueError(f"the stages take {named} steps of {steps}, and {open_ones} stages share the rest")
    ends = [-(-number * rest // max(1, open_ones)) for number in range(open_ones + 1)]
    shares = iter(np.diff(ends).tolist())
    return [next(shares) if stage.steps is None else stage.steps for stage in stages]


def build_phases(
    stages: Sequence[Stage],
    steps: int,
    problem: Problem,
    scales: Mapping[str, float],
    whole: Engine,
    engine_of: Callable[[Problem], Engine],
    blocks: Mapping[str, slice] | None = None,
) -> tuple[Phase, ...]:
    """Return what trains at each step: a phase for every horizon of every stage.

    Args:
        stages: of the training.
        steps: training steps in all.
        problem: over the whole horizon, with the terms of the training.
        scales: factor of each term's gradient by name.
        whole: engine of `problem`.
        engine_of: builds the engine of another problem.
        blocks: where each block of parameters stands in theta.

    Raises:
        ValueError: a stage trains a block that there is not.
    """
    phases, start = [], 0
    for stage, length in zip(stages, stage_lengths(stages, steps), strict=True):
        part = problem if stage.terms is None else problem.changed(terms=stage.terms)
        trained = None if stage.trained is None else trained_mask(blocks or {}, stage.trained)
        factors, shares = np.array([scales[term] for term in part.terms]), len(stage.horizons)
        for number, fraction in enumerate(stage.horizons):
            first = start - (-number * length // shares)
            usual = stage.solve and part is problem and fraction == 1.0 and not _apart(stage, part)
            engine = whole if usual else _engine(stage, part, fraction, engine_of)
            phases.append(Phase(first, engine, factors, trained))
        start += length
    return tuple(phases)


def _apart(stage: Stage, problem: Problem) -> bool:
    """Whether a stage takes its spectral terms apart from the others."""
    spectral = set(problem.terms) & set(SPECTRAL)
    return stage.spectra == "data" and bool(spectral) and spectral != set(problem.terms)


def _engine(stage: Stage, problem: Problem, fraction: float, engine_of: Callable[[Problem], Engine]) -> Engine:
    """Return what computes the loss Jacobian of a stage over a leading fraction of the horizon."""
    if not stage.solve:
        return engine_of(problem.unsolved())
    part = problem if fraction == 1.0 else problem.until(fraction)
    if not _apart(stage, problem):
        return engine_of(part)
    spectral = tuple(term for term in problem.terms if term in SPECTRAL)
    rest = tuple(term for term in problem.terms if term not in SPECTRAL)
    at_data = engine_of(problem.unsolved().changed(terms=spectral))
    return SplitEngine(problem.terms, engine_of(part.changed(terms=rest)), at_data, problem.stabilise)
