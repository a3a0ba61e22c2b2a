"""Stability: the largest real part over the training steps, as in the paper's Fig. 4 and 7."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reporting.figures.style import (
    BORDER_LOOK,
    MODEL,
    UNSTABLE,
    Scale,
    apply_scale,
    choose_scale,
    draw_line,
    entry,
    failed_entry,
    frame,
    legend_above,
    mark_failed,
    new_figure,
    note,
    set_limits,
    shade_unstable,
    short,
    step_axis,
    warn,
)
from eigenode_cli.runs.reader import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Stability:
    """What the figure shows.

    Attributes:
        step: training steps of the records `(R,)`.
        max_real: largest real part along the trajectory in 1/s `(R,)`, NaN where not defined.
        final: the last of them.
        failed: steps of the records whose solve failed `(F,)`.
        scale: of the vertical axis.
    """

    step: Floats
    max_real: Floats
    final: float
    failed: Floats
    scale: Scale


def stability_numbers(run: Run) -> Stability:
    """Return what the figure shows; its scale keeps the second half readable beside a wild start."""
    metrics = run.metrics
    values = np.where(np.isfinite(metrics.max_real), metrics.max_real, np.nan)
    late = np.abs(values[values.size // 2 :])
    return Stability(
        step=metrics.step,
        max_real=values,
        final=float(values[-1]),
        failed=metrics.step[metrics.failed],
        scale=choose_scale(values, float(np.nanmedian(late)) if np.isfinite(late).any() else 0.0),
    )


def draw_stability(numbers: Stability) -> "Figure":
    """Return the figure."""
    figure = new_figure()
    ax = figure.subplots()
    look = {"color": MODEL, "lw": 1.6}
    draw_line(ax, numbers.step, numbers.max_real, zorder=3, **look)
    low, high = frame(np.append(numbers.max_real, 0.0))
    apply_scale(ax, "y", numbers.scale)
    set_limits(ax, "y", (low, high), numbers.scale, room=0.12)
    shade_unstable(ax, "y")
    mark_failed(ax, numbers.failed)
    if not np.isfinite(numbers.max_real).any():
        warn(ax, "no spectrum was recorded")
    note(ax, 0.985, 0.97, "unstable", UNSTABLE)
    entries = [
        entry(rf"largest real part $\lambda_w$  {short(numbers.final)}", **look),
        entry("border of stability", **BORDER_LOOK),
    ]
    if numbers.failed.size:
        entries.append(failed_entry(numbers.failed.size, numbers.step.size))
    legend_above(ax, entries, columns=2)
    step_axis(ax, numbers.step)
    ax.set_ylabel(r"$\max\,\mathrm{Re}\,\lambda$ in 1/s")
    return figure
