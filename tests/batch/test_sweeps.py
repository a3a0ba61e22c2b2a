"""Sweeps as a user runs them, by joblib in processes of their own."""

import json
import signal
from pathlib import Path
from time import monotonic, sleep

import pytest

from tests.batch.helpers import BASIC, SHORT, assert_equal_sweeps, eigenode, inside, rows, runs, start

SWEEP = ("train", "-m", *SHORT, "grads=sol,sol+frq", "seed=range(2)")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which SWEEP ran once, and its output."""
    folder = tmp_path_factory.mktemp("sweep")
    status, out, err = eigenode(folder, *SWEEP)
    assert (status, err) == (0, "")
    (folder / "out.txt").write_text(out)
    return folder


@pytest.fixture
def sweep(place: Path) -> Path:
    (folder,) = (place / "outputs").iterdir()
    return folder


def test_a_sweep_has_a_folder_for_each_run_and_a_summary(sweep: Path) -> None:
    settings = "system=oscillator,trainer.record_every=10,trainer.steps=20"
    expected = {f"grads={grads},seed={seed},{settings}" for grads in ("sol", "sol+frq") for seed in (0, 1)}
    assert runs(sweep).keys() == expected
    summary = rows(sweep)
    assert [row["folder"] for row in summary] == [row["folder"] for row in summary if row["folder"] in expected]
    for row in summary:
        record = json.loads((sweep / row["folder"] / "run.json").read_text())
        assert row["status"] == record["status"] == "finished"
        assert [row["grads"], row["seed"]] == [record["grads"], str(record["seed"])]
        for name in ("sol", "frq", "dmp", "stb", "osc", "stf", "dense_error", "max_real"):
            final = record["final"][name]  # null where nothing could be compared
            assert row[name] == ("" if final is None else repr(final))
        assert not list((sweep / row["folder"] / "plots").glob("*"))
    assert {path.name for path in (sweep / "plots").iterdir()} == {"summary.png", "summary.pdf"}


def test_what_a_sweep_prints(place: Path, sweep: Path) -> None:
    lines = (place / "out.txt").read_text().splitlines()
    assert lines[:2] == ["sweep  4 runs", f"folder {sweep.relative_to(place)}"]
    assert "sweep  4/4  4 finished, 0 failed, 0 running" in lines
    header = next(index for index, line in enumerate(lines) if line.split()[:3] == ["grads", "runs", "failed"])
    assert [line.split()[:3] for line in lines[header + 1 : header + 3]] == [["sol", "2", "0"], ["sol+frq", "2", "0"]]


def test_the_same_command_skips_what_is_finished(place: Path, sweep: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in sweep.glob("*/run.json")}
    words = (SWEEP[0], *reversed(SWEEP[2:]), "-m", BASIC)  # neither order nor launcher matters
    status, out, _ = inside(place, *words)
    assert (status, out.splitlines()[0]) == (0, "sweep  4 runs, 4 finished already, skipped")
    assert {path: path.stat().st_mtime_ns for path in sweep.glob("*/run.json")} == before


def test_results_do_not_depend_on_the_launcher(place: Path, sweep: Path) -> None:
    status, _, err = inside(place, *SWEEP, BASIC, "hydra.sweep.dir=basic")
    assert (status, err) == (0, "")
    assert_equal_sweeps(sweep, place / "basic")


def test_a_run_of_a_sweep_is_the_run_alone(place: Path, sweep: Path) -> None:
    status, _, err = inside(
        place, "train", *SHORT, "grads=sol+frq", "seed=1", "trainer.figures=false", "hydra.run.dir=alone/run"
    )
    assert (status, err) == (0, "")
    name = "grads=sol+frq,seed=1,system=oscillator,trainer.record_every=10,trainer.steps=20"
    (place / "twin").mkdir()
    (place / "twin" / "run").symlink_to(sweep / name)
    assert_equal_sweeps(place / "alone", place / "twin")


def test_more_seeds_join_a_folder_and_other_settings_do_not(place: Path, sweep: Path) -> None:
    words = ("train", "-m", *SHORT, "grads=sol", BASIC, "hydra.sweep.dir=grown")
    assert inside(place, *words, "seed=range(1)")[0] == 0
    status, out, _ = inside(place, *words, "seed=range(2)")
    assert (status, out.splitlines()[0]) == (0, "sweep  2 runs, 1 finished already, skipped")
    assert len(rows(place / "grown")) == 2
    status, _, err = inside(place, *words, "seed=range(2)", "optimizer.lr=0.1")
    assert (status, err.count("\n")) == (2, 1)
    assert "hydra.sweep.dir=grown: holds a sweep with other settings" in err


@pytest.fixture
def failing(tmp_path: Path) -> Path:
    """A folder with a term of the user's that fails for one of the runs."""
    (tmp_path / "fragile.py").write_text(
        "import os\n"
        "def sound(trajectory, spectra, times):\n    return trajectory.square().mean()\n"
        "def broken(trajectory, spectra, times):\n"
        "    if not os.path.exists('mended'):\n        raise RuntimeError('out of glue')\n"
        "    return trajectory.square().mean()\n"
    )
    return tmp_path


