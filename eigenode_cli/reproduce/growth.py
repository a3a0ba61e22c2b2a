"""The journal's cost study: time of a loss Jacobian over the number of states, of SOL alone and of SOL with FRQ.

A black-box network 2n -> 32 -> 2n; the times are fitted by a power law of n. Nothing is trained: the compiled engine
is timed at made-up weights, at which the field oscillates with as many pairs as it can hold.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eigenode_cli.bench.case import oscillating
from eigenode_cli.bench.growth import PowerLaw, fit_power
from eigenode_cli.console import number
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.reproduce.post_training import fastest
from eigenode_cli.runs.atomic import write_json

PAIRS = (1, 2, 3, 5, 7, 10, 14, 20, 30, 40, 50)
"""Pairs of states n."""
HIDDEN = (32,)
POINTS = (21, 41)
"""Data times, with a spectrum at each."""
GRADS = ("sol", "sol+frq")
HORIZON = 5.0
"""In s."""


@dataclass(frozen=True)
class Series:
    """Seconds of one loss Jacobian for every n of `PAIRS`, and their fit a n^b."""

    grads: str
    points: int
    seconds: tuple[float, ...]

    @property
    def fit(self) -> PowerLaw:
        """Power law through all points."""
        return fit_power(np.array(PAIRS, dtype=np.float64), np.array(self.seconds))


def measure_growth(path: Path) -> list[Series]:
    """Return the times, measured once and kept in the JSON file `path`."""
    if not path.is_file():
        listed = []
        for points in POINTS:
            columns: list[list[float]] = []
            for n in PAIRS:
                cases = [oscillating(2 * n, HIDDEN, HORIZON, points, tuple(grads.split("+"))) for grads in GRADS]
                columns.append(_seconds([(CompiledEngine(c.shape, c.problem), c.theta) for c in cases]))
            listed += [
                {"grads": grads, "points": points, "seconds": [column[i] for column in columns]}
                for i, grads in enumerate(GRADS)
            ]
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, {"pairs": list(PAIRS), "series": listed})
    content = json.loads(path.read_text(encoding="utf-8"))
    return [Series(one["grads"], one["points"], tuple(one["seconds"])) for one in content["series"]]


def _seconds(parts: Sequence[tuple[CompiledEngine, np.ndarray]]) -> list[float]:
    """Time of one loss Jacobian of each engine in s, measured in turns."""
    return fastest(*[lambda engine=engine, theta=theta: engine.loss_jacobian(theta) for engine, theta in parts])


@dataclass(frozen=True)
class GrowthTable:
    """The study as a table: milliseconds over n, the ratio of both gradients to one, and the fits in the last row."""

    series: Sequence[Series]
    title: str

    @property
    def header(self) -> tuple[str, ...]:
        """Titles of the columns."""
        times = [f"{one.grads}, {one.points} points, ms" for one in self.series]
        return ("pairs of states n", *times, *(f"ratio, {points} points" for points in POINTS))

    @property
    def cells(self) -> list[list[float | int | str]]:
        """Rows of n, times in ms and ratios."""
        rows: list[list[float | int | str]] = []
        for i, n in enumerate(PAIRS):
            times = [1e3 * one.seconds[i] for one in self.series]
            ratios = [self._of("sol+frq", points)[i] / self._of("sol", points)[i] for points in POINTS]
            rows.append([n, *times, *ratios])
        return rows

    def _of(self, grads: str, points: int) -> tuple[float, ...]:
        return next(one.seconds for one in self.series if (one.grads, one.points) == (grads, points))

    @property
    def rows(self) -> list[list[str]]:
        """The table as text."""
        texts = [[str(row[0]), *(number(float(value)) for value in row[1:])] for row in self.cells]
        fits = [f"{1e3 * one.fit.a:.3g} n^{one.fit.b:.2f}" for one in self.series]
        return [*texts, ["fit", *fits, *[""] * len(POINTS)]]
