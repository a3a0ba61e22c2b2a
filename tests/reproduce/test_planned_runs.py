"""Units: found by their configuration, paired by their seed, never trained twice, resumed where they were killed."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from eigenode_cli.batch import run
from eigenode_cli.reproduce.planned_runs import (
    Unit,
    container,
    distinct,
    folder_of,
    in_parallel,
    pending,
    seeded,
    train_unit,
)
from eigenode_cli.reproduce.study import Study, prepare, train
from tests.reproduce.conftest import EXPERIMENT, write_experiment


def first_row(unit: Unit) -> str:
    return (unit.folder / "metrics.csv").read_text().splitlines()[1]


def test_all_combinations_of_a_seed_start_from_the_same_weights(study: Study) -> None:
    units = study.units["small"]
    for seed in (0, 1):
        a, b = (first_row(units[name][seed]).split(",") for name in ("sol", "sol+stb"))
        assert a[3:] == b[3:]
    assert first_row(units["sol"][0]) != first_row(units["sol"][1])


def test_a_run_that_two_ask_for_is_one_unit(study: Study) -> None:
    units = study.units["small"]
    assert [unit.folder for unit in units["sol"]] == [unit.folder for unit in units["again"]]
    assert len(study.all_units) == 4
    assert [unit.config.seed for unit in study.all_units] == [0, 0, 1, 1]
    assert distinct([*units["sol"], *units["again"]]) == units["again"]


def test_a_folder_stands_for_every_setting_but_the_seed(study: Study) -> None:
    unit = study.all_units[0]
    other = replace(unit.config, trainer=replace(unit.config.trainer, steps=21))
    assert folder_of(other).parent != unit.folder.parent
    assert folder_of(replace(unit.config, seed=7)) == unit.folder.with_name("seed0007")
    assert unit.folder.parts[:4] == ("outputs", "reproduce", "paper", "runs")
    assert [one.words[-1] for one in seeded(unit.config, ["grads=sol"], 2)] == ["seed=0", "seed=1"]


def test_hydras_files_stand_in_every_folder(study: Study) -> None:
    for unit in study.all_units:
        place = unit.folder / ".hydra"
        assert {path.name for path in place.iterdir()} == {"config.yaml", "hydra.yaml", "overrides.yaml"}
        assert OmegaConf.load(place / "overrides.yaml") == [*unit.words]
        composed = OmegaConf.load(place / "config.yaml")
        assert (composed.seed, composed.trainer.steps) == (unit.config.seed, 20)
        assert OmegaConf.load(place / "hydra.yaml").hydra.runtime.output_dir == str(unit.folder.resolve())


def test_finished_units_are_left_alone(study: Study) -> None:
    before = {path: path.stat().st_mtime_ns for unit in study.all_units for path in unit.folder.rglob("*")}
    assert pending(study.all_units) == []
    assert [train_unit(unit) for unit in study.all_units] == [0] * 4
    assert before == {path: path.stat().st_mtime_ns for unit in study.all_units for path in unit.folder.rglob("*")}


def test_a_killed_unit_goes_on_to_the_same_end(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    finished = study.all_units[0]
    whole = (finished.folder / "solution.csv").read_bytes()
    killed = replace(finished, folder=tmp_path / "killed")
    shutil.copytree(finished.folder, killed.folder)
    record = json.loads((killed.folder / "run.json").read_text())
    (killed.folder / "run.json").write_text(json.dumps(record | {"status": "running"}))
    (killed.folder / "solution.csv").unlink()
    assert killed.status == "running"
    monkeypatch.setattr(run, "train", None)  # it goes on, it does not start again
    assert train_unit(killed) == 0
    assert killed.status == "finished"
    assert (killed.folder / "solution.csv").read_bytes() == whole


def test_a_unit_of_other_settings_in_its_place_does_not_count(elsewhere: Path) -> None:
    made = prepare([write_experiment(elsewhere)], None, 1)
    unit = made.all_units[0]
    unit.folder.mkdir(parents=True)
    assert unit.status == "waiting"
    record = {"status": "finished", "config": container(unit.config)}
    (unit.folder / "run.json").write_text(json.dumps(record))
    assert unit.status == "finished"
    record["config"] = container(replace(unit.config, grads="sol+osc"))
    (unit.folder / "run.json").write_text(json.dumps(record))
    assert unit.status == "waiting"
    (unit.folder / "run.json").write_text('{"status": "fini')
    assert unit.status == "waiting"


@pytest.mark.slow
def test_processes_give_the_same_bytes(study: Study, tmp_path_factory: pytest.TempPathFactory) -> None:
    alone = {unit.folder: (unit.folder / "solution.csv").read_bytes() for unit in study.all_units}
    folder = tmp_path_factory.mktemp("parallel")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        made = prepare([write_experiment(folder, EXPERIMENT)], None, 2)
        train(made, jobs=2)
        assert {unit.folder: (unit.folder / "solution.csv").read_bytes() for unit in made.all_units} == alone


def test_results_come_one_by_one(study: Study) -> None:
    assert list(in_parallel(lambda unit: unit.config.seed, study.all_units, 1)) == [0, 0, 1, 1]
    assert list(in_parallel(train_unit, [], 2)) == []
