"""What a sweep says: one row a run, and medians, quartiles and failures over the seeds."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eigenode_cli.batch.plan import Sweep
from eigenode_cli.batch.state import State, read_state
from eigenode_cli.console import NOTHING, show_table, spread
from eigenode_cli.runs.atomic import write_table
from eigenode_cli.runs.reader import METRIC_COLUMNS
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import PAPER_TERMS
from eigenode_cli.training.ending import ENDED, FINISHED, UNSUCCESSFUL

RESULTS = ("sol", "dense_error", "max_real", "train_seconds")
"""What the table over the seeds shows of each group."""
MOST_FAILURES = 10
"""Failed runs that the terminal names; summary.csv has all."""


@dataclass(frozen=True)
class Row:
    """One run of a sweep.

    Attributes:
        name: its folder.
        settings: what makes it, key to value, as typed.
        state: how far it is.
        repeat: the command that repeats it by itself.
    """

    name: str
    settings: dict[str, str]
    state: State
    repeat: str

    def result(self, name: str) -> float:
        """Return a final number: a loss, `dense_error`, `max_real` or `train_seconds`; NaN where there is none."""
        value = self.state.record.get("train_seconds") if name == "train_seconds" else self._final.get(name)
        return math.nan if value is None else float(value)

    @property
    def _final(self) -> dict[str, Any]:
        return self.state.record.get("final", {})

    @property
    def failed(self) -> bool:
        """Whether the run failed, stalled or diverged, or ended with a field that cannot be solved."""
        solved = self._final.get("status", Status.OK.label) == Status.OK.label
        return self.state.status in UNSUCCESSFUL or not solved


@dataclass(frozen=True)
class Group:
    """The runs that differ in the seed alone."""

    settings: dict[str, str]
    rows: tuple[Row, ...]

    @property
    def label(self) -> str:
        """Its settings in one line."""
        return " ".join(f"{key}={value}" for key, value in self.settings.items()) or "all runs"

    @property
    def ended(self) -> int:
        """Number of runs that nobody works on any more."""
        return sum(row.state.status in ENDED for row in self.rows)

    @property
    def failures(self) -> int:
        """Number of runs that failed, stalled, diverged or ended unsolvable."""
        return sum(row.failed for row in self.rows)

    def values(self, name: str) -> np.ndarray:
        """Return a final number of every finished run that has it `(R,)`."""
        finished = [row.result(name) for row in self.rows if row.state.status == FINISHED]
        return np.array([value for value in finished if math.isfinite(value)])

    def quartiles(self, name: str) -> tuple[float, float, float]:
        """Lower quartile, median and upper quartile of a final number; NaN without a run that has it."""
        values = self.values(name)
        if values.size == 0:
            return (math.nan, math.nan, math.nan)
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        return (float(low), float(middle), float(high))


def read_rows(sweep: Sweep) -> list[Row]:
    """All runs of a sweep as their folders show them now."""
    return [
        Row(
            job.name,
            dict(_setting(word) for word in job.overrides),
            read_state(sweep.place(job)),
            sweep.repeat(job),
        )
        for job in sweep.jobs
    ]


def _setting(word: str) -> tuple[str, str]:
    """Key and value of an override, without what only Hydra's grammar needs."""
    key, _, value = word.lstrip("+").partition("=")
    return key, re.sub(r"\\(.)", r"\1", value)


def group(rows: Sequence[Row]) -> list[Group]:
    """Return the runs by everything but the seed, showing what differs between the groups."""
    keys = list(dict.fromkeys(key for row in rows for key in row.settings if key != "seed"))
    varying = [key for key in keys if len({row.settings.get(key) for row in rows}) > 1]
    groups: dict[tuple[str | None, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.settings.get(key) for key in varying), []).append(row)
    return [
        Group({key: value for key, value in zip(varying, values, strict=True) if value is not None}, tuple(members))
        for values, members in groups.items()
    ]


def write_summary(folder: Path, rows: Sequence[Row]) -> Path:
    """Write summary.csv: one row a run, with an empty cell for what is not there."""
    keys = list(dict.fromkeys(key for row in rows for key in row.settings))
    finals = [row.state.record.get("final", {}) for row in rows]
    known = {*METRIC_COLUMNS} - {"test_error"}
    own = list(dict.fromkeys(key for final in finals for key in final if key not in known))
    numbers = [*PAPER_TERMS, *own, "dense_error", "max_real", "train_seconds"]
    table = [
        [
            *(row.settings.get(key, "") for key in keys),
            row.state.status,
            *(row.result(name) for name in numbers),
            row.name,
            row.state.error,
        ]
        for row in rows
    ]
    path = folder / "summary.csv"
    write_table(path, [*keys, "status", *numbers, "folder", "error"], table)
    return path


def header(groups: Sequence[Group]) -> list[str]:
    """Columns of the table over the seeds."""
    keys = dict.fromkeys(key for group in groups for key in group.settings)
    return [*keys, "runs", "failed", *(name.replace("_", " ") for name in RESULTS)]


def cells(group: Group, keys: Iterable[str]) -> list[str]:
    """One row of the table over the seeds: median [lower quartile, upper quartile] of each number."""
    ended = f"{group.ended}" if group.ended == len(group.rows) else f"{group.ended} of {len(group.rows)}"
    return [
        *(group.settings.get(key, NOTHING) for key in keys),
        ended,
        str(group.failures),
        *(spread(*group.quartiles(name)) for name in RESULTS),
    ]


def show_groups(groups: Sequence[Group]) -> None:
    """Print the table over the seeds."""
    names = header(groups)
    rows = [cells(one, names[: -len(RESULTS) - 2]) for one in groups]
    show_table(names, rows, "median [quartiles] of the finished runs", right=("runs", "failed"))


def failure_lines(rows: Sequence[Row]) -> list[str]:
    """Which runs failed, why, and how to repeat each."""
    failed = [row for row in rows if row.state.status in UNSUCCESSFUL]
    if not failed:
        return []
    lines = [f"{len(failed)} of {len(rows)} runs failed"]
    for row in failed[:MOST_FAILURES]:
        lines += [f"  {row.name}: {row.state.error}", f"    repeat it with: {row.repeat}"]
    if len(failed) > MOST_FAILURES:
        lines.append(f"  {len(failed) - MOST_FAILURES} more in summary.csv")
    return lines
