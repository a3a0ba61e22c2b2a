"""Where the data of a training come from: a truth that they are sampled from, or tables."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.measured import Measured, Trajectory
from eigenode_cli.data.scaling import Scaling, scaling_of
from eigenode_cli.data.simulate import Truth
from eigenode_cli.systems.base import Parameter, State


@dataclass(frozen=True)
class Source:
    """Data, and what is known about them.

    Attributes:
        title: for people.
        states, inputs: name, unit and symbol of each.
        parameters: of the truth.
        dataset: what training sees, in internal units.
        scaling: the internal units.
        starts: first time of each trajectory of the dataset in s.
        truth: what the data are sampled from; None of measured ones.
        measured: what was read; None of simulated ones.
    """

    title: str
    states: tuple[State, ...]
    inputs: tuple[State, ...]
    parameters: tuple[Parameter, ...]
    dataset: Dataset
    scaling: Scaling
    starts: tuple[float, ...]
    truth: Truth | None = None
    measured: Measured | None = None

    @property
    def horizon(self) -> float:
        """Time from the first to the last data time of the first trajectory, in the internal unit."""
        times = self.dataset.series[0].times
        return float(times[-1] - times[0])

    def seconds(self, times: Floats, trajectory: int = 0) -> Floats:
        """Return internal times of a trajectory in s."""
        start = self.starts[trajectory]
        return times if self.truth is not None else start + times * self.scaling.time

    def whole(self, trajectory: Trajectory) -> Series:
        """Return all rows of a measured trajectory in internal units."""
        return self.scaling.scaled(trajectory.series)


def simulated_source(truth: Truth, dataset: Dataset) -> Source:
    """Return the source of data that were sampled from a truth, which stay as they are."""
    system = truth.system
    return Source(
        title=system.title,
        states=system.states,
        inputs=(),
        parameters=system.parameters,
        dataset=dataset,
        scaling=Scaling.none(len(system.states)),
        starts=tuple(float(series.times[0]) for series in dataset.series),
        truth=truth,
    )


def measured_source(measured: Measured, structure: str, frequency: Sequence[float] = ()) -> Source:
    """Return the source of measured data, scaled by what training sees of them.

    Args:
        measured: what was read.
        structure: of the vector field.
        frequency: stated frequencies in Hz, which give the unit of time.
    """
    seen = [one.seen for one in measured.training]
    scaling = scaling_of(seen, structure, frequency)
    names = [state.name for state in measured.states]
    return Source(
        title=measured.trajectories[0].label if len(seen) == 1 else f"{len(seen)} measured trajectories",
        states=measured.states,
        inputs=measured.inputs,
        parameters=(),
        dataset=Dataset([scaling.scaled(series) for series in seen], names),
        scaling=scaling,
        starts=tuple(float(series.times[0]) for series in seen),
        measured=measured,
    )


def leading_rows(series: Series, count: int) -> Series:
    """Return the first rows of a trajectory, at least four of them, its inputs over all times."""
    return series.leading(min(series.times.size, max(4, count)))


def with_initial_state(series: Series, state: Floats) -> Series:
    """Return the trajectory from a known initial state `(n,)`, without trained offsets."""
    return replace(series, initial_state=state, offsets=np.empty(0, dtype=np.int64))
