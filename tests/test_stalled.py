"""Runs that cannot go on, or went astray: named, recorded, counted as failures, refused by resume."""

import json
from pathlib import Path

import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.reproduce.measures import Result
from eigenode_cli.reproduce.planned_runs import Unit, container, pending
from tests.batch.helpers import BASIC, inside, rows
from tests.runs.test_run import metrics, record

UNSOLVABLE = ("system=vdp", "grads=sol", "optimizer=sgd", "optimizer.lr=1", "optimizer.momentum=0.9")
STUCK = ("system=oscillator", "grads=sol", "optimizer=adam_bfgs", "optimizer.adam_steps=50")
ASTRAY = ("system=oscillator", "grads=sol+stb", "optimizer.lr=5", "trainer.steps=100")


@pytest.mark.parametrize(
    ("words", "status", "reason", "steps"),
    [
        ((*UNSOLVABLE, "trainer.steps=500"), "stalled", "the solve fails (max_steps) and no gradient acts", 50),
        ((*STUCK, "trainer.steps=3000"), "stalled", "BFGS finds no lower point", 150),
        ((*ASTRAY, "solver.max_steps=2000"), "diverged", "sol ends at", 100),
    ],
)
def test_it_ends_early_with_a_name_and_cannot_be_resumed(
    words: tuple[str, ...], status: str, reason: str, steps: int, tmp_path: Path
) -> None:
    words = (*words, "trainer.figures=false", "hydra.run.dir=run")
    code, out, err = inside(tmp_path, "train", *words)
    assert code == 1
    assert err.startswith(f"eigenode: {status}: ")
    assert reason in err
    assert len(err.splitlines()) == 1
    run = tmp_path / "run"
    written = record(run)
    assert (written["status"], written["steps"]) == (status, steps)
    assert metrics(run)[-1]["step"] == str(steps)
    assert "final" in written
    assert (run / "eigenvalues.csv").exists()
    before = (run / "run.json").read_bytes()
    code, out, err = inside(tmp_path, "resume", "run")
    assert (code, out) == (2, "")
    assert err.startswith(f"eigenode: error: run: the run {status}, to resume it would lead to the same")
    assert len(err.splitlines()) == 1
    assert (run / "run.json").read_bytes() == before


def test_the_last_weights_that_could_be_solved_are_kept(tmp_path: Path) -> None:
    inside(tmp_path, "train", *UNSOLVABLE, "trainer.steps=500", "trainer.figures=false", "hydra.run.dir=run")
    error = str(record(tmp_path / "run")["error"])
    kept = error.rsplit(" ", 1)[1]
    assert kept == "checkpoints/step-000001.safetensors"
    assert (tmp_path / "run" / kept).exists()


def test_figures_and_page_of_a_stalled_run(tmp_path: Path) -> None:
    inside(tmp_path, "train", *UNSOLVABLE, "trainer.steps=500", "hydra.run.dir=run")
    assert (tmp_path / "run" / "plots" / "convergence.png").exists()
    assert '<span class="badge stalled">stalled</span>' in (tmp_path / "run" / "report.html").read_text()
    assert inside(tmp_path, "plot", "run")[0] == 0
    assert inside(tmp_path, "report", "run")[0] == 0


def test_a_sweep_counts_it_as_a_failure_and_does_not_repeat_it(tmp_path: Path) -> None:
    words = ("train", "-m", *UNSOLVABLE, "trainer.steps=60", BASIC, "optimizer.lr=1,0.0001", "hydra.sweep.dir=here")
    code, out, err = inside(tmp_path, *words)
    assert code == 1
    found = {row["optimizer.lr"]: row["status"] for row in rows(tmp_path / "here")}
    assert found == {"1": "stalled", "0.0001": "finished"}
    assert "1 of 2 runs failed" in err
    (run,) = (path for path in (tmp_path / "here").glob("*/run.json") if record(path.parent)["status"] == "stalled")
    before = run.stat().st_mtime_ns
    code, out, err = inside(tmp_path, *words)
    assert code == 1
    assert "1 finished already, skipped, 1 stalled already, skipped" in out
    assert run.stat().st_mtime_ns == before
    assert inside(tmp_path, "report", "here")[0] == 0
    page = (tmp_path / "here" / "report.html").read_text()
    assert "<div>stalled</div>" in page


def test_a_study_does_not_repeat_it_and_counts_it_as_a_failure(tmp_path: Path) -> None:
    unit = Unit(typed(compose(["grads=sol"])), tmp_path, ())
    for status, again, outcome, failed in (
        ("finished", [], True, False),
        ("stalled", [], True, True),
        ("diverged", [], True, True),
        ("failed", [unit], False, True),
    ):
        (tmp_path / "run.json").write_text(json.dumps({"status": status, "config": container(unit.config)}))
        assert pending([unit]) == again
        result = Result(unit)
        assert (result.finished, result.failed) == (outcome, failed)
