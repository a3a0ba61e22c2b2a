"""What Linux alone has is not needed: locks, and the cores that a process is bound to."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from eigenode_cli.cpus import usable_cores

ELSEWHERE = """
import os, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "resource", "termios", "pwd", "grp"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
for name in ("sched_getaffinity", "process_cpu_count", "killpg", "getloadavg"):
    if hasattr(os, name):
        delattr(os, name)
"""
"""A sitecustomize.py that takes away what Windows or macOS lack."""


def test_the_cores_that_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "process_cpu_count", lambda: 3, raising=False)
    assert usable_cores() == 3
    monkeypatch.delattr(os, "process_cpu_count")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 5}, raising=False)
    assert usable_cores() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert usable_cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert usable_cores() == 1


def test_commands_where_linux_is_not(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(ELSEWHERE)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    short = ("train", "system=oscillator", "grads=sol", "trainer.steps=4", "trainer.figures=false")
    check = "import os; assert not hasattr(os, 'sched_getaffinity'); import fcntl"

    def run(*words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, *words]
        environment = {**os.environ, "PYTHONPATH": path}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    assert "No module named 'fcntl'" in run("-c", check).stderr
    for words in (short, (*short, "--dry-run"), (*short, "-m", "seed=0,1"), (*short, "repetitions=2")):
        done = run("-W", "ignore", "-m", "eigenode_cli", *words)  # filelock says that its lock is another one here
        assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
