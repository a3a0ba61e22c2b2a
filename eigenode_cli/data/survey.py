"""What a table holds, before anything is trained on it: channels, times, peaks, and targets that they suggest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.data.measured import Measured, Trajectory
from eigenode_cli.data.spectrum import Decay, Periodogram, damped_modes, decay, peaks, periodogram


@dataclass(frozen=True)
class ChannelSurvey:
    """One measured channel of one trajectory.

    Attributes:
        name, unit: of the channel.
        times, signal: samples that there are, in s `(K,)`.
        holes: samples that are missing; repeated: those equal to the one before.
        spectrum: its periodogram; peaks: in Hz, the highest one first.
    """

    name: str
    unit: str
    times: Floats
    signal: Floats
    holes: int
    repeated: int
    spectrum: Periodogram
    peaks: Floats


@dataclass(frozen=True)
class Survey:
    """A trajectory.

    Attributes:
        label: of the trajectory.
        times: in s `(N,)`.
        channels: that were measured.
        modes: frequency in Hz and damping ratio of as many modes as there are degrees of freedom, lowest first.
        decay: of the only mode, None of several or where the record tells none.
    """

    label: str
    times: Floats
    channels: tuple[ChannelSurvey, ...]
    modes: tuple[tuple[float, float], ...]
    decay: Decay | None

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Smallest, median and largest spacing of the times in s."""
        steps = np.diff(self.times)
        return float(steps.min()), float(np.median(steps)), float(steps.max())

    @property
    def gaps(self) -> int:
        """Number of spacings above one and a half of the median."""
        steps = np.diff(self.times)
        return int((steps > 1.5 * np.median(steps)).sum())


def survey(measured: Measured, trajectory: Trajectory, freedom: int) -> Survey:
    """Look at a trajectory.

    Args:
        measured: with names and units of the states.
        trajectory: one of them.
        freedom: number of modes that are looked for.
    """
    series, channels = trajectory.series, []
    n = series.states
    for number in np.flatnonzero(series.channel_mask.any(axis=0)):
        state, column = measured.states[number % n], series.channels[:, number]
        seen = np.isfinite(column)
        times, signal = series.times[seen], column[seen]
        spectrum = periodogram(times, signal)
        name, unit = (state.name, state.unit) if number < n else (f"rate of {state.name}", "")
        repeated = int((np.diff(signal) == 0.0).sum())
        channels.append(
            ChannelSurvey(name, unit, times, signal, int((~seen).sum()), repeated, spectrum, peaks(spectrum))
        )
    modes = _modes(series.times, [_whole(series.times, one) for one in channels], freedom)
    single = decay(channels[0].times, channels[0].signal, modes[0][0]) if len(modes) == 1 else None
    if single is not None:
        modes = ((single.frequency, single.damping),)
    return Survey(trajectory.label, series.times, tuple(channels), modes, single)


def _whole(times: Floats, channel: ChannelSurvey) -> Floats:
    """Return a channel at all times, NaN where it has no sample."""
    signal = np.full(times.size, np.nan)
    signal[np.isin(times, channel.times)] = channel.signal
    return signal


def _modes(times: Floats, signals: Sequence[Floats], count: int) -> tuple[tuple[float, float], ...]:
    """Return frequency in Hz and damping ratio of up to `count` modes, the lowest frequency first.

    One after another: the highest peak of what the modes so far leave is the next one, then all are fitted again.
    """
    pairs: tuple[tuple[float, float], ...] = ()
    left = list(signals)
    for _ in range(count):
        best = (0.0, 0.0)
        for signal in left:
            seen = np.isfinite(signal)
            spectrum = periodogram(times[seen], signal[seen])
            top = peaks(spectrum, 1)
            if top.size:
                size = max(float(np.ptp(signal[seen])), 1e-300)
                best = max(best, (float(spectrum.amplitude.max()) / size, float(top[0])))
        if best[1] == 0.0:
            break
        found = damped_modes(times, signals, [*(frequency for frequency, _ in pairs), best[1]])
        pairs, left = found.pairs, found.left
    return pairs
