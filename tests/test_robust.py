"""protocol=robust does what it is for: one recipe, all three systems, from positions alone."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from safetensors.torch import load_file

from tests.runs.test_run import metrics, record, train, without_time

SYSTEMS = {
    "oscillator": ("sol+frq+dmp+stb+osc", 1.0),
    "sparse_oscillator": ("sol+frq+dmp+stb+osc", 1.0),
    "vdp": ("sol+frq+dmp+osc", 2.0),
}
"""Terms and amplitude."""


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_seed_that_no_one_tuned_for(system: str, tmp_path: Path) -> None:
    grads, amplitude = SYSTEMS[system]
    run = train(tmp_path, "protocol=robust", f"system={system}", f"grads={grads}", "seed=4711", "trainer.figures=false")
    assert record(run)["unsolvable_steps"] == 0
    assert float(metrics(run)[-1]["dense_error"]) <= 0.001 * amplitude


def test_a_least_squares_run_records_what_its_optimizer_does(tmp_path: Path) -> None:
    words = ("trainer.steps=160", "stages.0.steps=20", "trainer.record_every=20", "trainer.figures=false")
    run = train(tmp_path, "protocol=robust", "system=sparse_oscillator", "grads=sol+frq", *words)
    rows = metrics(run)
    assert list(rows[0])[-3:] == ["damping", "gain_ratio", "gradient_norm"]
    assert {row["lr"] for row in rows} == {""}
    assert all(float(row["damping"]) > 0.0 for row in rows)


def test_an_unknown_initial_velocity_is_trained(tmp_path: Path) -> None:
    words = ("system=sparse_oscillator", "system.initial_known=[s]", "system.noise=0.01", "grads=sol+frq+dmp")
    run = train(tmp_path, "protocol=robust", *words, "trainer.figures=false")
    assert float(metrics(run)[-1]["dense_error"]) <= 0.02
    found = load_file(run / "checkpoints" / "step-000250.safetensors")
    assert found["initial_state"].shape == (1,)
    assert abs(float(found["initial_state"][0])) < 0.1  # it starts from rest
    assert found["linear"].shape == (1, 2)


def test_killed_in_the_middle_it_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    words = ("protocol=robust", "system=vdp", "grads=sol+frq", "trainer.figures=false", "trainer.checkpoint_every=10")
    whole = train(tmp_path, *words, "hydra.run.dir=whole")
    command = [sys.executable, "-m", "eigenode_cli", "train", *words, "hydra.run.dir=cut"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    last = tmp_path / "cut" / "checkpoints" / "last.json"
    while process.poll() is None and not (last.exists() and json.loads(last.read_text())["step"] >= 40):
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    resumed = subprocess.run([*command[:3], "resume", "cut"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert resumed.returncode in (0, 2), resumed.stderr  # 2: it had finished before the signal came
    assert without_time(tmp_path / "cut") == without_time(tmp_path / whole)
    ends = [(tmp_path / name / "checkpoints" / "step-000250.safetensors").read_bytes() for name in ("cut", "whole")]
    assert ends[0] == ends[1]
