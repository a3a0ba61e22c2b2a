"""Internal units of measured data, in which time, states and inputs are of order one.

A record in microseconds or years, millivolts or hundreds of millimetres then trains with the same settings. Training
sees scaled data alone; whatever a person sees is in the units of the file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.reconstruct import reconstruct
from eigenode_cli.solve.drive import Drive

DECIMALS = 10
"""Of scaled values, which are of order one."""
DIGITS = 9
"""Of times relative to the length of the record: a clock that counts from far away has no more."""


@dataclass(frozen=True)
class Scaling:
    """Internal units: a quantity is its scaled value times its unit.

    Attributes:
        time: in s.
        states: of each state `(n,)`; with the structure `second_order` a velocity's is that of its position over time.
        inputs: of each input `(k,)`.
    """

    time: float
    states: Floats
    inputs: Floats

    @classmethod
    def none(cls, states: int, inputs: int = 0) -> "Scaling":
        """Return that of data that stay as they are."""
        return cls(1.0, np.ones(states), np.ones(inputs))

    @property
    def rates(self) -> Floats:
        """Units of the states' derivatives `(n,)`."""
        return self.states / self.time

    def scaled(self, series: Series) -> Series:
        """Return a trajectory in internal units, its first time at zero.

        Numbers are rounded far below what any clock or sensor tells, so that the same record in other units, or with
        its clock shifted, gives the same bits: least squares would carry a difference of rounding on for long.
        """
        start, span, drive = series.times[0], float(series.times[-1] - series.times[0]), series.drive

        def since(times: Floats) -> Floats:
            return np.round(_significant(times - start, span) / self.time, DECIMALS)

        if drive is not None:
            drive = Drive(since(drive.times), np.round(drive.values / self.inputs, DECIMALS), drive.hold)
        return replace(
            series,
            times=since(series.times),
            values=np.round(series.values / self.states, DECIMALS),
            initial_state=series.initial_state / self.states,
            rates=None if series.rates is None else np.round(series.rates / self.rates, DECIMALS),
            drive=drive,
        )

    def frequency(self, hertz: float) -> float:
        """Return a frequency in Hz in internal units."""
        return round(hertz * self.time, DECIMALS + 2)

    def eigenvalues(self, scaled: Complexes) -> Complexes:
        """Return eigenvalues in 1/s."""
        return scaled / self.time


def _significant(times: Floats, span: float) -> Floats:
    """Return times in s with as many digits as `DIGITS` relative to the length of the record."""
    return np.round(times, DIGITS - int(np.ceil(np.log10(span)))) if span > 0.0 else times


def scaling_of(every: Sequence[Series], structure: str, frequency: Sequence[float] = ()) -> Scaling:
    """Return internal units in which these trajectories are of order one.

    The unit of time is the inverse of the stated angular frequency, the geometric mean of several; without one it
    follows from the data, as the ratio of each measured signal's spread to that of its derivative. A position's unit is
    half of its range; where only a velocity or an acceleration was measured it follows from that and the unit of time.
    A state of which nothing is known gets the geometric mean of the others.

    Args:
        every: measured trajectories in the user's units.
        structure: of the vector field.
        frequency: stated frequencies in Hz.
    """
    n = every[0].states
    channels = np.concatenate([_channels(one) for one in every])
    half = _half_ranges(channels)
    time = float(np.exp(np.mean(-np.log(2.0 * np.pi * np.asarray(frequency))))) if len(frequency) else _time(every)
    sizes = np.stack([half[:n], half[n:] * time])  # of a state: from itself, and from its derivative
    states = np.where(np.isfinite(sizes[0]), sizes[0], sizes[1])
    if structure == "second_order":
        positions, velocities = np.split(states, 2)
        positions = np.where(np.isfinite(positions), positions, velocities * time)
        states = np.concatenate([positions, positions / time])
    known = states[np.isfinite(states)]
    states = np.where(np.isfinite(states), states, float(np.exp(np.mean(np.log(known)))) if known.size else 1.0)
    if structure == "second_order":
        states[n // 2 :] = states[: n // 2] / time
    driven = [one.drive.values for one in every if one.drive is not None]
    inputs = _sizes(np.concatenate(driven)) if driven else np.empty(0)
    return Scaling(time, states, inputs)


def _channels(series: Series) -> Floats:
    """Return states and their derivatives `(N, 2 n)`, NaN where not measured."""
    rates = np.full_like(series.values, np.nan) if series.rates is None else series.rates
    return np.hstack([series.values, rates])


def _half_ranges(samples: Floats) -> Floats:
    """Return half the range of each column; NaN for one without samples or without range."""
    found = np.full(samples.shape[1], np.nan)
    for i, column in enumerate(samples.T):
        seen = column[np.isfinite(column)]
        if seen.size and np.ptp(seen) > 0.0:
            found[i] = 0.5 * np.ptp(seen)
    return found


def _sizes(samples: Floats) -> Floats:
    """Return the largest modulus of each column, 1 for one of zeros."""
    size = np.abs(samples).max(axis=0)
    return np.where(size > 0.0, size, 1.0)


def _time(every: Sequence[Series]) -> float:
    """Return a time in s in which measured signals change by about as much as they vary."""
    times = []
    for one in every:
        spacing = (one.times[-1] - one.times[0]) / max(1, one.times.size - 1) or 1.0
        for signal in _channels(one).T:
            seen = np.isfinite(signal)
            if seen.sum() < 3 or np.ptp(signal[seen]) == 0.0:
                continue
            level = (signal - signal[seen].mean()) / np.ptp(signal[seen])  # GCV looks for smoothness on a fixed scale
            plain = Series((one.times - one.times[0]) / spacing, level[:, None], np.array([np.nan]))
            rate = reconstruct(plain, "full").rates[:, 0]
            change = float(np.sqrt(np.mean(rate[np.isfinite(rate)] ** 2)))
            if change > 0.0:
                times.append(spacing * float(np.sqrt(np.mean(level[seen] ** 2))) / change)
    return float(np.exp(np.mean(np.log(times)))) if times else float(every[0].times[-1] - every[0].times[0]) or 1.0
