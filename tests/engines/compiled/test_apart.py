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
from tests.engines.compiled import oracle

MEGABYTES = 700
"""More than this no process of a run may ever take."""


def test_what_cannot_be_compiled_there_is_left_to_the_run():
    compile_apart({"solve": ("no types",)})
    engine = CompiledEngine(oracle.make_shape(2), oracle.make_problem(2))
    assert engine.loss_jacobian(oracle.make_theta(oracle.make_shape(2))).status == 0
    assert kernel.loss_jacobian.signatures


@pytest.mark.slow
def test_first_and_second_run(tmp_path: Path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    compiled = {}
    for name in ("first", "second"):
        words = ["system=vdp", "grads=sol+frq", "trainer.steps=50", f"hydra.run.dir={name}"]
        with (tmp_path / f"{name}.txt").open("w") as out:
            command = [sys.executable, "-m", "eigenode_cli", "train", *words]
            process = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=out, stderr=subprocess.STDOUT)
            _, status, usage = os.wait4(process.pid, 0)  # its own peak, and that of its largest child
            process.returncode = os.waitstatus_to_exitcode(status)
        text = (tmp_path / f"{name}.txt").read_text()
        assert process.returncode == 0, text
        assert ("compiling the engine" in text) == (name == "first")
        assert usage.ru_maxrss < MEGABYTES * 1024
        compiled[name] = json.loads((tmp_path / name / "run.json").read_text())["compile_seconds"]
    assert compiled["second"] < 0.1 * compiled["first"]
