"""The first run on a machine compiles in a process of its own, says so, and stays small; the second one loads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from eigenode_cli.engines.compiled import kernel
from eigenode_cli.engines.compiled.apart import compile_apart
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.jit import PLAIN
from tests.engines.compiled import oracle

pytestmark = pytest.mark.skipif(PLAIN, reason="plain Python compiles nothing")

MEGABYTES = 700
"""More than this no process of a run may ever take."""


def test_what_cannot_be_compiled_there_is_left_to_the_run():
    compile_apart({"solve": ("no types",)})
    engine = CompiledEngine(oracle.make_shape(2), oracle.make_problem(2))
    assert engine.loss_jacobian(oracle.make_theta(oracle.make_shape(2))).status == 0
    assert kernel.loss_jacobian.signatures


PEAK = """
import resource, subprocess, sys
status = subprocess.run(sys.argv[1:], stderr=subprocess.STDOUT).returncode
print("peak", resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(status)
"""
"""Runs a command from a small process: a process is said to be as large as the one that started it ever was."""


@pytest.mark.slow
def test_first_and_second_run(tmp_path: Path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    compiled = {}
    for name in ("first", "second"):
        words = ["system=vdp", "grads=sol+frq", "trainer.steps=50", f"hydra.run.dir={name}"]
        command = [sys.executable, "-c", PEAK, sys.executable, "-m", "eigenode_cli", "train", *words]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout
        assert ("compiling the engine" in done.stdout) == (name == "first")
        peak = int(done.stdout.rpartition("peak ")[2])  # of the largest of the run's processes, in KiB
        assert 100 * 1024 < peak < MEGABYTES * 1024
        compiled[name] = json.loads((tmp_path / name / "run.json").read_text())["compile_seconds"]
    assert compiled["second"] < 0.1 * compiled["first"]
