"""The table of runs: how well each run of an experiment ended, median and quartiles over the seeds, and its time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.console import number, show_table, spread
from eigenode_cli.reproduce.journal import quartiles
from eigenode_cli.reproduce.measures import Result
from eigenode_cli.reproduce.study import Study
from eigenode_cli.runs.atomic import write_table

HEADER = ("run", "dense error", "% of amplitude", "SOL", "largest real part", "failures", "seeds", "time")
COLUMNS = (
    "experiment",
    "run",
    *(f"{what}_{q}" for what in ("dense_error", "sol", "max_real") for q in ("q25", "median", "q75")),
    "relative_error_median",
    "failures",
    "seeds",
    "time_ratio",
)
"""Columns of runs.csv."""


@dataclass(frozen=True)
class RunRow:
    """How one run ended.

    Attributes:
        name: of the run.
        dense_error, sol, max_real: lower quartile, median, upper quartile; NaN where no seed gave a number.
        relative_error: median of the dense error over the amplitude of the truth.
        failures, seeds: how many seeds failed or have no dense error, of how many.
        seconds: training time in s of the fastest seed, the others were disturbed; NaN where no seed finished.
    """

    name: str
    dense_error: tuple[float, float, float]
    sol: tuple[float, float, float]
    max_real: tuple[float, float, float]
    relative_error: float
    failures: int
    seeds: int
    seconds: float


@dataclass(frozen=True)
class RunTable:
    """All runs of one experiment, in its order."""

    title: str
    runs: tuple[RunRow, ...]

    @property
    def header(self) -> tuple[str, ...]:
        """Titles of the columns."""
        return HEADER

    @property
    def rows(self) -> list[list[str]]:
        """The table as text."""
        return [
            [
                run.name,
                spread(*run.dense_error),
                number(100.0 * run.relative_error),
                spread(*run.sol),
                spread(*run.max_real),
                str(run.failures),
                str(run.seeds),
                number(run.seconds / self.runs[0].seconds),
            ]
            for run in self.runs
        ]

    @property
    def cells(self) -> list[list[float | int | str]]:
        """The table with all digits, in the order of `COLUMNS` but for the experiment."""
        return [
            [
                run.name,
                *run.dense_error,
                *run.sol,
                *run.max_real,
                run.relative_error,
                run.failures,
                run.seeds,
                run.seconds / self.runs[0].seconds,
            ]
            for run in self.runs
        ]


def run_tables(study: Study) -> dict[str, RunTable]:
    """Return the table of every experiment that has runs, by its name."""
    return {
        name: RunTable(study.experiments[name].title, tuple(_row(label, listed) for label, listed in runs.items()))
        for name, runs in study.results.items()
        if runs
    }


def _row(name: str, results: Sequence[Result]) -> RunRow:
    finished = [result for result in results if result.finished]

    def last(values: Sequence[Floats]) -> Floats:
        return np.array([column[-1] for column in values])

    dense = last([result.metrics.dense_error for result in finished])
    amplitudes = np.array([result.amplitude for result in finished])
    return RunRow(
        name=name,
        dense_error=quartiles(dense),
        sol=quartiles(last([result.metrics.terms["sol"] for result in finished])),
        max_real=quartiles(last([result.metrics.max_real for result in finished])),
        relative_error=quartiles(dense / amplitudes)[1],
        failures=len(results) - int(sum(np.isfinite(d) and not r.failed for d, r in zip(dense, finished, strict=True))),
        seeds=len(results),
        seconds=float(np.nan if not finished else min(result.metrics.train_seconds[-1] for result in finished)),
    )


def print_runs(tables: Mapping[str, RunTable]) -> None:
    """Print one table an experiment."""
    for name, table in tables.items():
        show_table(HEADER, table.rows, f"{table.title} ({name})")


def write_runs(folder: Path, tables: Mapping[str, RunTable]) -> None:
    """Write runs.csv."""
    rows = [[name, *cells] for name, table in tables.items() for cells in table.cells]
    write_table(folder / "runs.csv", COLUMNS, rows)
