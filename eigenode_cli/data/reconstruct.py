"""Estimates of states that were not measured, from those that were.

Method `spline`: a smoothing spline through each measured signal, its smoothness chosen by generalised cross validation
(SciPy's `make_smoothing_spline`; P. Craven, G. Wahba, Smoothing noisy data with spline functions, Numer. Math. 31,
1979, 377-403). A velocity is the derivative of its position's spline, a position the integral of its velocity's.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly, make_smoothing_spline

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series

FEWEST = 5
"""Samples that the smoothing spline needs; through fewer an interpolating one is laid."""


@dataclass(frozen=True)
class Estimate:
    """States that a dataset suggests, for whatever needs all of them: scales, first guesses, spectra without a solve.

    Attributes:
        states: at the data times `(N, n)`; the measured values where there are any, NaN where nothing can be said.
        rates: their derivatives in 1/s `(N, n)`, NaN where nothing can be said.
        offsets: of the channels `(2 n,)`, their means over the record; zero for one without.
    """

    states: Floats
    rates: Floats
    offsets: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def complete(self) -> bool:
        """Whether every state is known."""
        return bool(np.isfinite(self.states).all())


def reconstruct(series: Series, structure: str) -> Estimate:
    """Return what the measurements say of all states by the method `spline`.

    Args:
        series: the measurements.
        structure: of the vector field; with `second_order` the second half of the states are the derivatives of the
            first, with `full` nothing is known of a state that was not measured.
    """
    n = series.states
    half = n // 2 if structure == "second_order" else 0
    times, offsets = series.times, _offsets(series)
    known = series.seen - offsets[:n]
    states, rates = known.copy(), np.full_like(known, np.nan)
    for i in range(n):
        curve = _curve(times, known[:, i])
        if curve is not None:
            missing = np.isnan(states[:, i])
            states[missing, i] = curve(times[missing])
            rates[:, i] = curve.derivative()(times)
    for position in range(half):
        velocity = position + half
        _complete_pair(series, known, states, rates, position, velocity)
    states[0] = np.where(np.isnan(series.initial_state), states[0], series.initial_state)
    if series.rates is not None:
        rates = np.where(np.isnan(series.rates), rates, series.rates - offsets[n:])
    return Estimate(states, rates, offsets)


def _offsets(series: Series) -> Floats:
    """Return first guesses of the offsets `(2 n,)`."""
    offsets = np.zeros(2 * series.states)
    for channel in series.offsets:
        offsets[channel] = np.nanmean(series.channels[:, channel])
    return offsets


def _complete_pair(series: Series, known: Floats, states: Floats, rates: Floats, position: int, velocity: int) -> None:
    """Fill the missing one of a position and its velocity, in place."""
    times, measured = series.times, np.asarray(series.mask.any(axis=0))
    if measured[position] and not measured[velocity]:
        states[:, velocity] = rates[:, position]
        curve = _curve(times, known[:, position])
        if curve is not None:
            rates[:, velocity] = curve.derivative(2)(times)
    elif measured[velocity] and not measured[position]:
        curve = _curve(times, known[:, velocity])
        if curve is not None:
            states[:, position] = _anchored(curve.antiderivative()(times), series.initial_state[position], times)
    elif not measured[position] and series.rates is not None and np.isfinite(series.rates[:, velocity]).any():
        curve = _curve(times, series.rates[:, velocity] - _offsets(series)[series.states + velocity])
        if curve is not None:
            once = curve.antiderivative()
            states[:, velocity] = _anchored(once(times), series.initial_state[velocity], times)
            twice = once.antiderivative()(times) + (states[0, velocity] - once(times[0])) * (times - times[0])
            states[:, position] = _anchored(twice, series.initial_state[position], times)
            rates[:, position] = states[:, velocity]
    if measured[velocity]:
        rates[:, position] = states[:, velocity]


def _anchored(integral: Floats, start: float, times: Floats) -> Floats:
    """Return an integral `(N,)` that begins at a known value, or, where none is known, has neither mean nor trend."""
    if not np.isnan(start):
        return start + integral - integral[0]
    return integral - np.polynomial.Polynomial.fit(times, integral, 1)(times)


def _curve(times: Floats, values: Floats) -> "BSpline | PPoly | None":
    """Return the spline through the finite values of a signal, None if there are fewer than two."""
    seen = np.isfinite(values)
    first = np.concatenate([[True], np.diff(times[seen]) > 0.0]) if seen.any() else np.empty(0, dtype=bool)
    t, y = times[seen][first], values[seen][first]
    if t.size < 2:
        return None
    return make_smoothing_spline(t, y) if t.size >= FEWEST else CubicSpline(t, y)
