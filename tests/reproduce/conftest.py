"""A small study that was really trained: two combinations of 20 steps, two seeds."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from eigenode_cli.reproduce.study import Study, examine, prepare, train

EXPERIMENT = """
title: A small study
protocols: [paper]
table: true
runs:
  sol: {system: oscillator, grads: sol, overrides: &short [trainer.steps=20, trainer.record_every=5]}
  sol+stb: {system: oscillator, grads: sol+stb, overrides: *short}
  again: {system: oscillator, grads: sol, overrides: *short}
figures:
  - {name: solutions, kind: solution, caption: Solutions., twice: true, median_by: test_sol}
  - {name: losses, kind: convergence, caption: Losses., runs: [sol+stb, sol]}
  - {name: real_parts, kind: stability, caption: Real parts.}
claims:
  - {name: size, claim: It has 129., place: Tab. 1, run: sol, measure: parameters, at_least: 129, at_most: 129}
  - {name: same, claim: It equals itself., place: here, run: sol, against: again, measure: sol, at_least: 1, at_most: 1}
  - {name: perfect, claim: "It <b>fits</b>.", place: nowhere, run: sol, measure: relative_error, at_most: 1.0e-9}
"""


def write_experiment(folder: Path, text: str = EXPERIMENT) -> str:
    """Write the experiment's file and give its path."""
    path = folder / "small.yaml"
    path.write_text(text)
    return str(path)


@pytest.fixture(scope="package")
def study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Study]:
    """Trained once, for all tests that only read it; they run in its folder."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        made = prepare([write_experiment(folder)], None, 2)
        train(made, jobs=1)
        examine(made, jobs=1)
        yield made


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
