"""The table of runs, and what an interrupted run does to its study."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.reproduce import study as way
from eigenode_cli.reproduce.runs import COLUMNS, HEADER, RunTable, run_tables, write_runs
from eigenode_cli.reproduce.study import Study


def test_numbers_are_those_of_the_records(study: Study, tmp_path: Path) -> None:
    (table,) = run_tables(study).values()
    assert [run.name for run in table.runs] == ["sol", "sol+stb", "again"]
    sol, _, again = table.runs
    assert replace(again, name="sol", seconds=sol.seconds) == sol
    dense = [result.metrics.dense_error[-1] for result in study.results["small"]["sol"]]
    np.testing.assert_allclose(sol.dense_error, np.quantile(dense, [0.25, 0.5, 0.75]), rtol=1e-12)
    assert sol.relative_error == pytest.approx(sol.dense_error[1], rel=1e-6)  # the amplitude is 1
    assert (sol.failures, sol.seeds) == (0, 2)
    assert all(len(row) == len(HEADER) for row in table.rows)
    assert table.rows[0][-1] == "1"
    write_runs(tmp_path, {"small": table})
    with (tmp_path / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert float(rows[1]["dense_error_median"]) == table.runs[1].dense_error[1]


def test_a_run_without_a_number_is_a_failure(study: Study) -> None:
    units = {"small": {"sol": [replace(study.units["small"]["sol"][0], folder=Path("nowhere"))]}}
    (table,) = run_tables(replace(study, units=units)).values()
    assert (table.runs[0].failures, table.runs[0].seeds) == (1, 1)
    assert table.rows[0][1:5] == ["\N{EN DASH}"] * 4
    assert isinstance(table, RunTable)


def test_an_interrupted_run_ends_its_study(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = []

    def interrupted(_task: object, units: list[object], _jobs: int):
        for unit in units:
            trained.append(unit)
            yield 130

    monkeypatch.setattr(way, "in_parallel", interrupted)
    monkeypatch.setattr(way, "pending", lambda units: units)
    with pytest.raises(KeyboardInterrupt):
        way.train(study, jobs=1)
    assert len(trained) == 1
