"""`eigenode` as a process of its own, and what its sweeps leave behind."""

import contextlib
import csv
import io
import json
import subprocess
import sys
from pathlib import Path

from eigenode_cli.cli import main

BASIC = "hydra/launcher=basic"
"""Runs a sweep one after the other in this process."""
SHORT = ("system=oscillator", "trainer.steps=20", "trainer.record_every=10")
"""Settings of runs that take a tenth of a second."""


def start(folder: Path, *words: str) -> "subprocess.Popen[str]":
    """`eigenode WORDS` in `folder`, a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "eigenode_cli", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def eigenode(folder: Path, *words: str) -> tuple[int, str, str]:
    """Exit status, output and errors of `eigenode WORDS`."""
    process = start(folder, *words)
    out, err = process.communicate(timeout=600)
    return process.returncode, out, err


def inside(folder: Path, *words: str) -> tuple[int, str, str]:
    """The same within this process, which saves seconds of imports."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    return status, out.getvalue(), err.getvalue()


def rows(sweep: Path) -> list[dict[str, str]]:
    """summary.csv."""
    with (sweep / "summary.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def runs(sweep: Path) -> dict[str, Path]:
    """Folders of the runs by name."""
    return {path.parent.name: path.parent for path in sorted(sweep.glob("*/run.json"))}


def without_time(run: Path) -> list[list[str]]:
    """metrics.csv but for the time."""
    lines = (run / "metrics.csv").read_text().splitlines()
    return [cells[:1] + cells[2:] for cells in (line.split(",") for line in lines)]


def assert_equal_sweeps(one: Path, other: Path) -> None:
    """The same runs, each finished, with the same numbers."""
    assert runs(one).keys() == runs(other).keys()
    for name, run in runs(one).items():
        twin = runs(other)[name]
        assert json.loads((run / "run.json").read_text())["status"] == "finished"
        assert json.loads((twin / "run.json").read_text())["status"] == "finished"
        assert without_time(run) == without_time(twin), name
        for table in ("solution.csv", "eigenvalues.csv"):
            assert (run / table).read_bytes() == (twin / table).read_bytes(), name
