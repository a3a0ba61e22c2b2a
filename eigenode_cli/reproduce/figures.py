"""The published figures: one curve a combination, the median of all seeds with its quartile band.

As for the figures of one run: one function from recorded files to the numbers shown, which become a CSV file, and one
from those numbers to a drawing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reporting.figures.convergence import tenth_of_average
from eigenode_cli.reporting.figures.plateaus import plateaus
from eigenode_cli.reporting.figures.solution import DATA_LOOK, reach
from eigenode_cli.reporting.figures.style import (
    BORDER_LOOK,
    TRUTH,
    UNSTABLE,
    Scale,
    apply_scale,
    choose_scale,
    draw_line,
    entry,
    frame,
    house_style,
    label,
    legend_above,
    new_figure,
    note,
    save,
    set_limits,
    shade_unstable,
    short,
    step_axis,
    to_svg,
    warn,
)
from eigenode_cli.reproduce.measures import TEST_FILE, Result
from eigenode_cli.reproduce.schema import Experiment, FigureSpec
from eigenode_cli.reproduce.study import Study
from eigenode_cli.reproduce.verdicts import quantile
from eigenode_cli.runs.atomic import write_table
from eigenode_cli.systems.base import State
from eigenode_cli.terms import NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

COLORS = ("#0072B2", "#009E73", "#56B4E9", "#CC79A7", "#E69F00", "#D55E00", "#5B5B5B", "#9A8A00")
"""One colour a run, in the order of the experiment: the palette of Okabe & Ito, then two quiet ones."""
BAND = 0.16
"""Opacity of a quartile band."""
NEAR = 1.3
"""Levels within this factor of each other are drawn as one local minimum."""
LEGEND_COLUMNS = 2
ROW_HEIGHT = 0.17
"""Height of a row of the legend in inches."""


@dataclass(frozen=True)
class Curve:
    """One run of a figure.

    Attributes:
        name: of the run.
        color: its colour in all figures of the experiment.
        y: what is drawn `(D,)`; NaN where there is none.
        low, high: quartile band `(D,)`, None where one seed is shown.
        seeds: how many seeds it stands for, and how many of them failed.
    """

    name: str
    color: str
    y: Floats
    low: Floats | None
    high: Floats | None
    seeds: int
    failed: int


@dataclass(frozen=True)
class Numbers:
    """What a figure shows.

    Attributes:
        kind: solution | convergence | stability.
        x: times in s or training steps `(D,)`.
        curves: in the order of the legend.
        truth: the truth's x1 `(D,)` of a solution.
        data: data times and values `(2, N)` of a solution.
        horizon: end of the training horizon in s, where the figure goes beyond it.
        minima: levels of the local minima of a convergence.
        state: x1.
    """

    kind: str
    x: Floats
    curves: tuple[Curve, ...]
    truth: Floats | None
    data: Floats | None
    horizon: float | None
    minima: tuple[float, ...]
    state: State


def figure_numbers(experiment: Experiment, spec: FigureSpec, results: Mapping[str, Sequence[Result]]) -> Numbers | None:
    """Return the numbers of a figure, None where no run of it was finished."""
    shown = spec.runs or list(experiment.runs)
    colors = {name: COLORS[i % len(COLORS)] for i, name in enumerate(experiment.runs)}
    finished = {name: [result for result in results[name] if result.finished] for name in shown}
    some = next((result for name in shown for result in finished[name]), None)
    if some is None:
        return None
    if spec.kind == "solution":
        return _solution_numbers(finished, colors, results, spec)
    steps = np.unique(np.concatenate([result.metrics.step for listed in finished.values() for result in listed]))
    values = {name: [_curve_of(result, spec.kind, steps) for result in listed] for name, listed in finished.items()}
    curves = []
    for name in shown:
        if finished[name]:
            low, middle, high = _band(np.vstack(values[name]))
            several = len(values[name]) > 1
            failed = sum(result.failed for result in results[name])
            curves.append(
                Curve(
                    name,
                    colors[name],
                    middle,
                    low if several else None,
                    high if several else None,
                    len(values[name]),
                    failed,
                )
            )
    minima = _minima(steps, curves, some) if spec.kind == "convergence" else ()
    return Numbers(spec.kind, steps, tuple(curves), None, None, None, minima, some.run.states[0])


def _curve_of(result: Result, kind: str, steps: Floats) -> Floats:
    """Return what a convergence or a stability shows of one training, at all of `steps`: NaN where it has no record."""
    metrics, curve = result.metrics, np.full(steps.size, np.nan)
    curve[np.searchsorted(steps, metrics.step)] = metrics.terms["sol"] if kind == "convergence" else metrics.max_real
    return curve


def _band(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Lower quartile, median and upper quartile `(R,)` of `values (S, R)`; a failed solve counts as infinite."""
    ordered = np.where(np.isfinite(values), values, np.inf)
    rows = [np.array([quantile(column, q) for column in ordered.T]) for q in (0.25, 0.5, 0.75)]
    low, middle, high = (np.where(np.isfinite(row), row, np.nan) for row in rows)
    return low, middle, high


