"""The figure of a sweep: every run a dot, medians and quartiles over the seeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.batch.summary import Group
from eigenode_cli.reporting.figures.style import (
    BORDER_LOOK,
    FAILED,
    MODEL,
    TRUTH,
    apply_scale,
    choose_scale,
    house_style,
    new_figure,
    save,
    to_svg,
)
from eigenode_cli.runs.atomic import make_folder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = {"sol": "SOL", "dense_error": "dense error", "max_real": "largest real part in 1/s"}
"""What the figure shows, with the axis label of each panel."""
DECADE = 10.0
"""Ratio of the largest to the smallest loss from which its axis is logarithmic."""


@dataclass(frozen=True)
class SweepNumbers:
    """What the figure shows.

    Attributes:
        labels: of each group.
        failures: failed runs and all that ended, of each group.
        values: by panel, the final number of every finished run of each group.
        quartiles: by panel, lower quartile, median, upper quartile `(G, 3)`; NaN without a run.
    """

    labels: tuple[str, ...]
    failures: tuple[tuple[int, int], ...]
    values: dict[str, tuple[np.ndarray, ...]]
    quartiles: dict[str, np.ndarray]


def sweep_numbers(groups: Sequence[Group]) -> SweepNumbers:
    """Return the numbers behind the figure."""
    return SweepNumbers(
        labels=tuple(group.label for group in groups),
        failures=tuple((group.failures, group.ended) for group in groups),
        values={name: tuple(group.values(name) for group in groups) for name in PANELS},
        quartiles={name: np.array([group.quartiles(name) for group in groups]) for name in PANELS},
    )


def draw_sweep(numbers: SweepNumbers) -> "Figure":
    """Draw the figure; call it within `house_style`."""
    count = len(numbers.labels)
    figure = new_figure(height=1.1 + 0.34 * count)
    figure.set_figwidth(8.4)
    axes = figure.subplots(1, len(PANELS), sharey=True)
    for ax, (name, label) in zip(axes, PANELS.items(), strict=True):
        _draw_panel(ax, numbers.values[name], numbers.quartiles[name], log=name != "max_real")
        ax.set_xlabel(label)
    marks = [f", {failed} of {ended} failed" if failed else "" for failed, ended in numbers.failures]
    axes[0].set_yticks(range(count), [label + mark for label, mark in zip(numbers.labels, marks, strict=True)])
    for tick, mark in zip(axes[0].get_yticklabels(), marks, strict=True):
        tick.set_color(FAILED if mark else TRUTH)
    axes[0].set_ylim(count - 0.5, -0.5)
    return figure


def _draw_panel(ax: "Axes", values: Sequence[np.ndarray], quartiles: np.ndarray, log: bool) -> None:
    known = np.concatenate(values)
    if log:
        if known.size and known.min() > 0.0 and known.max() > DECADE * known.min():
            ax.set_xscale("log")
    else:
        typical = float(np.median(np.abs(known))) if known.size else 0.0
        apply_scale(ax, "x", choose_scale(known, typical))
        ax.axvline(0.0, **BORDER_LOOK)
    for row, (dots, (low, middle, high)) in enumerate(zip(values, quartiles, strict=True)):
        ax.plot(dots, np.full(dots.size, row), "o", ms=3.0, mew=0.0, color=MODEL, alpha=0.45)
        ax.plot([low, high], [row, row], color=MODEL, lw=2.2)
        ax.plot([middle], [row], "|", ms=11, mew=1.8, color=TRUTH)
    ax.margins(x=0.06)


def draw_summary(folder: Path, groups: Sequence[Group]) -> list[Path]:
    """Draw the figure into `plots/` of the sweep's folder as .png and .pdf, and give their paths."""
    plots = folder / "plots"
    make_folder(plots)
    paths = [plots / f"summary{suffix}" for suffix in (".png", ".pdf")]
    with house_style():
        figure = draw_sweep(sweep_numbers(groups))
        for path in paths:
            save(figure, path)
    return paths


def svg_of_sweep(groups: Sequence[Group]) -> bytes:
    """Return the figure as a self-contained SVG."""
    with house_style():
        return to_svg(draw_sweep(sweep_numbers(groups)))
