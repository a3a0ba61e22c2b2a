"""Output is not the result: a run goes on whoever has stopped to read, and commands that print say what is lost."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

RUN = ["train", "system=oscillator", "trainer.steps=20", "trainer.record_every=1", "trainer.figures=false"]
SWEEP = ["train", "-m", "hydra/launcher=basic", *RUN[1:], "seed=0,1", "hydra.sweep.dir=sweep"]
CUT = "{} | head -1"
FULL = "{} > /dev/full"
NOTHING = "{} >&- 2>&- <&-"


def shell(folder: Path, line: str, *words: str) -> "subprocess.CompletedProcess[str]":
    command = shlex.join([sys.executable, "-m", "eigenode_cli", *words])
    script = "set -o pipefail; " + line.format(command)
    return subprocess.run(["bash", "-c", script], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("line", [CUT, FULL, NOTHING])
def test_a_run_goes_on(tmp_path: Path, line: str) -> None:
    done = shell(tmp_path, line, *RUN, "hydra.run.dir=run")
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (record["status"], record["steps"]) == ("finished", 20)
    lost = ["eigenode: standard output: No space left on device; what was printed is lost"]
    assert done.stderr.splitlines() == (lost if line == FULL else [])


def test_a_sweep_goes_on(tmp_path: Path) -> None:
    done = shell(tmp_path, CUT, *SWEEP)
    assert (done.returncode, done.stdout, done.stderr) == (0, "sweep  2 runs\n", "")
    for seed in (0, 1):
        (run,) = (tmp_path / "sweep").glob(f"*seed={seed}*/run.json")
        assert json.loads(run.read_text())["status"] == "finished"
    assert (tmp_path / "sweep" / "summary.csv").is_file()


@pytest.mark.parametrize("words", [["list"], ["train", "--cfg", "job"], ["train", "--help"]])
def test_what_is_only_printed_fails_on_a_full_disk_and_not_on_a_reader_who_has_enough(
    tmp_path: Path, words: list[str]
) -> None:
    done = shell(tmp_path, FULL, *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "No space left on device" in done.stderr
    done = shell(tmp_path, CUT, *words)
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)


def test_no_file_gets_the_number_of_a_closed_output(tmp_path: Path) -> None:
    script = (
        "import os, sys\n"
        "from eigenode_cli.commands.output import lasting_output\n"
        "with lasting_output():\n"
        "    file = open('mine', 'w')\n"
        "    print('not for the file')\n"
        "    os.write(1, b'nor this')\n"
        "    assert file.fileno() > 2, file.fileno()\n"
    )
    (tmp_path / "script.py").write_text(script)
    line = shlex.join([sys.executable, "script.py"]) + " >&- 2>&- <&-"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(["bash", "-c", line], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    assert (tmp_path / "mine").read_text() == ""
