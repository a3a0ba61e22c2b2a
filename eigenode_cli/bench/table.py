"""bench.json for people, as tables."""

from collections.abc import Sequence
from typing import Any

from eigenode_cli.bench.run import disagreements
from eigenode_cli.console import number, show_table

Rows = list[list[str]]


def quartiles(ratio: dict[str, Any]) -> str:
    """Median with quartiles."""
    return f"{number(ratio['median'])} ({number(ratio['low'])} to {number(ratio['high'])})"


def ratio_rows(content: dict[str, Any]) -> Rows:
    """Case, contestant, time over ours, what it ran."""
    return [
        [name, peer, quartiles(ratio), case["details"][peer]]
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
    """Return what was promised, what was found."""
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
    tables: list[tuple[Sequence[str], Rows]] = [
        (("case", "contestant", "time over ours", "what it ran"), ratio_rows(content)),
        (("curve", "contestant", "exponent", "time over ours, first to last"), growth_rows(content)),
        (("promise", "found", "must", "aim", ""), goal_rows(content)),
    ]
    for header, rows in tables:
        if rows:
            show_table(header, rows)
            print()
    for name, packages in content["missing"].items():
        print(f"{name} is not measured: no {' and no '.join(packages)}; pip install 'eigenode[bench]'")
    for line in disagreements(content):
        print(line)
