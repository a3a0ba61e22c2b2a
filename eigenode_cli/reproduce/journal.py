"""The journal's tables: quartiles in training and test, hit step, times and solver steps of the trained model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reproduce.measures import TEST_FILE, Result
from eigenode_cli.reproduce.study import Study
from eigenode_cli.reproduce.tables import reached
from eigenode_cli.reproduce.verdicts import quantile
from eigenode_cli.runs.atomic import write_table, write_text
from eigenode_cli.runs.paths import OUTPUTS

if TYPE_CHECKING:
    from eigenode_cli.reproduce.growth import GrowthTable

GROWTH_FILE = OUTPUTS / "reproduce" / "growth.json"
"""Where the times of the cost study are kept; they depend on no protocol."""

HEADER = (
    "run",
    "SOL P25",
    "SOL median",
    "SOL P75",
    "hit step",
    "test P25",
    "test median",
    "test P75",
    "simulation ms",
    "gradient ms",
    "accepted",
    "rejected",
    "failures",
)


@dataclass(frozen=True)
class JournalTable:
    """A table of one experiment: numbers `(runs, columns - 1)` beside the names of the runs."""

    title: str
    names: tuple[str, ...]
    numbers: Floats

    @property
    def header(self) -> tuple[str, ...]:
        """Titles of the columns."""
        return HEADER

    @property
    def cells(self) -> list[list[float | int | str]]:
        """The table with all digits."""
        return [[name, *row] for name, row in zip(self.names, self.numbers.tolist(), strict=True)]

    @property
    def rows(self) -> list[list[str]]:
        """The table as text."""
        return [[name, *map(reached, row)] for name, row in zip(self.names, self.numbers.tolist(), strict=True)]


def journal_table(study: Study, name: str) -> JournalTable:
    """Return the table of one experiment.

    *hit* is the first recorded step at which the median SOL of a run is below the final median of `sol` alone, the
    run of that name; times are the medians over the seeds of the fastest of many calls, of a simulation with its
    spectra and terms and of the loss Jacobian.
    """
    results = study.results[name]
    reference = results.get("sol")
    level = float("nan") if reference is None else quartiles(final_sol(reference))[1]
    rows = [_row(listed, level) for listed in results.values()]
    return JournalTable(study.experiments[name].title, tuple(results), np.array(rows))


def _row(results: Sequence[Result], level: float) -> list[float]:
    finished = [result for result in results if result.finished]
    tests = [result.extra(TEST_FILE) for result in finished]

    def middle(key: str, factor: float = 1.0) -> float:
        return factor * quartiles(np.array([test[key] for test in tests]))[1]

    train = final_sol(results)
    test_sol = np.array([test.get("test_sol", np.nan) for test in tests])
    undefined = np.isnan(train).astype(int) + np.isnan(test_sol)
    failures = sum(result.failed for result in results)
    failures += int(sum(count for count, result in zip(undefined, finished, strict=True) if not result.failed))
    return [
        *quartiles(train),
        hit_step(finished, level),
        *quartiles(test_sol),
        middle("simulation_seconds", 1e3),
        middle("gradient_seconds", 1e3),
        middle("accepted"),
        middle("rejected"),
        failures,
    ]


def final_sol(results: Sequence[Result]) -> Floats:
    """Return the last SOL of every finished run."""
    return np.array([result.metrics.terms["sol"][-1] for result in results if result.finished])


def quartiles(values: Floats) -> tuple[float, float, float]:
    """Lower quartile, median, upper quartile of what is known; NaN where nothing is."""
    known = values[~np.isnan(values)]
    if not known.size:
        return float("nan"), float("nan"), float("nan")
    return quantile(known, 0.25), quantile(known, 0.5), quantile(known, 0.75)


def hit_step(results: Sequence[Result], level: float) -> float:
    """First recorded step at which the median SOL is below `level`; infinite if there is none."""
    if not results:
        return float("nan")
    curves = np.vstack([result.metrics.terms["sol"] for result in results])
    curves = np.where(np.isnan(curves), np.inf, curves)
    below = np.flatnonzero([quantile(column, 0.5) < level for column in curves.T])
    return float(results[0].metrics.step[below[0]]) if below.size else float("inf")


def tables_of(study: Study, name: str) -> "list[JournalTable | GrowthTable]":
    """Return the tables that an experiment asks for."""
    experiment = study.experiments[name]
    tables: list[JournalTable | GrowthTable] = [journal_table(study, name)] if experiment.table else []
    if experiment.growth:
        from eigenode_cli.reproduce import growth  # noqa: PLC0415  # torch and Numba

        tables.append(growth.GrowthTable(growth.measure_growth(GROWTH_FILE), experiment.title))
    return tables


def write_tables(study: Study, folder: Path) -> list[Path]:
    """Write the tables of a study, one CSV file each and all of them as Markdown, and give their paths."""
    listed = {name: tables_of(study, name) for name in study.experiments}
    if not any(listed.values()):
        return []
    paths = []
    lines = [f"# Tables under protocol={study.protocol}, seeds 0 to {study.repetitions - 1}", "", NOTE]
    for name, tables in listed.items():
        for table in tables:
            paths.append(folder / f"table_{name}.csv")
            write_table(paths[-1], table.header, table.cells)
            lines += ["", f"## {table.title}", "", _line(table.header), _line(["---"] * len(table.header))]
            lines += [_line(row) for row in table.rows]
    paths.append(folder / "tables.md")
    write_text(paths[-1], "\n".join(lines) + "\n")
    return paths


NOTE = (
    "SOL at the end of the training; the test starts at the state of the last data point and has the same horizon."
    " A hit is the first recorded step at which the median SOL is below the final median of `sol` alone. Simulation"
    " (with spectra and terms) and gradient (the whole loss Jacobian) are the fastest of many calls of the trained"
    " model, medians over the seeds."
)


def _line(texts: Sequence[str]) -> str:
    return "| " + " | ".join(texts) + " |"
