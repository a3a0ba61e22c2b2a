"""Damaged folders of runs: one line for what is wrong, and everything else is drawn or goes on."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eigenode_cli.batch import run as run_module
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.console import QuietDisplay
from eigenode_cli.reporting import figures
from tests import fake_run
from tests.batch.helpers import inside, without_time

WORDS = [
    "system=oscillator",
    "grads=sol+stb",
    "trainer.steps=20",
    "trainer.record_every=4",
    "trainer.checkpoint_every=5",
    "trainer.figures=false",
]
STOP = 12
LAST = "checkpoints/last.safetensors"
Damage = Callable[[Path], object]


class InterruptedAt(QuietDisplay):
    """The user's Ctrl-C at a record."""

    def __init__(self, step: int) -> None:
        self.step = step

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        if step == self.step:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was not disturbed, and one that was interrupted."""
    folder = tmp_path_factory.mktemp("runs")
    config = typed(compose(WORDS))
    for name, watch in (("whole", None), ("cut", InterruptedAt(STOP))):
        (folder / name).mkdir()
        run_module.train(config, folder / name, WORDS, quiet=True, watch=watch)
    return folder


@pytest.fixture
def cut(place: Path, tmp_path: Path) -> Path:
    return shutil.copytree(place / "cut", tmp_path / "cut")


def write(name: str, content: str | bytes) -> Damage:
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(data)


def lose(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


def change(name: str, edit: Callable[[list[str]], list[str]]) -> Damage:
    def damage(folder: Path) -> None:
        lines = (folder / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(edit(lines)))

    return damage


def setting(key: str, value: Any) -> Damage:
    """Another value of a dotted key of run.json, None for no such key."""

    def damage(folder: Path) -> None:
        record = json.loads((folder / "run.json").read_text())
        *path, last = key.split(".")
        node = record
        for part in path:
            node = node[part]
        if value is None:
            del node[last]
        else:
            node[last] = value
        (folder / "run.json").write_text(json.dumps(record))

    return damage


def folder_instead(folder: Path) -> None:
    (folder / "run.json").unlink()
    (folder / "run.json").mkdir()


def halve(folder: Path) -> None:
    content = (folder / LAST).read_bytes()
    (folder / LAST).write_bytes(content[: len(content) // 2])


SGD = {"name": "sgd", "lr": 0.1, "momentum": 0.9, "clip": None}
REFUSED: list[tuple[Damage, str]] = [
    (write("run.json", ""), "run.json: not valid JSON"),
    (write("run.json", "{"), "run.json: not valid JSON"),
    (write("run.json", b"\xff\xfe\x00"), "run.json: not valid JSON"),
    (write("run.json", "[" * 100_000), "run.json: cannot be read"),
    (write("run.json", "{}"), "run.json: status is missing"),
    (write("run.json", "[]"), "run.json: not a mapping"),
    (folder_instead, "not the folder of a run, it has no run.json"),
    (setting("version", 2), "run.json: version is 2, of a newer eigenode; this one reads up to 1"),
    (setting("version", "x"), "run.json: version is 'x', not a number from 1"),
    (setting("config", None), "run.json: config is missing"),
    (setting("config", {}), "run.json: config.system: missing"),
    (setting("config.system", "vdp"), "run.json: config.system: "),
    (setting("config.solver.rtol", -1), "run.json: config.solver.rtol=-1: must be above 0"),
    (setting("config.solver.rtol", None), "run.json: config.solver.rtol: missing"),
    (setting("config.solver.rtoll", 1), "run.json: config.solver.rtoll: "),
    (setting("config.seed", "x"), "run.json: config.seed: "),
    (setting("config.grads", "sol+foo"), "run.json: config.grads=sol+foo: unknown term 'foo'"),
    (setting("config.trainer.steps", 5), f"run.json: config.trainer.steps=5: {LAST} is of step {STOP}; at least"),
    (setting("config.network.hidden", [7]), f"run.json: config.network.hidden=[7]: makes 29 parameters, {LAST} holds"),
    (setting("config.optimizer", SGD), "run.json: config.optimizer.name=sgd: needs velocity, count"),
    (change("metrics.csv", lambda lines: [*lines[:2], "junk\n", *lines[3:]]), "metrics.csv, line 3: not a row"),
    (change("metrics.csv", lambda lines: ["step,sol\n", *lines[1:]]), "metrics.csv, line 1: not the columns"),
    (write("metrics.csv", b"\xff\xfe\x00\n"), "metrics.csv: cannot be read"),
    (write(LAST, ""), f"{LAST}: cannot be read"),
    (write(LAST, b"\x00" * 5000), f"{LAST}: cannot be read"),
    (halve, f"{LAST}: cannot be read"),
    (lambda folder: shutil.copy(folder / "checkpoints/step-000000.safetensors", folder / LAST), f"{LAST}: cannot be"),
]


@pytest.mark.parametrize(("damage", "said"), REFUSED)
def test_resume_refuses_and_changes_nothing(cut: Path, damage: Damage, said: str) -> None:
    damage(cut)
    before = {path: path.read_bytes() for path in cut.rglob("*") if path.is_file()}
    status, out, err = inside(cut.parent, "resume", "cut")
    assert (status, out) == (2, "")
    assert all(line.startswith("eigenode: error: ") for line in err.splitlines())
    assert said in err
    assert {path: path.read_bytes() for path in cut.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    "damage",
    [
        change("metrics.csv", lambda lines: [*lines, "16,0.1,0.0"]),  # a row that was being written
        lose(LAST),  # it starts again
        lambda folder: shutil.rmtree(folder / "checkpoints"),
        lose("data.csv"),
        write("checkpoints/last.json", "{"),
        setting("started", None),
        setting("version", None),  # of before there were versions
        setting("status", "failed"),
        setting("status", "running"),  # it was killed
    ],
)
def test_resume_goes_on_to_the_same_end(cut: Path, place: Path, damage: Damage) -> None:
    damage(cut)
    status, _, err = inside(cut.parent, "resume", "cut")
    assert (status, err) == (0, "")
    assert without_time(cut) == without_time(place / "whole")
    for name in ("solution.csv", "eigenvalues.csv", "data.csv", "checkpoints/step-000020.safetensors"):
        assert (cut / name).read_bytes() == (place / "whole" / name).read_bytes()
    assert json.loads((cut / "run.json").read_text())["status"] == "finished"
    assert not (cut / ".reserve").exists()


@pytest.mark.parametrize("damage", [lose("metrics.csv"), write("metrics.csv", "")])
def test_lost_records_are_no_reason_to_stop(cut: Path, damage: Damage) -> None:
    damage(cut)
    status, _, err = inside(cut.parent, "resume", "cut")
    assert (status, err) == (0, "")
    assert [row[0] for row in without_time(cut)] == ["step", "12", "16", "20"]


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a finished run; what is drawn of it is not rendered, which takes seconds."""
    monkeypatch.setattr(figures, "save", lambda figure, path: path.touch())
    return fake_run.write_oscillator(tmp_path / "run")


