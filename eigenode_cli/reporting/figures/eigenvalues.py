"""Eigenvalues in the complex plane: the model's along its trajectory and their targets."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.reporting.figures.style import (
    BORDER_LOOK,
    UNSTABLE,
    Scale,
    apply_scale,
    choose_scale,
    entry,
    frame,
    legend_above,
    new_figure,
    note,
    set_limits,
    shade_unstable,
    time_colormap,
    warn,
)
from eigenode_cli.runs.reader import Bools, Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EQUAL = 4.0
"""Largest ratio of the two spans at which both axes share one scale."""
UNSTABLE_SHARE = 0.15
"""Part of the figure, as a fraction of what it shows, that the unstable half has at least."""
MOVING = "#8A8A8A"
"""Colour of targets that move."""
CONSTANT = 1e-9
"""Relative spread below which the targets of a mode are one target."""


@dataclass(frozen=True)
class EigenvalueNumbers:
    """What the figure shows.

    Attributes:
        times: of the model's eigenvalues in s `(E,)`; `values` are those in 1/s, in the order of time.
        targets: in 1/s `(F,)`; `fixed` says which are the one target of a mode at all times.
        span: first and last time of the colours in s.
        real, imaginary: scales of the axes.
        equal: whether both axes share one scale.
    """

    times: Floats
    values: Complexes
    targets: Complexes
    fixed: Bools
    span: tuple[float, float]
    real: Scale
    imaginary: Scale
    equal: bool


def eigenvalue_numbers(run: Run) -> EigenvalueNumbers:
    """Return the numbers of the figure."""
    spectra = run.eigenvalues
    known = np.isfinite(spectra.values)
    order = np.argsort(spectra.times[known], kind="stable")
    targets, fixed = _distinct_targets(spectra.mode, spectra.targets)
    values = spectra.values[known][order]
    shown = np.concatenate([values, targets])
    real, imaginary = _scale(shown.real), _scale(shown.imag)
    return EigenvalueNumbers(
        times=spectra.times[known][order],
        values=values,
        targets=targets,
        fixed=fixed,
        span=(float(spectra.times.min()), float(spectra.times.max())),
        real=real,
        imaginary=imaginary,
        equal=real.linear and imaginary.linear and _similar(shown),
    )


def _distinct_targets(mode: NDArray[np.int64], targets: Complexes) -> tuple[Complexes, Bools]:
    """Targets, a mode whose target never moves reduced to one, and which are such ones."""
    kept: list[Complexes] = []
    fixed: list[bool] = []
    for number in np.unique(mode):
        own = targets[(mode == number) & np.isfinite(targets)]
        # the tracked member of a pair may change its sign
        for sign in (-1.0, 0.0, 1.0):
            group = own[np.sign(own.imag) == sign]
            still = group.size > 0 and np.ptp(group.real) + np.ptp(group.imag) <= CONSTANT * np.abs(group).max()
            kept.append(group[:1] if still else group)
            fixed += [still] * kept[-1].size
    return np.concatenate(kept), np.array(fixed, dtype=bool)


def _scale(parts: Floats) -> Scale:
    """Scale of one axis, on which the median modulus of the parts that are not zero stays readable."""
    size = np.abs(parts[parts != 0.0])
    return choose_scale(parts, float(np.median(size)) if size.size else 0.0)


def _similar(values: Complexes) -> bool:
    """Whether the spans of both parts are near enough for one scale, the border of stability included."""
    spans = [float(np.ptp(frame(np.append(part, 0.0)))) for part in (values.real, values.imag)]
    return min(spans) > 0.0 and max(spans) <= EQUAL * min(spans)


def draw_eigenvalues(numbers: EigenvalueNumbers) -> "Figure":
    """Return the figure."""
    figure = new_figure(3.9)
    ax = figure.subplots()
    colormap = time_colormap()
    low, high = numbers.span
    look: dict[str, Any] = {"cmap": colormap, "vmin": low, "vmax": high if high > low else low + 1.0}
    dots = ax.scatter(
        numbers.values.real, numbers.values.imag, c=numbers.times, s=16, lw=0.3, edgecolors="white", zorder=5, **look
    )
    bar = figure.colorbar(dots, ax=ax, pad=0.02, aspect=28)
    bar.set_label("$t$ in s")
    bar.outline.set_visible(False)
    _draw_targets(ax, numbers)
    _set_axes(ax, numbers)
    model = entry("model", marker="o", ms=4.5, mew=0, ls="none", color=colormap(0.45))
    entries = [model] if numbers.values.size else []
    if numbers.targets.size:
        color = "black" if numbers.fixed.any() else MOVING
        entries.append(entry("target", marker="o", ms=6.5, mew=1.0, mfc="none", ls="none", color=color))
    entries.append(entry("border of stability", **BORDER_LOOK))
    legend_above(ax, entries, columns=3)
    note(ax, 0.985, 0.98, "unstable", UNSTABLE)
    if numbers.values.size == 0:
        warn(ax, "the model could not be solved: no spectrum")
    ax.set_xlabel(r"$\mathrm{Re}\,\lambda$ in 1/s")
    ax.set_ylabel(r"$\mathrm{Im}\,\lambda$ in 1/s")
    return figure


def _draw_targets(ax: "Axes", numbers: EigenvalueNumbers) -> None:
    """Open rings: black and over the model where a mode has one target, grey and under it where it moves."""
    still, moving = numbers.targets[numbers.fixed], numbers.targets[~numbers.fixed]
    ax.scatter(moving.real, moving.imag, s=40, facecolors="none", edgecolors=MOVING, linewidths=0.7, zorder=3)
    ax.scatter(still.real, still.imag, s=52, facecolors="none", edgecolors="black", linewidths=1.2, zorder=6)


def _set_axes(ax: "Axes", numbers: EigenvalueNumbers) -> None:
    """Scales, limits, the real axis, and the unstable half with its border."""
    shown = np.concatenate([numbers.values, numbers.targets])
    if numbers.equal:
        # limits that are left free, so that the aspect may widen the shorter axis; both hold the origin
        ax.plot(UNSTABLE_SHARE * np.ptp(shown.real), 0.0, ls="none")
        ax.margins(0.12)
        ax.set_aspect("equal", adjustable="datalim")
    else:
        for axis, parts, scale in (("x", shown.real, numbers.real), ("y", shown.imag, numbers.imaginary)):
            apply_scale(ax, axis, scale)
            low, high = frame(np.append(parts, 0.0)) if parts.size else (-1.0, 1.0)
            if axis == "x":
                high = max(high, UNSTABLE_SHARE * (high - low) if scale.threshold is None else scale.threshold)
            set_limits(ax, axis, (low, high), scale, room=0.1)
    ax.axhline(0.0, color="#B0B0B0", lw=0.7, zorder=1)
    shade_unstable(ax, "x")
