"""Interrupted runs: at any moment, by any signal, resumed to the same bytes; and what a late interruption leaves."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eigenode_cli.batch import outcome
from eigenode_cli.batch import run as run_module
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.setup import build
from eigenode_cli.engines.base import Engine
from eigenode_cli.interruption import check, interruptible
from eigenode_cli.reporting import figures
from tests.runs.test_run import InterruptedAt, metrics, record, without_time

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "interruptions.py"
WORDS = (
    "system=oscillator",
    "grads=sol+stb",
    "trainer.steps=60",
    "trainer.record_every=5",
    "trainer.checkpoint_every=20",
)


@pytest.fixture(scope="module")
def config() -> TrainConfig:
    return typed(compose([*WORDS, "trainer.figures=false"]))


def test_signals_at_random_moments_leave_the_same_bytes(tmp_path: Path) -> None:
    """The short form of what the script in benchmarks does a hundred times."""
    found = tmp_path / "found.json"
    cases = ["compiled adam", "compiled bfgs, stages"]
    words = ["--count=6", "--seed=1", "--shorter=2", f"--output={found}", "--cases", *cases]
    done = subprocess.run([sys.executable, SCRIPT, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(found.read_text())
    assert (result["trainings"], result["equal"], result["resumed_to_exit_0"]) == (6, 6, 6)


def test_interrupted_before_anything_was_saved_it_starts_anew(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(run_module, "build", interrupted)
        assert run_module.train(config, tmp_path, WORDS, quiet=True) == 130
    assert record(tmp_path)["status"] == "interrupted"
    assert run_module.resume(config, tmp_path, record(tmp_path), quiet=True) == 0
    whole = tmp_path / "whole"
    whole.mkdir()
    assert run_module.train(config, whole, WORDS, quiet=True) == 0
    assert without_time(tmp_path) == without_time(whole)


def test_an_interruption_after_the_last_step_is_resumed_too(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(outcome, "write_eigenvalues", interrupted)
        assert run_module.train(config, tmp_path, WORDS, quiet=True) == 130
    assert (record(tmp_path)["status"], record(tmp_path)["steps"]) == ("interrupted", 60)
    assert run_module.resume(config, tmp_path, record(tmp_path), quiet=True) == 0
    assert [row["step"] for row in metrics(tmp_path)] == [str(step) for step in range(0, 61, 5)]


def test_the_time_of_a_killed_process_is_not_lost(config: TrainConfig, tmp_path: Path) -> None:
    begin = time.perf_counter()
    assert run_module.train(config, tmp_path, WORDS, quiet=True, watch=InterruptedAt(40)) == 130
    killed = record(tmp_path) | {"status": "running", "wall_seconds": 0.0, "train_seconds": 0.0}  # as SIGKILL leaves it
    saved = json.loads((tmp_path / "checkpoints" / "last.json").read_text())
    spent = saved["wall_seconds"]
    assert saved["train_seconds"] <= spent < time.perf_counter() - begin
    assert run_module.resume(config, tmp_path, killed, quiet=True) == 0
    done = record(tmp_path)
    assert spent < done["wall_seconds"] < time.perf_counter() - begin  # type: ignore[operator]
    assert done["train_seconds"] <= done["wall_seconds"]  # type: ignore[operator]


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (RuntimeError("no font"), 0, "eigenode: the figures failed (RuntimeError: no font); the run is recorded"),
        (KeyboardInterrupt(), 130, "eigenode: the figures were interrupted; the run is recorded"),
    ],
)
def test_a_figure_that_fails_leaves_a_finished_run(
    error: BaseException,
    status: int,
    line: str,
    config: TrainConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen: list[object] = []

    def draw(folder: Path) -> None:
        seen.append(record(folder)["status"])
        raise error

    monkeypatch.setattr(figures, "draw_run", draw)
    monkeypatch.setattr(config.trainer, "figures", True)
    assert run_module.train(config, tmp_path, WORDS) == status
    assert seen == ["finished"]  # it is complete on disk before anything is drawn
    assert record(tmp_path)["status"] == "finished"
    said = capsys.readouterr()
    assert said.err.startswith(line)
    assert len(said.err.splitlines()) == 1
    assert "Traceback" not in said.err
    assert not (tmp_path / "error.txt").exists()


def test_a_long_step_is_not_taken_several_times_between_two_looks(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage whose steps take a hundred times as long as those before starts with a single one."""
    sizes: list[tuple[int, int]] = []
    setup = build(typed(compose([*WORDS, "stages=[{horizons:[0.1,1]}]", "trainer.record_every=30"])), print)

    def watched(number: int, engine: Engine) -> None:
        advance = engine.advance

        def counted(theta, update, rates, halt):  # type: ignore[no-untyped-def]
            sizes.append((number, rates.size))
            return advance(theta, update, rates, halt)

        engine.advance = counted  # type: ignore[method-assign]

    for number, phase in enumerate(setup.phases):
        watched(number, phase.engine)
    monkeypatch.setattr(run_module, "build", lambda *_: setup)
    assert run_module.train(setup.config, tmp_path, WORDS, quiet=True) == 0
    first = dict(reversed(sizes))
    assert first == {0: 1, 1: 1}
    assert sum(size for _, size in sizes) == 60


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_python_drops_is_not_lost(number: signal.Signals) -> None:
    class Dropping:
        def __del__(self) -> None:
            signal.raise_signal(number)

    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    with interruptible():
        check()
        victim = Dropping()
        del victim  # its exception is printed, and nothing else comes of it
        with pytest.raises(KeyboardInterrupt):
            check()
    with interruptible():
        check()  # another command
    assert {one: signal.getsignal(one) for one in before} == before


def test_where_ctrl_c_is_ignored_it_stays_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGINT)
            check()
    finally:
        signal.signal(signal.SIGINT, before)
