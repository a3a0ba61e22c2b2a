"""bench.json for people: tables on a terminal, plain lines in a pipe."""

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from eigenode_cli.bench.run import disagreements

Rows = list[list[str]]


def number(value: float) -> str:
    """Three significant digits, whole from a hundred on."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def spread(ratio: dict[str, Any]) -> str:
    """Median with quartiles."""
    return f"{number(ratio['median'])} ({number(ratio['low'])} to {number(ratio['high'])})"


def ratio_rows(content: dict[str, Any]) -> Rows:
    """Case, contestant, time over ours, what it ran."""
    return [
        [name, peer, spread(ratio), case["details"][peer]]
        for name, case in content["cases"].items()
        for peer, ratio in case["ratios"].items()
    ]


def growth_rows(content: dict[str, Any]) -> Rows:
    """Curve, contestant, exponent, ratios to ours at both ends."""
    rows: Rows = []
    for name, curve in content["growth"].items():
        for contestant, exponent in curve["exponents"].items():
            ratios = curve["ratios"].get(contestant)
            ends = "1" if ratios is None else f"{number(ratios[0]['median'])} to {number(ratios[-1]['median'])}"
            rows.append([name, contestant, f"{exponent:.2f}", ends])
    return rows


def goal_rows(content: dict[str, Any]) -> Rows:
    """What was promised, what was found."""
    return [
        [
            goal["what"],
            number(goal["value"]),
            f"{goal['bound']} {number(goal['must'])}",
            f"aim {number(goal['aim'])}",
            "holds" if goal["holds"] else "fails",
        ]
        for goal in content["goals"]
    ]


def show(content: dict[str, Any]) -> None:
    """Print all tables that have rows, then what is missing and who disagrees."""
    console = Console()
    tables: list[tuple[Sequence[str], Rows]] = [
        (("case", "contestant", "time over ours", "what it ran"), ratio_rows(content)),
        (("curve", "contestant", "exponent", "time over ours, first to last"), growth_rows(content)),
        (("promise", "found", "must", "aim", ""), goal_rows(content)),
    ]
    for header, rows in tables:
        if rows:
            _show_table(console, header, rows)
    for name, packages in content["missing"].items():
        print(f"{name} is not measured: no {' and no '.join(packages)}; pip install 'eigenode[bench]'")
    for line in disagreements(content):
        print(line)


def _show_table(console: Console, header: Sequence[str], rows: Rows) -> None:
    if console.is_terminal:
        table = Table(*header)
        for row in rows:
            table.add_row(*row)
        console.print(table)
        return
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    for row in (header, *rows):
        print("  ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip())
    print()
