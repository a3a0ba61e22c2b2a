"""The script that compares two checkouts tells what differs first."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "same_bytes.py"
SPEC = importlib.util.spec_from_file_location("same_bytes", SCRIPT)
assert SPEC is not None
assert SPEC.loader is not None
same_bytes = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(same_bytes)

HEADER = ["step", "sol", "status"]
ROWS = [["0", "0.5", "ok"], ["25", "0.25", "ok"]]


def test_columns_of_time_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "metrics.csv"
    file.write_text("step,train_seconds,sol,status\n0,0.1,0.5,ok\n25,0.3,0.25,ok\n")
    assert same_bytes.metrics(file) == [HEADER, *ROWS]
    assert same_bytes.metrics(tmp_path / "none.csv") == []


@pytest.mark.parametrize(
    ("after", "found"),
    [
        ([HEADER, *ROWS], None),
        ([HEADER, ROWS[0], ["25", "0.250", "ok"]], "different at step 25, sol: 0.25 before, 0.250 after"),
        ([HEADER, ROWS[0]], "2 rows before, 1 after"),
        ([[*HEADER, "own"], *([*row, "1"] for row in ROWS)], "different columns: ['own']"),
        ([], "no metrics.csv after"),
    ],
)
def test_the_first_difference(after: list[list[str]], found: str | None) -> None:
    assert same_bytes.difference([HEADER, *ROWS], after, shared=False) == found


def test_only_shared_columns() -> None:
    after = [["own", *HEADER], *(["1", *row] for row in ROWS)]
    assert same_bytes.difference([HEADER, *ROWS], after, shared=True) is None


def test_every_run_stands_once() -> None:
    assert len(set(same_bytes.RUNS)) == len(same_bytes.RUNS) == 48
    assert len(set(same_bytes.QUICK)) == len(same_bytes.QUICK) == 24
