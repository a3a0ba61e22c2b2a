"""What `--dry-run` says, against what happens: counts and disk. Time is compared in benchmarks/."""

import re
from pathlib import Path

import pytest

from eigenode_cli.batch.cost import Around, Cost, expected_seconds
from tests.batch.helpers import BASIC, SHORT, inside

WORDS = ("-m", *SHORT, "grads=sol,sol+frq", "seed=range(3)", "trainer.steps=900", "trainer.checkpoint_every=100")


def blocks(folder: Path) -> int:
    return sum(-(-path.stat().st_size // 4096) * 4096 for path in folder.rglob("*") if path.is_file())


def test_runs_and_disk(tmp_path: Path) -> None:
    status, out, err = inside(tmp_path, "train", "--dry-run", *WORDS)
    assert (status, err) == (0, "")
    assert not (tmp_path / "outputs").exists()
    assert out.splitlines()[0] == "runs  6, of 2 kinds (the seed apart)"
    assert re.search(r"^time  about .+ on \d+ cores?$", out, re.MULTILINE)
    found = re.search(r"^disk  (.+) MB$", out, re.MULTILINE)
    assert found
    assert inside(tmp_path, "train", *WORDS, BASIC, "hydra.sweep.dir=real")[0] == 0
    real = sum(blocks(run) for run in (tmp_path / "real").iterdir() if run.is_dir() and run.name != "plots")
    assert float(found[1]) * 1e6 == pytest.approx(real, rel=0.15, abs=1e5)


def test_a_dry_run_that_fails_says_why(tmp_path: Path) -> None:
    (tmp_path / "fragile.py").write_text("def broken(*_):\n    raise RuntimeError('out of glue')\n")
    status, _, err = inside(tmp_path, "train", "--dry-run", "terms.own=fragile:broken", "grads=sol+own")
    assert status == 2
    assert "a run that was tried for 1 steps failed: terms.own=fragile:broken: RuntimeError: out of glue" in err


def test_the_model() -> None:
    cost = Cost(step=0.01, rest=1.0, steps=100, disk=0)
    assert cost.seconds == 2.0
    around = Around(command=3.0, kind=0.5, job=0.25)
    assert expected_seconds([cost], [10], 1, around) == 3.0 + 0.5 + 22.5
    assert expected_seconds([cost], [10], 2, around) == 3.0 + 0.5 + 11.25
    assert expected_seconds([cost], [1], 4, around) == 3.0 + 0.5 + 2.25
    assert expected_seconds([cost], [1, 1], 1, around) == 3.0 + 1.0 + 4.5