def test_a_failing_run_does_not_stop_the_others(failing: Path) -> None:
    words = ("train", "-m", *SHORT, "grads=sol+own", "terms.own=fragile:sound,fragile:broken", "hydra.sweep.dir=here")
    status, out, err = eigenode(failing, *words)
    assert status == 1
    (bad,) = [row for row in rows(failing / "here") if row["status"] == "failed"]
    (good,) = [row for row in rows(failing / "here") if row["status"] == "finished"]
    assert (bad["terms.own"], good["terms.own"]) == ("fragile:broken", "fragile:sound")
    assert "out of glue" in bad["error"]
    assert (bad["sol"], bad["max_real"]) == ("", "")
    repeat = "eigenode train system=oscillator trainer.steps=20 trainer.record_every=10 grads=sol+own "
    repeat += "'++terms.own=fragile\\:broken'"
    lines = err.splitlines()
    assert lines[0] == "1 of 2 runs failed"
    assert lines[1].startswith(f"  {bad['folder']}: ")
    assert lines[2] == f"    repeat it with: {repeat}"
    error = (failing / "here" / bad["folder"] / "error.txt").read_text()
    assert error.splitlines()[:2] == ["repeat it with:", repeat]
    assert "Traceback" in error
    assert "RuntimeError: out of glue" in error
    assert ["fragile:broken", "1", "1"] in [line.split()[:3] for line in out.splitlines()]

    (failing / "mended").touch()  # the same command runs what failed again, and nothing else
    status, out, err = eigenode(failing, *words)
    assert (status, err, out.splitlines()[0]) == (0, "", "sweep  2 runs, 1 finished already, skipped")
    assert not (failing / "here" / bad["folder"] / "error.txt").exists()


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["grads=sol,sol+foo"], "unknown term 'foo'"),
        (["seed=range(0)"], "an empty sweep, no run would start"),
        (["seed=0,1", "repetitions=3"], "with -m sweep over the seeds instead: 'seed=range(3)'"),
        (["seed=0,1", "hydra.sweep.subdir=x"], "each run's folder is named by its settings"),
        (["seed=0,1", "hydra/launcher=job"], "unknown hydra/launcher 'job', did you mean joblib?"),
    ],
)
def test_refused_before_anything_runs(tmp_path: Path, words: list[str], answer: str) -> None:
    status, out, err = inside(tmp_path, "train", "-m", *words)
    assert (status, out) == (2, "")
    assert answer in err
    assert all(line.startswith("eigenode: error: ") for line in err.splitlines())
    assert list(tmp_path.iterdir()) == []


def wait_for(folder: Path, status: str, count: int, seconds: float = 120.0) -> None:
    """Until as many runs have the status; runs come and go while this looks."""
    until = monotonic() + seconds
    while monotonic() < until:
        texts = [path.read_text() for path in folder.glob("*/run.json")]
        if sum(f'"status": "{status}"' in text for text in texts) >= count:
            return
        sleep(0.02)
    raise TimeoutError(f"no {count} runs {status} in {seconds} s")


@pytest.mark.slow
def test_ctrl_c_and_resume(tmp_path: Path) -> None:
    words = ("train", "-m", "system=oscillator", "grads=sol", "seed=range(3)", "trainer.steps=6000")
    words = (*words, "hydra.sweep.dir=cut", "hydra.launcher.n_jobs=1")
    process = start(tmp_path, *words)
    wait_for(tmp_path / "cut", "running", 1)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "3 of 3 runs are left; go on with: eigenode resume cut" in err
    assert [row["status"] for row in rows(tmp_path / "cut")] == ["interrupted", "waiting", "waiting"]
    status, out, err = eigenode(tmp_path, "resume", "cut")
    assert (status, err, out.splitlines()[0]) == (0, "", "sweep  3 runs, 1 resumed")
    assert eigenode(tmp_path, *words[:-2], "hydra.sweep.dir=whole")[0] == 0
    assert_equal_sweeps(tmp_path / "cut", tmp_path / "whole")


def test_the_page_of_a_sweep(place: Path, sweep: Path) -> None:
    status, out, err = inside(place, "report", sweep.name)
    assert (status, err, out) == (0, "", f"{sweep.relative_to(place) / 'report.html'}\n")
    page = (sweep / "report.html").read_text()
    assert "A sweep of 4 runs" in page
    assert "data:image/svg+xml;base64," in page
    assert all(name in page for name in runs(sweep))
    assert "http" not in page.replace('http-equiv="Content-Security-Policy"', "")
