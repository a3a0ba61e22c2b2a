"""Convergence: the terms over the training steps, as in the paper's Fig. 3, 6 and 9."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.reporting.figures.plateaus import Plateau, plateaus
from eigenode_cli.reporting.figures.style import (
    BORDER_LOOK,
    TERM_COLORS,
    draw_line,
    entry,
    failed_entry,
    legend_above,
    mark_failed,
    new_figure,
    short,
    step_axis,
    term_colors,
    warn,
)
from eigenode_cli.runs.reader import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SOLVED = 0.1
"""Error, as a fraction of that of the average, below which a run has found the solution and no local minimum."""


@dataclass(frozen=True)
class Convergence:
    """What the figure shows.

    Attributes:
        step: training steps of the records `(R,)`.
        terms: losses `(R,)` of SOL and the other terms that trained; NaN where undefined or not above zero.
        final: last recorded loss of each, zero included.
        failed: steps of the records whose solve failed `(F,)`.
        minima: the run's local minima of SOL.
    """

    step: Floats
    terms: dict[str, Floats]
    final: dict[str, float]
    failed: Floats
    minima: list[Plateau]


def convergence_numbers(run: Run) -> Convergence:
    """Return the numbers of the figure."""
    metrics = run.metrics
    names = [name for name in metrics.terms if name == "sol" or name in run.grads]
    settings = run.settings
    solved = tenth_of_average(run.data, settings.text("error.sol"), settings.number("error.huber_delta"))
    return Convergence(
        step=metrics.step,
        terms={name: _positive(metrics.terms[name]) for name in names},
        final={name: float(metrics.terms[name][-1]) for name in names},
        failed=metrics.step[metrics.failed],
        minima=plateaus(metrics.step, metrics.terms["sol"], solved),
    )


def tenth_of_average(data: Series, error: str, delta: float) -> float:
    """SOL of a model whose error is everywhere a tenth of that of the average over the oscillation.

    The average is the local minimum that the paper warns of (Fig. 1); it gives "solved" a scale that depends on
    the data alone.

    Args:
        data: observations; unobserved states are NaN.
        error: error function of SOL, mae | mse | huber.
        delta: Huber's threshold.
    """
    observed = data.values[:, data.mask.any(axis=0)]
    size = SOLVED * np.abs(observed - np.nanmedian(observed, axis=0))
    if error == "mse":
        size = size**2
    elif error == "huber":
        size = np.where(size <= delta, 0.5 * size**2, delta * (size - 0.5 * delta))
    return float(np.nanmean(size))


def draw_convergence(numbers: Convergence) -> "Figure":
    """Return the figure."""
    figure = new_figure(3.4)
    ax = figure.subplots()
    looks = _looks(tuple(numbers.terms))
    for name in reversed(numbers.terms):
        draw_line(ax, numbers.step, numbers.terms[name], zorder=4 if name == "sol" else 3, **looks[name])
    if np.isfinite(list(numbers.terms.values())).any():
        ax.set_yscale("log")
        ax.margins(y=0.08)
    else:
        ax.set_yticks([])
        warn(ax, "no loss above zero was recorded")
    _draw_minima(ax, numbers.minima)
    mark_failed(ax, numbers.failed)
    entries = [entry(f"{_title(name)}  {short(numbers.final[name])}", **looks[name]) for name in numbers.terms]
    if numbers.minima:
        entries.append(entry("local minimum" if len(numbers.minima) == 1 else "local minima", **BORDER_LOOK))
    if numbers.failed.size:
        entries.append(failed_entry(numbers.failed.size, numbers.step.size))
    legend_above(ax, entries, columns=3)
    step_axis(ax, numbers.step)
    ax.set_ylabel("loss")
    return figure


def _positive(values: Floats) -> Floats:
    """Return a copy in which what a logarithmic axis cannot show is NaN."""
    return np.where(np.isfinite(values) & (values > 0.0), values, np.nan)


def _title(name: str) -> str:
    """SOL, FRQ, ... as in the paper; the user's own terms as they are named."""
    return name.upper() if name in TERM_COLORS else name


def _looks(names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Colour and width of each term's line, SOL bold."""
    colors = term_colors(names)
    return {name: {"color": colors[name], "lw": 2.2 if name == "sol" else 1.1} for name in names}


def _draw_minima(ax: "Axes", minima: list[Plateau]) -> None:
    """Every local minimum as a dashed line over the whole width, with its level at the right end."""
    for minimum in minima:
        ax.axhline(minimum.level, zorder=5, **BORDER_LOOK)
        ax.annotate(
            short(minimum.level),
            (1.0, minimum.level),
            xycoords=ax.get_yaxis_transform(),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
