"""The verdict table: on the console, as Markdown (with the table of runs), CSV and JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from eigenode_cli.console import counted, number, show_table
from eigenode_cli.reproduce.verdicts import FAILS, HOLDS, MIXED, UNDEFINED, Verdict
from eigenode_cli.runs.atomic import write_json, write_table, write_text

HEADER = ("claim", "place", "expected", "found (quartiles)", "seeds", "failures", "verdict")
RUNS_NOTE = (
    "Runs are shown as they end: medians over the seeds with quartiles in brackets; failures are seeds without a"
    " number. The largest real part of any eigenvalue along the trajectory is in 1/s. Time is the training time of the"
    " fastest seed as a ratio to the first run of the table; it belongs to the machine."
)


class TextTable(Protocol):
    """A table as text."""

    @property
    def header(self) -> tuple[str, ...]:
        """Titles of the columns."""
        ...

    @property
    def rows(self) -> list[list[str]]:
        """Cells of every row."""
        ...


@dataclass(frozen=True)
class Summary:
    """What a table is about: protocol, repetitions, and the title of every experiment by its name."""

    protocol: str
    repetitions: int
    titles: dict[str, str]
    command: str


def reached(value: float | None) -> str:
    """Return a number, or `never` for a step that was not reached."""
    return "never" if value is not None and math.isinf(value) else number(value)


def found(verdict: Verdict) -> str:
    """Median with quartiles in brackets, the number alone where there is no spread."""
    if verdict.median is None or verdict.q25 == verdict.q75:
        return reached(verdict.median)
    return f"{reached(verdict.median)} [{reached(verdict.q25)}, {reached(verdict.q75)}]"


def cells(verdict: Verdict) -> tuple[str, ...]:
    """Return a row of the table as text, in the order of `HEADER`."""
    return (
        verdict.sentence,
        verdict.place,
        verdict.expected,
        found(verdict),
        f"{verdict.kept} of {verdict.seeds}",
        str(verdict.failures),
        verdict.verdict,
    )


def counts(verdicts: Sequence[Verdict]) -> str:
    """How many claims hold, are mixed, fail."""
    listed = [verdict.verdict for verdict in verdicts]
    parts = [f"{listed.count(name)} {name}" for name in (HOLDS, MIXED, FAILS, UNDEFINED) if name in listed]
    if not listed:
        return "no claims"
    return f"{counted(len(listed), 'claim')}: {', '.join(parts)}"


def print_verdicts(verdicts: Sequence[Verdict], summary: Summary) -> None:
    """Print one table an experiment, then the counts."""
    for name, title in summary.titles.items():
        rows = [cells(verdict) for verdict in verdicts if verdict.experiment == name]
        if rows:
            show_table((HEADER[-1], *HEADER[:-1]), [(row[-1], *row[:-1]) for row in rows], f"{title} ({name})")
    print(f"\nprotocol {summary.protocol}, {counted(summary.repetitions, 'seed')}, {counts(verdicts)}")


def write_verdicts(folder: Path, verdicts: Sequence[Verdict], summary: Summary, runs: Mapping[str, TextTable]) -> None:
    """Write verdicts.md, with the table of `runs` of every experiment, verdicts.csv and verdicts.json."""
    write_text(folder / "verdicts.md", markdown(verdicts, summary, runs))
    numbers = ("low", "q25", "median", "q75", "high")
    columns = ("experiment", "claim", "sentence", "place", "expected", *numbers, "kept", "seeds", "failures", "verdict")
    rows = [[_cell(getattr(verdict, column)) for column in columns] for verdict in verdicts]
    write_table(folder / "verdicts.csv", columns, rows)
    content = {
        "protocol": summary.protocol,
        "repetitions": summary.repetitions,
        "command": summary.command,
        "claims": [verdict.as_json() for verdict in verdicts],
    }
    write_json(folder / "verdicts.json", content)


def _cell(value: float | int | str | None) -> float | int | str:
    if value is None:
        return ""
    return "inf" if isinstance(value, float) and math.isinf(value) else value


def markdown(verdicts: Sequence[Verdict], summary: Summary, runs: Mapping[str, TextTable]) -> str:
    """Claims and runs as Markdown, one section an experiment."""
    lines = [
        f"# Claims under protocol={summary.protocol}, {counted(summary.repetitions, 'seed')}",
        "",
        f"{counts(verdicts)}. Made by `{summary.command}`.",
        "",
        "A claim holds if at least 80 % of the seeds show it, fails if at most 20 % do, and is mixed between; where the"
        " median is expected, the median decides. Numbers found are medians over the seeds with quartiles in brackets.",
        "",
        RUNS_NOTE,
    ]
    for name, title in summary.titles.items():
        rows = [verdict for verdict in verdicts if verdict.experiment == name]
        if rows or name in runs:
            lines += ["", f"## {title} (`{name}`)"]
        if rows:
            lines += ["", _row(HEADER), _row(["---"] * len(HEADER))]
            lines += [_row([*cells(verdict)[:-1], f"**{verdict.verdict}**"]) for verdict in rows]
        if name in runs:
            header = runs[name].header
            lines += ["", _row(header), _row(["---"] * len(header)), *map(_row, runs[name].rows)]
    return "\n".join(lines) + "\n"


def _row(texts: Sequence[str]) -> str:
    return "| " + " | ".join(text.replace("|", r"\|") for text in texts) + " |"