def _minima(steps: Floats, curves: Sequence[Curve], some: Result) -> tuple[float, ...]:
    """Levels at which the median of a run stood still; levels near each other are one."""
    error = some.run.config["error"]
    solved = tenth_of_average(some.run.data, str(error["sol"]), float(error["huber_delta"]))
    return merged([plateau.level for curve in curves for plateau in plateaus(steps, curve.y, solved)])


def merged(levels: Sequence[float]) -> tuple[float, ...]:
    """Return the levels, ascending, those within `NEAR` of the next replaced by their median."""
    groups: list[list[float]] = []
    for level in sorted(levels):
        if groups and level <= NEAR * groups[-1][-1]:
            groups[-1].append(level)
        else:
            groups.append([level])
    return tuple(float(np.median(group)) for group in groups)


def median_result(results: Sequence[Result], by: str) -> Result:
    """Return the result whose last `dense_error` (or `test_sol`) is nearest to the median, the first of equals."""
    errors = np.array([MEDIANS[by](result) for result in results])
    known = errors[np.isfinite(errors)]
    if not known.size:
        return results[0]
    distance = np.where(np.isfinite(errors), np.abs(errors - quantile(known, 0.5)), np.inf)
    return results[int(np.argmin(distance))]


MEDIANS: dict[str, Callable[[Result], float]] = {
    "dense_error": lambda result: float(result.metrics.dense_error[-1]),
    "test_sol": lambda result: result.extra(TEST_FILE).get("test_sol", float("nan")),
}
"""What `median_by` chooses from."""


def _solution_numbers(
    finished: Mapping[str, Sequence[Result]],
    colors: Mapping[str, str],
    results: Mapping[str, Sequence[Result]],
    spec: FigureSpec,
) -> Numbers:
    """Solutions of the median runs, over the training horizon or twice that."""
    chosen = {name: median_result(listed, spec.median_by) for name, listed in finished.items() if listed}
    some = next(iter(chosen.values()))
    times, inside = some.solution.times, ~some.solution.beyond
    part = np.ones(times.size, dtype=bool) if spec.twice else inside
    curves = tuple(
        Curve(
            name,
            colors[name],
            one.solution.model[part, 0],
            None,
            None,
            len(finished[name]),
            sum(result.failed for result in results[name]),
        )
        for name, one in chosen.items()
    )
    data = some.run.data
    seen = data.mask[:, 0]
    return Numbers(
        kind="solution",
        x=times[part],
        curves=curves,
        truth=some.solution.truth[part, 0],
        data=np.vstack([data.times[seen], data.values[seen, 0]]),
        horizon=float(times[inside][-1]) if spec.twice else None,
        minima=(),
        state=some.run.states[0],
    )


def write_numbers(path: Path, numbers: Numbers) -> None:
    """Write a figure's numbers as CSV: one row a time or step, three columns a run where there is a band."""
    header = ["t" if numbers.kind == "solution" else "step"]
    columns = [numbers.x]
    if numbers.truth is not None:
        header.append("truth")
        columns.append(numbers.truth)
    for curve in numbers.curves:
        header.append(curve.name)
        columns.append(curve.y)
        if curve.low is not None and curve.high is not None:
            header += [f"{curve.name} q25", f"{curve.name} q75"]
            columns += [curve.low, curve.high]
    write_table(path, header, np.column_stack(columns).tolist())


