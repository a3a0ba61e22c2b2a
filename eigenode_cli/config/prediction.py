"""Predictions of every measured trajectory by the model of a run, and their error where data were held out."""

from collections.abc import Callable

import numpy as np

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.config.setup import Setup, engine_of
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.reconstruct import reconstruct
from eigenode_cli.data.source import leading_rows, with_initial_state
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.holdout import Holdout, Part
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, flat_parameters, own_parameters

OPENING = 0.5
"""Time in internal units whose rows tell the initial state of a trajectory that is held out as a whole."""
FEWEST = 8
"""Rows that tell it at least."""


def holdout_of(setup: Setup, field: VectorField | None = None) -> Holdout | None:
    """Return what predicts the measured trajectories of a run; None of a simulated one.

    Args:
        setup: the parts of the run.
        field: another field that has trained on the same data, None for that of the run.
    """
    measured, source = setup.source.measured, setup.source
    if measured is None:
        return None
    field = setup.field if field is None else field
    size = flat_parameters(field).size
    seen = source.dataset.series
    places = own_parameters(size + sum(series.trained for series in seen), seen)
    parts = []
    for number, trajectory in enumerate(measured.trajectories):
        series = source.whole(trajectory)
        # a trajectory that is held out has the sensors of the last one that is not
        initial, offset = places[min(number, len(places) - 1)]
        shift = _picker(series.offsets, series.channels.shape[1], offset)
        own = np.arange(size)
        if trajectory.trained == 0:
            series = with_initial_state(series, _opening(series, setup.config.network.structure))
        else:
            own = np.concatenate([own, initial, offset])
        parts.append(Part(series, trajectory.trained, _engine(setup, field, series), _chosen(own), shift))
    return Holdout(field, parts)


def _engine(setup: Setup, field: VectorField, series: Series) -> Engine:
    problem = Problem(
        data=series,
        targets=setup.target.rows(series.times),
        terms=("sol",),
        solver=setup.problem.solver,
        stabilise=False,
    )
    return engine_of(setup.config, field, problem)


def _opening(series: Series, structure: str) -> Floats:
    """Return the state that a trajectory begins with, as its first rows tell it; zero where they do not."""
    count = int(np.searchsorted(series.times, series.times[0] + OPENING))
    return np.nan_to_num(reconstruct(leading_rows(series, max(count, FEWEST)), structure).states[0])


def _chosen(index: Integers) -> Callable[[Floats], Floats]:
    """Return what picks these entries out of a vector."""
    return lambda theta: theta[index]


def _picker(channels: Integers, count: int, index: Integers) -> Callable[[Floats], Floats]:
    """Return what makes the offsets of all channels `(C,)` of the parameters at `index`."""

    def offsets(theta: Floats) -> Floats:
        every = np.zeros(count)
        every[channels] = theta[index]
        return every

    return offsets
