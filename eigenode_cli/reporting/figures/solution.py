"""Solution: the model against the truth and the data over twice the training horizon (the paper's Fig. 2)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reporting.figures.style import (
    BEYOND,
    BORDER_LOOK,
    MODEL,
    TRUTH,
    Scale,
    entry,
    frame,
    label,
    legend_above,
    new_figure,
    set_limits,
    warn,
)
from eigenode_cli.runs.reader import Run
from eigenode_cli.systems.base import State

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MODEL_LOOK: dict[str, Any] = {"color": MODEL, "lw": 1.6}
DATA_LOOK: dict[str, Any] = {"color": TRUTH, "marker": "o", "ms": 2.8, "mew": 0.7, "mfc": "white", "ls": "none"}

REACH = 1.5
"""How far a diverging model may stretch the axes, in spans of the truth or the data on either side."""


@dataclass(frozen=True)
class Panel:
    """One state of the figure: truth and model on the grid `(D,)`, data points `(K,)`."""

    state: State
    truth: Floats
    model: Floats
    data_times: Floats
    data: Floats
    limits: tuple[float, float]


@dataclass(frozen=True)
class SolutionNumbers:
    """What the figure shows.

    Attributes:
        times: dense grid in s `(D,)`.
        horizon: end of the training horizon in s.
        panels: x1 and every other observed state.
        error: model minus truth of x1 `(D,)`, None where other observed states take its place or either is not known.
        error_limit: modulus up to which `error` is shown.
    """

    times: Floats
    horizon: float
    panels: list[Panel]
    error: Floats | None
    error_limit: float


def solution_numbers(run: Run) -> SolutionNumbers:
    """Return the numbers of the figure."""
    solution, data = run.solution, run.data
    shown = [i for i in range(len(run.states)) if i == 0 or data.mask[:, i].any()]
    panels: list[Panel] = []
    for i in shown:
        seen = data.mask[:, i]
        points = data.values[seen, i]
        known = np.concatenate([solution.truth[:, i], points])
        limits = reach(known, solution.model[:, i])
        panels.append(
            Panel(run.states[i], solution.truth[:, i], solution.model[:, i], data.times[seen], points, limits)
        )
    error = None
    if len(panels) == 1 and np.isfinite(panels[0].model - panels[0].truth).any():
        error = panels[0].model - panels[0].truth
    return SolutionNumbers(
        times=solution.times,
        horizon=float(solution.times[~solution.beyond][-1]),
        panels=panels,
        error=error,
        error_limit=0.0 if error is None else error_limit(panels[0].truth, error),
    )


def reach(known: Floats, model: Floats) -> tuple[float, float]:
    """Limits that hold what is known and as much of the model as leaves the known readable."""
    low, high = frame(known)
    if not np.isfinite(known).any():
        return frame(model)
    span = high - low
    bottom, top = frame(np.append(model, [low, high]))
    return max(bottom, low - REACH * span), min(top, high + REACH * span)


def error_limit(truth: Floats, error: Floats) -> float:
    """Largest error that the figure shows: all of it, or the span of the truth where the model diverges."""
    low, high = frame(truth)
    largest = float(np.abs(frame(np.append(error, 0.0))).max())
    return min(largest, high - low) if high > low else largest


def draw_solution(numbers: SolutionNumbers) -> "Figure":
    """Return the figure: one panel a state, and the error of x1 below where only x1 is shown."""
    rows = len(numbers.panels) + (numbers.error is not None)
    ratios = [1.0] * len(numbers.panels) + [0.45] * (numbers.error is not None)
    figure = new_figure(1.0 + 2.0 * sum(ratios))
    axes: list[Axes] = list(
        figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
    )
    for ax, panel in zip(axes, numbers.panels, strict=False):
        _draw_panel(ax, numbers.times, panel)
    if numbers.error is not None:
        _draw_error(axes[-1], numbers, numbers.error)
    for ax in axes:
        ax.axvspan(numbers.horizon, numbers.times[-1], color=BEYOND, alpha=0.1, lw=0, zorder=0)
        ax.axvline(numbers.horizon, color=BEYOND, lw=0.7, zorder=1)
        ax.set_xlim(numbers.times[0], numbers.times[-1])
    figure.align_ylabels(axes)
    axes[-1].set_xlabel("$t$ in s")
    top = numbers.panels[0]
    entries = [entry("truth", **BORDER_LOOK)] if np.isfinite(top.truth).any() else []
    entries += [entry("model", **MODEL_LOOK)] if np.isfinite(top.model).any() else []
    if any(panel.data.size for panel in numbers.panels):
        entries.append(entry("data", **DATA_LOOK))
    legend_above(axes[0], entries, columns=3)
    axes[0].set_title("beyond the training horizon", loc="right", color=BEYOND, fontsize=9, style="italic")
    return figure


def _draw_panel(ax: "Axes", times: Floats, panel: Panel) -> None:
    """Truth, model and data points of one state."""
    ax.plot(times, panel.model, zorder=3, **MODEL_LOOK)
    ax.plot(times, panel.truth, zorder=4, **BORDER_LOOK)
    ax.plot(panel.data_times, panel.data, zorder=5, **DATA_LOOK)
    set_limits(ax, "y", panel.limits, Scale(None), room=0.08)
    ax.set_ylabel(label(panel.state))
    if not np.isfinite(panel.model).any():
        warn(ax, "the model could not be solved")


def _draw_error(ax: "Axes", numbers: SolutionNumbers, error: Floats) -> None:
    """Model minus truth of x1."""
    state = numbers.panels[0].state
    ax.plot(numbers.times, error, zorder=3, **MODEL_LOOK)
    ax.axhline(0.0, zorder=2, **BORDER_LOOK)
    set_limits(ax, "y", (-numbers.error_limit, numbers.error_limit), Scale(None), room=0.1)
    ax.set_ylabel(rf"error in {state.unit}" if state.unit else "error")
