"""Measured channels over time, and their spectra beside them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eigenode_cli.data.survey import ChannelSurvey, Survey
from eigenode_cli.reporting.figures.style import MODEL, TRUTH, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW = 1.7
"""Height of a channel's row in inches."""
MOST = 6
"""Most rows of the picture."""


def draw_survey(found: Sequence[Survey], path: Path) -> None:
    """Draw a row for each channel of each trajectory: signal on the left, amplitude over frequency on the right."""
    rows = [(one, channel) for one in found for channel in one.channels][:MOST]
    with house_style():
        _figure(rows).savefig(path, dpi=150)


def _figure(rows: Sequence[tuple[Survey, ChannelSurvey]]) -> "Figure":
    figure = new_figure(0.9 + ROW * len(rows))
    axes = figure.subplots(len(rows), 2, squeeze=False, gridspec_kw={"width_ratios": [2.0, 1.0]})
    for (left, right), (one, channel) in zip(axes, rows, strict=True):
        left.plot(channel.times, channel.signal, color=TRUTH, lw=0.8, marker="." if channel.times.size < 200 else None)
        left.set_ylabel(f"{channel.name} in {channel.unit}" if channel.unit else channel.name)
        right.plot(channel.spectrum.frequency, channel.spectrum.amplitude, color=MODEL, lw=0.9)
        for frequency, _ in one.modes:
            right.axvline(frequency, color=TRUTH, lw=0.6, ls="--")
        top = max([float(peak) for peak in channel.peaks[:4]] + [frequency for frequency, _ in one.modes], default=0.0)
        right.set_xlim(0.0, min(float(channel.spectrum.frequency[-1]), 3.0 * top) or None)
        left.set_title(one.label, fontsize="small", loc="left")
    axes[-1][0].set_xlabel("$t$ in s")
    axes[-1][1].set_xlabel("$f$ in Hz")
    return figure
