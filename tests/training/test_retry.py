"""`trainer.on_unsolvable=retry` and `optimizer.clip`: one step by hand, and whole runs of the command."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from eigenode_cli.cli import main
from eigenode_cli.engines.combine import COMBINATIONS
from eigenode_cli.engines.update import learn, train_step
from eigenode_cli.training.methods import Adam, Sgd
from eigenode_cli.training.optimizers import build_optimizer, build_update


def test_a_failed_step_is_halved_from_the_last_good_parameters() -> None:
    optimizer = build_optimizer(Sgd(lr=1.0, momentum=0.9), 2, retries=True)
    update, theta, gradient = build_update(COMBINATIONS["sum"], [1.0], optimizer), np.zeros(2), np.array([[1.0, -2.0]])
    train_step(update, theta, gradient, 1.0, False)  # nothing was solvable so far: it trains as usual
    theta[:] = 0.0
    train_step(update, theta, gradient, 1.0, True)
    beyond = theta.copy()
    for k in (1, 2, 3):
        train_step(update, theta, np.full((1, 2), np.nan), 1.0, False)
        np.testing.assert_array_equal(theta, beyond / 2.0**k)
    assert not optimizer.memory.any()
    train_step(update, theta, gradient, 1.0, True)
    assert optimizer.good[-1] == 1.1 / 8.0
    np.testing.assert_allclose(theta, beyond / 8.0 - 1.1 / 8.0 * gradient[0], rtol=1e-15)


def test_a_long_gradient_is_shortened_and_counted() -> None:
    optimizer = build_optimizer(Sgd(lr=1.0, clip=1.0), 2)
    update, theta = build_update(COMBINATIONS["sequential"], [1.0, 1.0], optimizer), np.zeros(2)
    learn(update, theta, np.array([[3.0, 4.0], [0.0, 0.5]]), 1.0)
    np.testing.assert_allclose(theta, [-0.6, -0.8 - 0.5], rtol=1e-15)
    assert optimizer.records == {"clipped": 1.0}
    assert build_optimizer(Adam(), 2).records == {}


TRAIN = ["train", "system=vdp", "grads=sol", "optimizer=sgd", "optimizer.lr=1", "optimizer.momentum=0.9"]
SHORT = ["trainer.steps=200", "trainer.record_every=20", "trainer.figures=false", "solver.max_steps=200"]


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_rate_far_too_large_does_not_end_the_training(tmp_path: Path, engine: str) -> None:
    """It fails at step 2 and stalls; with `retry` it trains on, and ends with weights that can be solved."""
    steps = ["trainer.steps=30", "trainer.record_every=10"] if engine == "torch" else SHORT[:2]
    for name, code in (("stabilise", 1), ("retry", 0)):
        more = [f"trainer.on_unsolvable={name}", f"engine={engine}", f"hydra.run.dir={tmp_path / name}", SHORT[-1]]
        assert main([*TRAIN, *steps, *more, SHORT[-2]]) == code
    stuck, free = (json.loads((tmp_path / name / "run.json").read_text()) for name in ("stabilise", "retry"))
    assert stuck["status"] == "stalled"
    assert "trainer.on_unsolvable=retry" in stuck["error"]
    assert free["status"] == "finished"
    rows = pd.read_csv(tmp_path / "retry" / "metrics.csv")
    assert (
        np.isfinite(rows["sol"]).sum() > np.isfinite(pd.read_csv(tmp_path / "stabilise" / "metrics.csv")["sol"]).sum()
    )
    assert np.isfinite(free["final"]["sol"])


def test_it_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    folder, more = tmp_path / "run", ["trainer.on_unsolvable=retry", "optimizer.clip=10"]
    whole = [*TRAIN, *SHORT, *more, f"hydra.run.dir={tmp_path / 'whole'}"]
    assert main(whole) == 0
    assert main([*TRAIN, *SHORT, *more, "trainer.steps=100", f"hydra.run.dir={folder}"]) == 0
    assert main(["resume", str(folder), "trainer.steps=200"]) == 0
    ours, theirs = (
        pd.read_csv(one / "metrics.csv").drop(columns="train_seconds") for one in (folder, tmp_path / "whole")
    )
    pd.testing.assert_frame_equal(ours, theirs)
    assert ours["clipped"].iloc[-1] > 0


def test_retry_is_refused_where_it_has_no_effect(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "protocol=robust", "trainer.on_unsolvable=retry"]) == 2
    assert "optimizer=lm chooses its steps by itself" in capsys.readouterr().err