def draw(numbers: Numbers) -> "Figure":
    """Return the figure."""
    extra = len(numbers.curves) + 2 + len(numbers.minima[:1])
    figure = new_figure(3.1 + ROW_HEIGHT * -(-extra // LEGEND_COLUMNS))
    DRAWINGS[numbers.kind](figure, numbers)
    return figure


def title(name: str) -> str:
    """Return a run's name in the legend: SOL+STB as in the paper where it is its grads, else as it stands."""
    return name.upper() if all(part in NAMES for part in name.split("+")) else name


def _looks(numbers: Numbers) -> dict[str, dict[str, Any]]:
    return {curve.name: {"color": curve.color, "lw": 1.4} for curve in numbers.curves}


def _entries(numbers: Numbers) -> "list[Line2D]":
    """Legend entries of the runs, with the count of failures."""
    looks = _looks(numbers)
    return [
        entry(title(curve.name) + (f" ({curve.failed} failed)" if curve.failed else ""), **looks[curve.name])
        for curve in numbers.curves
    ]


def _draw_solution(figure: "Figure", numbers: Numbers) -> None:
    ax = figure.subplots()
    looks = _looks(numbers)
    for curve in numbers.curves:
        ax.plot(numbers.x, curve.y, zorder=3, **looks[curve.name])
    truth = numbers.x if numbers.truth is None else numbers.truth
    ax.plot(numbers.x, truth, zorder=5, **BORDER_LOOK)
    entries = [*_entries(numbers), entry("truth", **BORDER_LOOK)]
    if numbers.data is not None:
        ax.plot(*numbers.data, zorder=6, **DATA_LOOK)
        entries.append(entry("data", **DATA_LOOK))
    limits = reach(truth, np.concatenate([curve.y for curve in numbers.curves]))
    set_limits(ax, "y", limits, Scale(None), room=0.06)
    if numbers.horizon is not None:
        ax.axvline(numbers.horizon, color=TRUTH, lw=0.7, zorder=1)
        note(ax, 0.985, 0.97, "beyond the training horizon", TRUTH)
    ax.set_xlim(numbers.x[0], numbers.x[-1])
    ax.set_xlabel("$t$ in s")
    ax.set_ylabel(label(numbers.state))
    legend_above(ax, entries, LEGEND_COLUMNS)


def _draw_convergence(figure: "Figure", numbers: Numbers) -> None:
    ax = figure.subplots()
    _draw_curves(ax, numbers, positive=True)
    entries = _entries(numbers)
    for i, level in enumerate(numbers.minima):
        ax.axhline(level, zorder=5, **BORDER_LOOK)
        crowded = i + 1 < len(numbers.minima) and numbers.minima[i + 1] < 2.0 * level
        ax.annotate(
            short(level),
            (1.0, level),
            xycoords=ax.get_yaxis_transform(),
            xytext=(3, -2 if crowded else 2),
            textcoords="offset points",
            va="top" if crowded else "bottom",
            fontsize=9,
        )
    if numbers.minima:
        entries.append(entry("local minimum" if len(numbers.minima) == 1 else "local minima", **BORDER_LOOK))
    if any(np.isfinite(curve.y).any() for curve in numbers.curves):
        ax.set_yscale("log")
        ax.margins(y=0.06)
    else:
        warn(ax, "no loss above zero was recorded")
    step_axis(ax, numbers.x)
    ax.set_ylabel(r"$l_{\mathrm{SOL}}$" + (f" in {numbers.state.unit}" if numbers.state.unit else ""))
    legend_above(ax, entries, LEGEND_COLUMNS)


def _draw_stability(figure: "Figure", numbers: Numbers) -> None:
    ax = figure.subplots()
    everything = np.concatenate([line for c in numbers.curves for line in (c.y, c.low, c.high) if line is not None])
    late = np.abs(np.concatenate([curve.y[curve.y.size // 2 :] for curve in numbers.curves]))
    scale = choose_scale(everything, float(np.nanmedian(late)) if np.isfinite(late).any() else 0.0)
    _draw_curves(ax, numbers, positive=False)
    apply_scale(ax, "y", scale)
    set_limits(ax, "y", frame(np.append(everything, 0.0)), scale, room=0.1)
    shade_unstable(ax, "y")
    note(ax, 0.985, 0.97, "unstable", UNSTABLE)
    step_axis(ax, numbers.x)
    ax.set_ylabel(r"$\max\,\mathrm{Re}\,\lambda_w$ in 1/s")
    legend_above(ax, [*_entries(numbers), entry("border of stability", **BORDER_LOOK)], LEGEND_COLUMNS)


def _draw_curves(ax: "Axes", numbers: Numbers, positive: bool) -> None:
    """Every run's median and band; what a logarithmic axis cannot show is left out."""
    looks = _looks(numbers)
    for curve in numbers.curves:
        if curve.low is not None and curve.high is not None:
            band = [np.where(line > 0.0, line, np.nan) if positive else line for line in (curve.low, curve.high)]
            ax.fill_between(numbers.x, band[0], band[1], color=curve.color, alpha=BAND, lw=0, zorder=2)
        line = np.where(curve.y > 0.0, curve.y, np.nan) if positive else curve.y
        draw_line(ax, numbers.x, line, zorder=3, **looks[curve.name])


DRAWINGS = {"solution": _draw_solution, "convergence": _draw_convergence, "stability": _draw_stability}
"""How each kind of figure is drawn."""


def draw_all(study: Study, folder: Path) -> list[Path]:
    """Draw every figure of a study as .png and .pdf with its numbers as .csv beside, and give their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name, experiment in study.experiments.items():
        for spec in experiment.figures:
            numbers = figure_numbers(experiment, spec, study.results[name])
            if numbers is None:
                continue
            paths.append(folder / f"{spec.name}.csv")
            write_numbers(paths[-1], numbers)
            with house_style():
                figure = draw(numbers)
                for suffix in (".png", ".pdf"):
                    paths.append(folder / f"{spec.name}{suffix}")
                    save(figure, paths[-1])
    return paths


def svg(numbers: Numbers) -> bytes:
    """Return a figure as a self-contained SVG."""
    with house_style():
        return to_svg(draw(numbers))
