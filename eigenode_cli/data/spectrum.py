"""Frequencies in a measured signal: a periodogram of unequal times, its peaks, and the damping by decay."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import find_peaks, lombscargle

from eigenode_cli.arrays import Floats

OVERSAMPLING = 8
"""Frequencies of the grid for each that the length of the record tells apart."""
LOWEST, HIGHEST = 0.7, 0.95
"""Ends of the grid: lowest frequency in periods a record, highest one as a share of half the rate of the samples."""
MOST = 20_000
"""Largest number of frequencies of the grid."""
AT_ONCE = 2_000_000
"""Frequencies times samples that are taken at once, which bounds the memory."""
PROMINENT = 0.02
"""A peak counts if it stands out by this share of the highest one."""
FEWEST_PERIODS = 2.0
"""Periods that a record must have for a decrement."""


@dataclass(frozen=True)
class Periodogram:
    """Amplitude over frequency.

    Attributes:
        frequency: in Hz `(F,)`; amplitude: of the sine that fits best there, in the unit of the signal `(F,)`.
    """

    frequency: Floats
    amplitude: Floats


def periodogram(times: Floats, signal: Floats) -> Periodogram:
    """Return the Lomb-Scargle periodogram of samples `(N,)` at `times (N,)` in s, trend removed, under Hann's window.

    J. D. Scargle, Studies in astronomical time series analysis II, Astrophys. J. 263 (1982) 835-853, in
    `scipy.signal.lombscargle`.
    """
    span = float(times[-1] - times[0])
    spacing = float(np.median(np.diff(times)[np.diff(times) > 0.0]))
    highest = 0.5 / spacing
    count = int(min(MOST, max(16, OVERSAMPLING * highest * span)))
    lowest = min(LOWEST / span, 0.5 * highest)
    frequency = np.linspace(lowest, HIGHEST * highest, count)
    level = signal - np.polynomial.Polynomial.fit(times, signal, 1)(times)
    level *= 0.5 - 0.5 * np.cos(2.0 * np.pi * (times - times[0]) / span)  # Hann's window: no side lobes
    level -= level.mean()
    if not np.ptp(level) > 0.0:
        return Periodogram(frequency, np.zeros(count))
    parts = np.array_split(2.0 * np.pi * frequency, min(count, 1 + count * times.size // AT_ONCE))
    found = [np.atleast_1d(lombscargle(times - times[0], level, part, normalize="amplitude")) for part in parts]
    return Periodogram(frequency, 2.0 * np.abs(np.concatenate(found)))


def peaks(found: Periodogram, most: int = 4) -> Floats:
    """Return the frequencies in Hz of the peaks, the highest one first, between grid points by a parabola."""
    amplitude = np.concatenate([[0.0], found.amplitude, [0.0]])
    if not amplitude.any():
        return np.empty(0)
    index, _ = find_peaks(amplitude, prominence=PROMINENT * amplitude.max(), distance=OVERSAMPLING // 2)
    index = index[np.argsort(-amplitude[index])][:most]
    step = found.frequency[1] - found.frequency[0]
    left, middle, right = amplitude[index - 1], amplitude[index], amplitude[index + 1]
    bend = left - 2.0 * middle + right
    shift = np.where(bend < 0.0, 0.5 * (left - right) / np.where(bend < 0.0, bend, -1.0), 0.0)
    return found.frequency[index - 1] + step * np.clip(shift, -0.5, 0.5)


def dominant_frequency(times: Floats, signal: Floats) -> float | None:
    """Return the frequency in Hz of the highest peak, None where there is none."""
    found = peaks(periodogram(times, signal), 1)
    return float(found[0]) if found.size else None


@dataclass(frozen=True)
class Decay:
    """Oscillation of a free decay.

    Attributes:
        frequency: from zero crossings in Hz at the end of the record, where the amplitude is smallest, and its lowest
            and highest value over the record.
        damping: ratio by the logarithmic decrement of successive extremes, its median, lowest and highest value.
    """

    frequency: float
    frequency_range: tuple[float, float]
    damping: float
    damping_range: tuple[float, float]


def decay(times: Floats, signal: Floats, frequency: float) -> Decay | None:
    """Return what the extremes of an oscillation of about this frequency in Hz say; None where they are too few.

    The record is cut into half periods; the largest modulus of each is an extreme. The logarithmic decrement of a line
    through their logarithms over four periods gives the damping ratio, its spread that along the record.
    """
    level = signal - np.polynomial.Polynomial.fit(times, signal, 1)(times)
    if (times[-1] - times[0]) * frequency < FEWEST_PERIODS:
        return None
    crossings = _crossings(times, level, 0.25 / frequency)
    if crossings.size < 4:
        return None
    extremes = [np.abs(level[(times >= a) & (times <= b)]).max(initial=0.0) for a, b in pairwise(crossings)]
    sizes, middles = np.array(extremes), 0.5 * (crossings[1:] + crossings[:-1])
    kept = sizes > 0.02 * sizes.max()
    if kept.sum() < 3:
        return None
    sizes, middles = sizes[kept], middles[kept]
    halves = np.diff(crossings)
    window = max(3, min(8, sizes.size))
    rates = [
        -np.polynomial.Polynomial.fit(middles[i : i + window], np.log(sizes[i : i + window]), 1).convert().coef[-1]
        for i in range(sizes.size - window + 1)
    ]
    own = np.array([0.5 / halves[i : i + window].mean() for i in range(max(1, halves.size - window + 1))])
    angular = 2.0 * np.pi * float(np.median(own))
    ratios = np.array([rate / np.hypot(rate, angular) for rate in rates])
    return Decay(
        float(own[-1]),
        (float(own.min()), float(own.max())),
        float(np.median(ratios)),
        (float(ratios.min()), float(ratios.max())),
    )


def _crossings(times: Floats, level: Floats, apart: float) -> Floats:
    """Return the times of the zero crossings `(Z,)`, those nearer to the last one than `apart` left out."""
    index = np.flatnonzero(np.signbit(level[1:]) != np.signbit(level[:-1]))
    if not index.size:
        return np.empty(0)
    share = level[index] / (level[index] - level[index + 1])
    found = times[index] + share * (times[index + 1] - times[index])
    kept = [found[0]]
    for time in found[1:]:
        if time - kept[-1] >= apart:
            kept.append(time)
    return np.array(kept)


@dataclass(frozen=True)
class Modes:
    """Damped cosines fitted to signals: frequency in Hz and damping ratio of each, lowest first, and what is left."""

    pairs: tuple[tuple[float, float], ...]
    left: list[Floats]


def damped_modes(times: Floats, signals: Sequence[Floats], frequencies: Sequence[float]) -> Modes:
    """Fit damped cosines to signals.

    Amplitudes and phases are linear, so that only frequencies and rates are looked for (variable projection: G. Golub,
    V. Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432).

    Args:
        times: of the samples in s `(N,)`.
        signals: one or several `(N,)`, NaN where there is no sample.
        frequencies: about which they lie, in Hz.
    """
    start, span = np.asarray(frequencies, dtype=np.float64), float(times[-1] - times[0])
    since = times - times[0]
    levels = [signal / max(1e-300, float(np.nanmax(np.abs(signal - np.nanmean(signal))))) for signal in signals]

    def residuals(parameters: Floats) -> list[Floats]:
        hertz, rates = np.split(parameters, 2)
        envelope = np.exp(-np.clip(rates / span * since[:, None], -50.0, 50.0))
        phase = 2.0 * np.pi * (hertz * start) * since[:, None]
        basis = np.hstack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones((times.size, 1))])
        left = []
        for level in levels:
            known = np.isfinite(level)
            amplitudes = np.linalg.lstsq(basis[known], level[known], rcond=None)[0]
            left.append(level - basis @ amplitudes)
        return left

    def together(parameters: Floats) -> Floats:
        every = np.concatenate(residuals(parameters))
        return every[np.isfinite(every)]

    found = least_squares(together, np.concatenate([np.ones(start.size), np.full(start.size, 0.5)]), x_scale=0.01)
    hertz, rates = np.split(found.x, 2)
    angular = 2.0 * np.pi * np.abs(hertz) * start
    ratios = rates / span / np.hypot(rates / span, angular)
    pairs = sorted(zip((np.abs(hertz) * start).tolist(), ratios.tolist(), strict=True))
    return Modes(tuple(pairs), residuals(found.x))
