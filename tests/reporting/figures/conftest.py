"""Runs that never were, one of each kind, written once and never changed by a test."""

from collections.abc import Callable
from pathlib import Path

import pytest

from eigenode_cli.runs.reader import Run, read_run
from tests import fake_run

WRITERS: dict[str, Callable[[Path], Path]] = {
    "oscillator": fake_run.write_oscillator,
    "van_der_pol": fake_run.write_van_der_pol,
    "two_mass": fake_run.write_two_mass,
    "unsolvable": fake_run.write_unsolvable,
    "single_record": fake_run.write_single_record,
}


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    """All of them by name."""
    base = tmp_path_factory.mktemp("runs")
    return {name: read_run(write(base / name)) for name, write in WRITERS.items()}


@pytest.fixture(params=WRITERS)
def run(request: pytest.FixtureRequest, runs: dict[str, Run]) -> Run:
    """Each of them in turn."""
    return runs[request.param]
