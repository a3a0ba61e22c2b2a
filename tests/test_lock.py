"""One process works in a run's folder at a time; a kill frees it."""

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from eigenode_cli.errors import UserError
from eigenode_cli.runs.lock import held, locked
from tests.batch.helpers import inside

HOLD = (
    "import sys, pathlib, time; from eigenode_cli.runs.lock import locked\n"
    "with locked(pathlib.Path(sys.argv[1])):\n"
    "    print('held', flush=True)\n"
    "    time.sleep(600)\n"
)


class Holder:
    """Another process that holds the lock of a folder."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-c", HOLD, str(folder)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "held\n"

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate()


def test_the_second_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    assert not held(tmp_path)
    holder = Holder(tmp_path)
    try:
        assert held(tmp_path)
        with pytest.raises(UserError, match="another process works in it"), locked(tmp_path):
            pass
        record = {"version": 1, "status": "running", "config": {}, "command": ""}
        (tmp_path / "run.json").write_text(json.dumps(record))
        before = (tmp_path / "run.json").read_bytes()
        for words in (["resume", "."], ["train", "hydra.run.dir=."]):
            status, out, err = inside(tmp_path, *words)
            assert (status, out, err.count("\n")) == (2, "", 1), words
            assert "another process works in it; wait until it ends, or stop it" in err, words
        assert (tmp_path / "run.json").read_bytes() == before
    finally:
        holder.kill()
    assert not held(tmp_path)
    with locked(tmp_path):
        assert (tmp_path / "run.json").read_bytes() == before


def test_who_has_it_may_take_it_again_and_no_other_thread(tmp_path: Path) -> None:
    answers: list[object] = []

    def other() -> None:
        answers.append(held(tmp_path))
        try:
            with locked(tmp_path):
                answers.append("taken")
        except UserError:
            answers.append("refused")

    with locked(tmp_path), locked(tmp_path):
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    assert answers == [True, "refused"]
    assert not held(tmp_path)


def test_who_waits_gets_it_after_a_kill(tmp_path: Path) -> None:
    holder = Holder(tmp_path)
    threading.Timer(0.2, holder.kill).start()
    with locked(tmp_path, wait=True):
        assert holder.process.wait() == -signal.SIGKILL
