"""Nothing is lost when the whole process tree is killed, again and again."""

import os
import random
import signal
from pathlib import Path
from time import monotonic, sleep

import pytest

from tests.batch.helpers import assert_equal_sweeps, eigenode, runs, start

RUNS = 40
SWEEP = ("train", "-m", "system=oscillator", "grads=sol,sol+frq", f"seed=range({RUNS // 2})", "trainer.steps=600")


def finished(sweep: Path) -> int:
    return sum('"status": "finished"' in path.read_text() for path in sweep.glob("*/run.json"))


def kill_after(folder: Path, sweep: Path, more: int) -> None:
    """Start the sweep and kill all its processes, `more` finished runs later, at some point of the next ones."""
    before = finished(sweep)
    process = start(folder, *SWEEP)
    until = monotonic() + 300.0
    while finished(sweep) < before + more:
        assert process.poll() is None, process.communicate()
        assert monotonic() < until
        sleep(0.01)
    sleep(random.random() * 0.3)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=60)


@pytest.mark.slow
def test_killed_three_times(tmp_path: Path) -> None:
    for folder in ("cut", "whole"):
        (tmp_path / folder).mkdir()
    status, out, err = eigenode(tmp_path / "whole", *SWEEP)
    assert (status, err) == (0, "")
    whole = tmp_path / "whole" / out.splitlines()[1].split()[1]
    cut = tmp_path / "cut" / "outputs" / whole.name
    for _ in range(3):
        kill_after(tmp_path / "cut", cut, more=5)
    done = finished(cut)
    assert 15 <= done < RUNS
    status, out, err = eigenode(tmp_path / "cut", *SWEEP)
    assert (status, err) == (0, "")
    assert out.splitlines()[0].startswith(f"sweep  {RUNS} runs, {done} finished already, skipped")
    assert len(runs(cut)) == RUNS
    assert_equal_sweeps(cut, whole)
