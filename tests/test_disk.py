"""Full and read-only disks: one line, what was saved stays usable, and it goes on once there is room."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from eigenode_cli.batch import run as run_module
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.console import QuietDisplay
from eigenode_cli.reporting import figures
from eigenode_cli.runs.atomic import WriteError, write_json, write_text
from tests.batch.helpers import inside, without_time
from tests.disk import Disk, small_disk
from tests.test_damage import WORDS, place

__all__ = ["place"]  # a fixture
SAVED = ("metrics.csv", "checkpoints/last.safetensors")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    with small_disk(tmp_path / "disk") as made:
        yield made


class Filling(QuietDisplay):
    """Lets the disk be full but for `free` bytes from the record of a step on."""

    def __init__(self, disk: Disk, step: int, free: int) -> None:
        self.disk, self.step, self.free = disk, step, free

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        if step == self.step:
            self.disk.fill(self.free)


def check_it_goes_on(folder: Path, whole: Path) -> None:
    """Resume, or train where nothing had begun, to the bytes of the run that was not disturbed."""
    command = ["resume", "."] if (folder / "run.json").exists() else ["train", *WORDS, "hydra.run.dir=."]
    status, _, err = inside(folder, *command)
    assert (status, err) == (0, "")
    assert without_time(folder) == without_time(whole)
    for name in ("solution.csv", "eigenvalues.csv", "checkpoints/step-000020.safetensors"):
        assert (folder / name).read_bytes() == (whole / name).read_bytes()
    assert not list(folder.rglob("*.draft"))


@pytest.mark.parametrize(("step", "free"), [(0, 0), (4, 0), (8, 5_000), (12, 12_000), (16, 0), (20, 0), (20, 20_000)])
def test_a_disk_that_fills_while_it_trains(disk: Disk, place: Path, step: int, free: int) -> None:
    folder = disk.folder / "run"
    folder.mkdir()
    status = run_module.train(typed(compose(WORDS)), folder, WORDS, quiet=True, watch=Filling(disk, step, free))
    record = json.loads((folder / "run.json").read_text())
    assert (status, record["status"]) == (1, "interrupted")
    assert record["error"].startswith(f"cannot write {folder}/")
    assert record["error"].endswith(("No space left on device", "File too large"))
    assert not list(folder.rglob("*.draft"))
    disk.clear()
    check_it_goes_on(folder, place / "whole")


@pytest.mark.parametrize("free", [0, 4_096, 60_000, 70_000])
def test_a_disk_that_is_full_before_it_begins(disk: Disk, place: Path, free: int) -> None:
    disk.fill(free)
    status, out, err = inside(disk.folder, "train", *WORDS, "hydra.run.dir=run")
    assert (status, out) == (2, "") or (free > 65_536 and status in (1, 2))
    assert all(line.startswith(("eigenode: ", "go on with: ")) for line in err.splitlines())
    assert "No space left on device" in err or "File too large" in err
    disk.clear()
    check_it_goes_on(disk.folder / "run", place / "whole")


def test_a_full_disk_does_not_spoil_what_is_there(disk: Disk, place: Path) -> None:
    target = disk.folder / "run.json"
    write_json(target, {"status": "running"})
    disk.fill()
    with pytest.raises(WriteError, match=r"^cannot write .*run\.json: "):
        write_text(target, "x" * 100_000)
    assert json.loads(target.read_text()) == {"status": "running"}
    assert not target.with_name("run.json.draft").exists()


def test_resume_on_a_full_disk_changes_nothing(disk: Disk, place: Path) -> None:
    folder = disk.folder / "run"
    folder.mkdir()
    config = typed(compose(WORDS))
    assert run_module.train(config, folder, WORDS, quiet=True, watch=Filling(disk, 8, 0)) == 1
    disk.fill()
    before = {name: (folder / name).read_bytes() for name in ("run.json", *SAVED)}
    status, out, err = inside(disk.folder, "resume", "run")
    assert (status, out) == (2, "")
    assert err.startswith("eigenode: error: cannot write ")
    assert err.count("\n") == 1
    assert {name: (folder / name).read_bytes() for name in before} == before


def test_a_read_only_folder(disk: Disk, place: Path) -> None:
    folder = disk.folder / "run"
    folder.mkdir()
    assert run_module.train(typed(compose(WORDS)), folder, WORDS, quiet=True, watch=Filling(disk, 8, 0)) == 1
    disk.clear()
    disk.mode("ro")
    try:
        for words in (
            ("resume", "run"),
            ("plot", "run"),
            ("report", "run"),
            ("train", *WORDS),
            ("train", *WORDS, "hydra.run.dir=other"),
            ("train", "-m", *WORDS, "seed=0,1"),
        ):
            status, out, err = inside(disk.folder, *words)
            assert (status, out) == (2, ""), words
            assert err.startswith("eigenode: error: "), words
            assert err.count("\n") == 1, words
            assert "Read-only file system" in err or "Permission denied" in err, words
    finally:
        disk.mode("rw")


def test_figures_that_cannot_be_written_leave_the_run_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(figure: object, path: Path) -> None:
        raise WriteError(f"cannot write {path}: No space left on device")

    monkeypatch.setattr(figures, "save", full)
    words = [*WORDS[:-1], "trainer.figures=true"]
    assert run_module.train(typed(compose(words)), tmp_path, words) == 0
    path = tmp_path / "plots" / "convergence.png"
    error = capsys.readouterr().err
    assert f"cannot write {path}: No space left on device" in error
    assert error.count("\n") == 1
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "finished"


def test_outputs_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "outputs").write_text("mine")
    status, _, err = inside(tmp_path, "train", *WORDS)
    assert (status, err) == (2, "eigenode: error: outputs: is a file; name a folder\n")
    status, _, err = inside(tmp_path, "train", "-m", *WORDS, "seed=0,1")
    assert (status, err.count("\n")) == (2, 1)
    assert err.startswith("eigenode: error: ")


@pytest.mark.parametrize("words", [("hydra.run.dir=" + "x" * 300,), ("-m", "seed=0,1", "hydra.sweep.dir=" + "x" * 300)])
def test_a_name_that_is_too_long(tmp_path: Path, words: tuple[str, ...]) -> None:
    status, out, err = inside(tmp_path, "train", *WORDS, *words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("eigenode: error: ")
    assert "File name too long" in err


@pytest.mark.parametrize("command", ["plot", "report", "resume"])
def test_a_name_that_no_disk_takes_is_no_folder(tmp_path: Path, command: str) -> None:
    status, _, err = inside(tmp_path, command, "x" * 300)
    assert (status, err) == (2, f"eigenode: error: {'x' * 300}: no such folder\n")
