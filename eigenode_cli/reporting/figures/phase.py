"""Phase portrait: the second state over the first, truth and model."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reporting.figures.solution import reach
from eigenode_cli.reporting.figures.style import (
    MODEL,
    TRUTH,
    Scale,
    entry,
    label,
    legend_above,
    new_figure,
    set_limits,
    warn,
)
from eigenode_cli.runs.reader import Run
from eigenode_cli.systems.base import State

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Phase:
    """What the figure shows.

    Attributes:
        states: of the horizontal and the vertical axis.
        truth: over twice the training horizon `(D, 2)`.
        model: over the training horizon `(D1, 2)`; `beyond` goes on from its last point `(D2, 2)`.
        start: the initial state `(2,)`.
        limits: of both axes.
    """

    states: tuple[State, State]
    truth: Floats
    model: Floats
    beyond: Floats
    start: Floats
    limits: tuple[tuple[float, float], tuple[float, float]]


def phase_numbers(run: Run) -> Phase:
    """Return the numbers of the figure, of the first two states."""
    solution = run.solution
    truth, model = solution.truth[:, :2], solution.model[:, :2]
    inside = int((~solution.beyond).sum())
    known = np.vstack([truth, run.data.values[:, :2]])
    return Phase(
        states=(run.states[0], run.states[1]),
        truth=truth,
        model=model[:inside],
        beyond=model[inside - 1 :],
        start=truth[0] if np.isfinite(truth[0]).all() else model[0],
        limits=(reach(known[:, 0], model[:, 0]), reach(known[:, 1], model[:, 1])),
    )


def draw_phase(numbers: Phase) -> "Figure":
    """Return the figure."""
    figure = new_figure(3.9)
    ax = figure.subplots()
    # curves that are traced many times would fill the gaps of a dashed line: here the truth lies broad underneath
    broad = {"color": "#BDBDBD", "lw": 2.2}
    look = {"color": MODEL, "lw": 1.0}
    faint = {"color": MODEL, "lw": 0.9, "ls": (0, (1, 1.2))}
    start = {"color": TRUTH, "marker": "o", "ms": 6, "ls": "none"}
    ax.plot(*numbers.truth.T, zorder=2, **broad)
    ax.plot(*numbers.beyond.T, zorder=3, **faint)
    ax.plot(*numbers.model.T, zorder=4, **look)
    ax.plot(*numbers.start, zorder=5, **start)
    for axis, limits in zip("xy", numbers.limits, strict=True):
        set_limits(ax, axis, limits, Scale(None), room=0.08)
    if not np.isfinite(numbers.model).any():
        warn(ax, "the model could not be solved")
    entries = [entry("truth", **broad)] if np.isfinite(numbers.truth).any() else []
    entries += [entry("model", **look)] if np.isfinite(numbers.model).any() else []
    entries += [entry("model beyond the training", **faint)] if np.isfinite(numbers.beyond[1:]).any() else []
    entries.append(entry("start", **start))
    legend_above(ax, entries, columns=4)
    ax.set_xlabel(label(numbers.states[0]))
    ax.set_ylabel(label(numbers.states[1]))
    return figure
