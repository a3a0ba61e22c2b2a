"""`repetitions=N`: threads in one process, equal to N single runs whatever their number."""

import json
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from eigenode_cli.batch.plan import Sweep, write_plan
from eigenode_cli.batch.repetitions import repeat
from eigenode_cli.config.check import examine
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.sweep import repeated
from tests.batch.helpers import BASIC, SHORT, assert_equal_sweeps, inside, rows, runs

WORDS = (*SHORT, "grads=sol+frq+dmp")


def repetitions(folder: Path, threads: int, *words: str) -> None:
    composer = Composer()
    config = examine(composer, [*WORDS, "repetitions=3", "seed=5", *words]).checked()
    jobs = repeated(composer, config, [*WORDS, *words])
    assert [job.overrides[-1] for job in jobs] == ["seed=5", "seed=6", "seed=7"]
    sweep = Sweep(folder, (), (), tuple(jobs))
    write_plan(sweep)
    repeat(sweep, jobs, config, threads)


@pytest.mark.parametrize("threads", [1, 3])
def test_equal_to_a_sweep_over_the_seeds(threads: int, tmp_path: Path) -> None:
    repetitions(tmp_path / "threads", threads)
    status, _, err = inside(tmp_path, "train", "-m", *WORDS, "seed=5,6,7", BASIC, "hydra.sweep.dir=single")
    assert (status, err) == (0, "")
    assert_equal_sweeps(tmp_path / "threads", tmp_path / "single")
    for run in runs(tmp_path / "threads").values():
        config = json.loads((run / "run.json").read_text())["config"]
        assert config["repetitions"] == 1
        check_hydras_files(run, config)


def check_hydras_files(run: Path, config: dict[str, object]) -> None:
    """`.hydra/` is what Hydra itself writes for a job."""
    composed = OmegaConf.load(run / ".hydra" / "config.yaml")
    assert (composed.seed, composed.repetitions, composed.grads) == (config["seed"], 1, config["grads"])
    assert "hydra" not in composed
    hydra = OmegaConf.load(run / ".hydra" / "hydra.yaml").hydra
    assert (hydra.run.dir, hydra.runtime.output_dir) == (run.as_posix(), str(run))
    words = OmegaConf.load(run / ".hydra" / "overrides.yaml")
    assert words == hydra.overrides.task
    assert words == [*WORDS, f"seed={config['seed']}"]


@pytest.mark.slow
def test_the_torch_engine_repeats_too(tmp_path: Path) -> None:
    for threads in (1, 2):
        repetitions(tmp_path / str(threads), threads, "engine=torch", "trainer.steps=2")
    assert_equal_sweeps(tmp_path / "1", tmp_path / "2")


def test_the_command(tmp_path: Path) -> None:
    words = ("train", *WORDS, "repetitions=2", "seed=5")
    status, out, err = inside(tmp_path, *words)
    assert (status, err, out.splitlines()[0]) == (0, "", "sweep  2 runs")
    (sweep,) = (tmp_path / "outputs").iterdir()
    assert [(row["seed"], row["status"]) for row in rows(sweep)] == [("5", "finished"), ("6", "finished")]
    status, out, _ = inside(tmp_path, *words)
    assert (status, out.splitlines()[0]) == (0, "sweep  2 runs, 2 finished already, skipped")
    status, out, _ = inside(tmp_path, "resume", sweep.name)
    assert (status, out.splitlines()[0]) == (0, "sweep  2 runs, 2 finished already, skipped")


@pytest.mark.slow
def test_figures_are_drawn_where_they_are_asked_for(tmp_path: Path) -> None:
    repetitions(tmp_path, 2, "trainer.figures=true")
    for run in runs(tmp_path).values():
        assert (run / "report.html").is_file()
        assert len(list((run / "plots").iterdir())) == 10
