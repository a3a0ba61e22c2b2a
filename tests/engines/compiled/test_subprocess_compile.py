"""The first run on a machine compiles in a process of its own, says so, and stays small; the second one loads."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import config

from eigenode_cli.engines.compiled import engine as module
from eigenode_cli.engines.compiled import kernel, ready
from eigenode_cli.engines.compiled.cached import is_ready
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.subprocess_compile import compile_apart
from eigenode_cli.jit import PLAIN
from tests.engines.compiled import oracle

pytestmark = pytest.mark.skipif(PLAIN, reason="plain Python compiles nothing")

MEGABYTES = 700
"""More than this no process of a run may ever take."""


FLOAT = (numba.float64,)
ROOT = Path(module.__file__).parents[3]


def doubled(x: float) -> float:
    """Stands for a kernel: compiled in an instant."""
    return 2.0 * x


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A maker of kernels as a process that has just started finds them, with a cache of their own."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    return lambda: numba.njit(cache=True)(doubled)


def test_a_kernel_is_ready_once_its_signature_lies_in_the_cache(fresh: Any) -> None:
    assert not is_ready(fresh(), FLOAT)
    first = fresh()
    first.compile(FLOAT)
    assert is_ready(first, FLOAT)
    assert is_ready(fresh(), FLOAT)
    assert not is_ready(fresh(), (numba.int64,))


@pytest.mark.parametrize("change", ["source", "processor", "version", "file"])
def test_an_index_in_the_cache_alone_says_nothing(
    change: str, fresh: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh().compile(FLOAT)
    later = fresh()
    if change == "source":
        monkeypatch.setattr(later._cache._cache_file, "_source_stamp", "another")
    elif change == "processor":
        monkeypatch.setattr(type(later.targetctx.codegen()), "magic_tuple", lambda self: ("another",))
    elif change == "version":
        monkeypatch.setattr(later._cache._cache_file, "_version", "0.0")
    else:
        for path in tmp_path.rglob("*.nbc"):
            path.unlink()
    assert list(tmp_path.rglob("*.nbi"))
    assert not is_ready(later, FLOAT)


def test_a_kernel_whose_file_lies_elsewhere_is_not_ready(fresh: Any, tmp_path: Path) -> None:
    fresh().compile(FLOAT)
    (folder,) = tmp_path.iterdir()
    folder.rename(tmp_path / "a-package-in-another-environment")
    assert list(tmp_path.rglob("*.nbi"))
    assert not is_ready(fresh(), FLOAT)


def test_a_damaged_index_is_written_anew(fresh: Any, tmp_path: Path) -> None:
    fresh().compile(FLOAT)
    for index in tmp_path.rglob("*.nbi"):
        index.write_bytes(index.read_bytes()[:9])
    later = fresh()
    assert not is_ready(later, FLOAT)
    later.compile(FLOAT)  # Numba itself would fail to read it
    assert is_ready(fresh(), FLOAT)


def test_changed_internals_of_numba_mean_not_ready(fresh: Any) -> None:
    fresh().compile(FLOAT)
    later = fresh()
    del later._cache
    assert not is_ready(later, FLOAT)


@pytest.mark.parametrize("fault", [None, "TypingError: no"])
def test_a_compilation_is_announced_and_its_fault_shown(fault: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, said = [], []
    monkeypatch.setattr(ready, "not_ready", lambda kernels, signatures: signatures)
    monkeypatch.setattr(ready, "compile_apart", lambda signatures: asked.append([*signatures]) or fault)
    engine = CompiledEngine(oracle.make_shape(2), oracle.make_problem(2), announce=said.append)
    engine.loss_jacobian(oracle.make_theta(oracle.make_shape(2)))
    assert asked == [["loss_jacobian"]]
    assert said[0].startswith("compiling the engine, once for this environment")
    failed = f"compiling it within this run, as it failed in a process of its own: {fault}"
    assert said[1:] == ([] if fault is None else [failed])


def test_the_error_of_the_compiler_in_one_line() -> None:
    assert compile_apart({"forward": FLOAT}) == (
        "TypeError: Signature mismatch: 1 argument types given, but function takes 8 arguments"
    )
    fault = compile_apart({"advance": FLOAT * 15})
    assert fault is not None
    assert fault.startswith("TypingError: Failed in nopython mode pipeline")
    assert "Unknown attribute 'size' of type float64" in fault


def test_what_cannot_be_compiled_there_is_left_to_the_run():
    assert compile_apart({"solve": ("no types",)}) is not None
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


UNWRITABLE = """
from eigenode_cli.jit import cache_folder
(cache_folder() / "code").write_bytes(bytes(7))
print(cache_folder())
"""


def test_a_cache_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", UNWRITABLE]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).parent == tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.slow
def test_another_environment_compiles_apart_and_says_so(tmp_path: Path) -> None:
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    for name in ("NUMBA_CACHE_DIR", "PYTHONPATH"):
        environment.pop(name, None)
    announced: dict[str, list[bool]] = {"one": [], "other": []}
    for name in ("one", "other", "one"):  # two virtual environments, each with a copy of the same package
        python = tmp_path / name / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / name], check=True)
            (site,) = (tmp_path / name).glob("lib/python*/site-packages")
            (site / "base.pth").write_text(f"{Path(numba.__file__).parents[1]}\n")
            for package in ("eigenode_cli", "configs", "experiments"):
                shutil.copytree(ROOT / package, site / package)
        words = ["train", "system=vdp", "grads=sol", "trainer.steps=50", "trainer.figures=false"]
        command = [sys.executable, "-c", PEAK, str(python), "-m", "eigenode_cli", *words]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout
        assert "within this run" not in done.stdout
        announced[name].append("compiling the engine" in done.stdout)
    assert announced == {"one": [True, False], "other": [True]}
