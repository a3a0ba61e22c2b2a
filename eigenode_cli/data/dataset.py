"""What was measured of a system: one or several trajectories, and what is known of their initial states."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.solve.drive import Drive
from eigenode_cli.solve.times import checked_times


@dataclass(frozen=True)
class Series:
    """One measured trajectory.

    Attributes:
        times: data times in s `(N,)`, ascending; the first one is that of the initial state.
        values: measured states `(N, n)`, NaN where a state was not measured.
        initial_state: what is known of the state at the first time `(n,)`, NaN where nothing is: the model then starts
            from a trained value.
        rates: measured derivatives of the states `(N, n)`, as an accelerometer gives those of velocities, NaN where
            one was not measured; None where none was.
        offsets: channels that show a trained constant too: state i has number i, its derivative n + i.
        drive: the inputs, None for a system without.

    Raises:
        ValueError: the times are not finite and ascending, shapes do not fit together, or nothing was measured.
    """

    times: Floats
    values: Floats
    initial_state: Floats
    rates: Floats | None = None
    offsets: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    drive: Drive | None = None

    def __post_init__(self) -> None:
        """Check shapes and times, and make everything float64."""
        object.__setattr__(self, "times", checked_times(self.times))
        object.__setattr__(self, "values", np.ascontiguousarray(self.values, dtype=np.float64))
        object.__setattr__(self, "initial_state", np.array(self.initial_state, dtype=np.float64))
        if self.values.ndim != 2 or self.values.shape[0] != self.times.size:
            raise ValueError(f"values have shape {self.values.shape}, there are {self.times.size} times")
        if self.initial_state.shape != self.values.shape[1:]:
            raise ValueError(
                f"the initial state has shape {self.initial_state.shape}, of {self.values.shape[1]} states"
            )
        object.__setattr__(self, "offsets", np.array(self.offsets, dtype=np.int64))
        if self.rates is not None:
            object.__setattr__(self, "rates", np.ascontiguousarray(self.rates, dtype=np.float64))
            if self.rates.shape != self.values.shape:
                raise ValueError(f"rates have shape {self.rates.shape}, values {self.values.shape}")
        if not self.channel_mask.any():
            raise ValueError("nothing was measured: all values are NaN")
        if not self.channel_mask[:, self.offsets].any(axis=0).all():
            raise ValueError("an offset belongs to a channel that was not measured")

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Which entries of `values` were measured `(N, n)`."""
        return np.isfinite(self.values)

    @cached_property
    def channels(self) -> Floats:
        """What SOL compares `(N, C)`: the n states, and behind them their n derivatives where any was measured."""
        return self.values if self.rates is None else np.hstack([self.values, self.rates])

    @cached_property
    def channel_mask(self) -> NDArray[np.bool_]:
        """Which entries of `channels` were measured."""
        return np.isfinite(self.channels)

    @property
    def trained(self) -> int:
        """Number of parameters that this trajectory has of its own: unknown initial values, then offsets."""
        return self.unknown.size + self.offsets.size

    @property
    def inputs(self) -> int:
        """Number of inputs k."""
        return 0 if self.drive is None else self.drive.inputs

    @cached_property
    def driven(self) -> Floats:
        """Inputs at the data times `(N, k)`."""
        return np.empty((self.times.size, 0)) if self.drive is None else self.drive.at(self.times)

    @property
    def states(self) -> int:
        """Number of states n."""
        return self.values.shape[1]

    @property
    def unknown(self) -> Integers:
        """Indices of the states whose initial value is unknown."""
        return np.flatnonzero(np.isnan(self.initial_state))

    @property
    def seen(self) -> Floats:
        """Everything that is known of the states `(N, n)`: the measured values and the initial state."""
        seen = self.values.copy()
        seen[0] = np.where(np.isnan(self.initial_state), seen[0], self.initial_state)
        return seen

    @property
    def sizes(self) -> Floats:
        """Largest modulus that is known of each state `(n,)`; 0 where nothing is."""
        return np.nan_to_num(np.abs(self.seen), nan=0.0).max(axis=0)

    def leading(self, count: int) -> "Series":
        """Return the first `count` data times of it."""
        rates = None if self.rates is None else self.rates[:count]
        return replace(self, times=self.times[:count], values=self.values[:count], rates=rates)


@dataclass(frozen=True)
class Dataset:
    """All that training sees of a system.

    Attributes:
        series: one or several trajectories of the same states.
        states: names of the states, as in the files.

    Raises:
        ValueError: there is no trajectory, or their states differ.
    """

    series: tuple[Series, ...]
    states: tuple[str, ...]

    def __init__(self, series: Series | Sequence[Series], states: Sequence[str]) -> None:
        object.__setattr__(self, "series", (series,) if isinstance(series, Series) else tuple(series))
        object.__setattr__(self, "states", tuple(states))
        if not self.series:
            raise ValueError("a dataset needs at least one trajectory")
        for one in self.series:
            if one.states != len(self.states):
                raise ValueError(f"a trajectory of {one.states} states, named are {', '.join(self.states)}")