def names(out: str) -> list[str]:
    """Names of the figures that were drawn."""
    return list(dict.fromkeys(Path(line).stem for line in out.splitlines()))


ALL = ["convergence", "stability", "solution", "eigenvalues", "phase", "region"]
OF_METRICS, OF_SOLUTION = ["convergence", "stability"], ["solution", "phase"]
DRAWN: list[tuple[Damage, list[str], str]] = [
    (lose("metrics.csv"), OF_METRICS, "metrics.csv is missing"),
    (write("metrics.csv", ""), OF_METRICS, "metrics.csv: holds no record"),
    (write("metrics.csv", b"\xff\xfe\x00"), OF_METRICS, "metrics.csv: cannot be read"),
    (change("metrics.csv", lambda lines: [*lines[:4], "5,x\n"]), OF_METRICS, "metrics.csv, line 5: 2 cells in 14 col"),
    (change("metrics.csv", lambda lines: [lines[0].replace("sol", "soul"), *lines[1:]]), OF_METRICS, "column sol is"),
    (change("metrics.csv", lambda lines: [*lines, "5025,3"]), [], ""),  # a row that was being written
    (lose("solution.csv"), OF_SOLUTION, "solution.csv is missing"),
    (change("solution.csv", lambda lines: [*lines[:90], lines[90][:30]]), OF_SOLUTION, "solution.csv, line 91: "),
    (change("solution.csv", lambda lines: [*lines[:5], "x" + lines[5], *lines[6:]]), OF_SOLUTION, "line 6: t is 'x"),
    (write("solution.csv", "a,b\n1,2\n"), OF_SOLUTION, "solution.csv: column t is missing"),
    (write("solution.csv", b"\x00" * 4096), OF_SOLUTION, "solution.csv"),
    (lose("eigenvalues.csv"), ["eigenvalues", "region"], "eigenvalues.csv is missing"),
    (write("eigenvalues.csv", "t,mode,re,im,target_re,target_im\n"), ["eigenvalues", "region"], "holds no record"),
    (
        change("eigenvalues.csv", lambda lines: [lines[0], ",".join(["1e999"] * 6)]),
        ["eigenvalues", "region"],
        "t is not finite",
    ),
    (lose("data.csv"), ["convergence", "solution", "phase"], "data.csv is missing"),
    (setting("config.error", {}), ["convergence"], "run.json: config.error.sol is missing"),
]


@pytest.mark.parametrize(("damage", "left_out", "said"), DRAWN)
def test_what_is_whole_is_drawn(drawn: Path, damage: Damage, left_out: list[str], said: str) -> None:
    damage(drawn)
    status, out, err = inside(drawn.parent, "plot", "run")
    assert status == 0
    assert names(out) == [name for name in ALL if name not in left_out]
    assert len(err.splitlines()) == bool(left_out)
    assert said in err


@pytest.mark.parametrize("command", ["plot", "report"])
@pytest.mark.parametrize(("damage", "said"), REFUSED[:10])
def test_nothing_is_drawn_without_a_record(drawn: Path, damage: Damage, said: str, command: str) -> None:
    damage(drawn)
    status, out, err = inside(drawn.parent, command, "run")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err


def test_a_run_that_was_cut_off_is_drawn(cut: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "save", lambda figure, path: path.touch())
    status, out, err = inside(cut.parent, "plot", "cut")
    assert (status, names(out)) == (0, OF_METRICS)
    assert err.splitlines() == [
        f"eigenode: {name}.csv is missing in cut; the status of the run is interrupted"
        for name in ("solution", "eigenvalues")
    ]
    status, out, again = inside(cut.parent, "report", "cut")
    assert (status, out, again) == (0, "cut/report.html\n", err)
    page = (cut / "report.html").read_text()
    assert "solution.csv is missing" in page
    assert "interrupted by the user" in page


def test_a_run_that_was_never_built_has_a_page_and_no_figure(cut: Path) -> None:
    for key in ("system", "engine", "parameters"):
        setting(key, None)(cut)
    setting("status", "failed")(cut)
    (cut / "metrics.csv").unlink()
    (cut / "data.csv").unlink()
    status, out, err = inside(cut.parent, "plot", "cut")
    assert (status, out) == (2, "")
    assert "eigenode: error: metrics.csv is missing in cut; the status of the run is failed\n" in err
    status, out, _ = inside(cut.parent, "report", "cut")
    assert (status, out) == (0, "cut/report.html\n")
