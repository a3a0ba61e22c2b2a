"""The command itself, as a user runs it: what it writes, how it resumes, how it fails."""

import csv
import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file

from eigenode_cli.batch import run as run_module
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.console import QuietDisplay
from eigenode_cli.engines.combine import COMBINATIONS
from eigenode_cli.model.init import INITS
from eigenode_cli.terms import PAPER_TERMS
from tests.batch.helpers import eigenode, start

COLUMNS = "step,train_seconds,lr,sol,frq,dmp,stb,osc,stf,max_real,n_accepted,n_rejected,status,dense_error,test_error"
SYSTEMS = ("oscillator", "sparse_oscillator", "vdp")


def train(folder: Path, *words: str) -> Path:
    """The folder of `eigenode train WORDS`, which has to succeed."""
    status, out, err = eigenode(folder, "train", *words)
    assert (status, err) == (0, ""), err
    (line,) = (line for line in out.splitlines() if line.startswith("run "))
    return Path(line.split(maxsplit=1)[1])


def record(run: Path) -> dict[str, object]:
    return json.loads((run / "run.json").read_text())


def metrics(run: Path) -> list[dict[str, str]]:
    with (run / "metrics.csv").open() as file:
        return list(csv.DictReader(file))


def without_time(run: Path) -> list[list[str]]:
    rows = [line.split(",") for line in (run / "metrics.csv").read_text().splitlines()]
    return [row[:1] + row[2:] for row in rows]


def check_finished(run: Path, grads: str) -> None:
    written = record(run)
    assert written["status"] == "finished"
    assert written["parameters"] == 129
    assert written["grads"] == grads
    assert (run / "metrics.csv").read_text().splitlines()[0] == COLUMNS
    rows = metrics(run)
    assert rows[-1]["step"] == str(written["steps"])
    assert all(np.isfinite(float(row["sol"])) for row in rows)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with everything that a run writes."""
    return train(
        tmp_path_factory.mktemp("short"),
        "system=oscillator",
        "grads=OSC+sol+frq",
        "trainer.steps=12",
        "trainer.record_every=5",
        "trainer.checkpoint_every=10",
        "seed=3",
    )


def test_folder_holds_what_the_contract_says(short: Path) -> None:
    files = {path.relative_to(short).as_posix() for path in short.rglob("*") if path.is_file()}
    drawn = ("convergence", "stability", "solution", "eigenvalues", "phase")
    figures = {f"plots/{name}.{kind}" for name in drawn for kind in ("png", "pdf")}
    weights = [f"step-{step:06d}.safetensors" for step in (0, 10, 12)]
    checkpoints = {f"checkpoints/{name}" for name in (*weights, "last.safetensors", "last.json")}
    hydra = {f".hydra/{name}.yaml" for name in ("config", "hydra", "overrides")}
    tables = {"run.json", "metrics.csv", "solution.csv", "eigenvalues.csv", "data.csv", "report.html"}
    tables.add("equilibrium.csv")
    assert files == figures | checkpoints | hydra | tables | {".lock"}
    assert "oscillator_sol+frq+osc_seed3" in short.name


def test_record_of_the_run(short: Path) -> None:
    check_finished(short, "sol+frq+osc")
    assert [row["step"] for row in metrics(short)] == ["0", "5", "10", "12"]
    written = record(short)
    assert written["command"] == (
        "eigenode train system=oscillator grads=sol+frq+osc trainer.steps=12 trainer.record_every=5 "
        "trainer.checkpoint_every=10 seed=3"
    )
    for key in ("train_seconds", "compile_seconds", "wall_seconds", "engine", "versions", "git_commit", "final"):
        assert key in written
    assert written["final"]["sol"] == float(metrics(short)[-1]["sol"])  # type: ignore[index]
    losses = [float(metrics(short)[0][name] or "nan") for name in PAPER_TERMS]
    assert np.isfinite(losses).all()  # all six are recorded whatever grads is


def test_solution_and_dense_error_belong_together(short: Path) -> None:
    with (short / "solution.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["t", "truth_s", "truth_v", "model_s", "model_v", "horizon"]
    times = np.array([float(row["t"]) for row in rows])
    assert times[-1] == pytest.approx(20.0)
    train_part = np.array([row["horizon"] == "train" for row in rows])
    np.testing.assert_array_equal(train_part, times <= 10.0 + 1e-12)
    gap = np.abs([float(row["model_s"]) - float(row["truth_s"]) for row in rows])[train_part]
    assert gap.mean() == pytest.approx(float(metrics(short)[-1]["dense_error"]), rel=0.01)
    decay, omega = 0.025, np.sqrt(25.0 - 0.025**2)
    exact = np.exp(-decay * times) * (np.cos(omega * times) + decay / omega * np.sin(omega * times))
    np.testing.assert_allclose([float(row["truth_s"]) for row in rows], exact, atol=1e-8)


def test_eigenvalues_stand_beside_their_targets(short: Path) -> None:
    with (short / "eigenvalues.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["t", "mode", "re", "im", "target_re", "target_im"]
    assert len(rows) == 2 * 101
    np.testing.assert_allclose([float(row["target_re"]) for row in rows], -0.025, rtol=1e-12)
    largest = max(float(row["re"]) for row in rows)
    assert largest == pytest.approx(float(metrics(short)[-1]["max_real"]), rel=1e-9)


def test_checkpoints_rebuild_the_network(short: Path) -> None:
    weights = load_file(short / "checkpoints" / "step-000012.safetensors")
    assert {name: tuple(tensor.shape) for name, tensor in weights.items()} == {
        "layers.0.weight": (32, 2),
        "layers.0.bias": (32,),
        "layers.1.weight": (1, 32),
        "layers.1.bias": (1,),
    }
    last = load_file(short / "checkpoints" / "last.safetensors")
    names = ("layers.0.weight", "layers.0.bias", "layers.1.weight", "layers.1.bias")
    flat = np.concatenate([weights[name].numpy().ravel() for name in names])
    np.testing.assert_array_equal(last["theta"].numpy(), flat)
    assert {name for name in last if not name.startswith("optimizer.")} == {
        *names,
        "theta",
        "best_theta",
        "random_state",
    }
    for name in names:
        np.testing.assert_array_equal(last[name].numpy(), weights[name].numpy())
    assert json.loads((short / "checkpoints" / "last.json").read_text())["step"] == 12


def test_same_seed_gives_the_same_bytes(short: Path, tmp_path: Path) -> None:
    words = str(record(short)["command"]).split()[2:]
    assert without_time(train(tmp_path, *words)) == without_time(short)


def test_plot_draws_the_same_bytes_from_the_files_alone(short: Path) -> None:
    before = {path: path.read_bytes() for path in (short / "plots").iterdir()}
    for path in before:
        path.unlink()
    status, out, err = eigenode(short, "plot", ".")
    assert (status, err) == (0, "")
    assert {path: path.read_bytes() for path in (short / "plots").iterdir()} == before
    assert out.count("plots") == len(before)


def test_killed_run_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    every = ("trainer.steps=60", "trainer.record_every=3", "trainer.checkpoint_every=4")
    words = ("system=sparse_oscillator", "grads=sol+stb", "engine=torch", *every)
    process = start(tmp_path, "train", *words, "hydra.run.dir=cut")
    last = tmp_path / "cut" / "checkpoints" / "last.json"
    while process.poll() is None and not (last.exists() and json.loads(last.read_text())["step"] >= 16):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert record(tmp_path / "cut")["status"] == "running"  # nobody was left to write anything else
    assert len(metrics(tmp_path / "cut")) < 21
    status, _, err = eigenode(tmp_path, "resume", "cut")
    assert (status, err) == (0, "")
    whole = train(tmp_path, *words, "hydra.run.dir=whole")
    assert without_time(tmp_path / "cut") == without_time(tmp_path / whole)
    assert record(tmp_path / "cut")["status"] == "finished"


def test_pretraining_resumes_to_the_same_bytes(tmp_path: Path) -> None:
    """Cut in the first stage, and again in the second one; both engines and terms are chosen by the step alone."""
    peer = "eigenode_cli.terms.peers:derivative_matching"
    words = [
        "system=oscillator",
        "grads=sol+stb",
        f"+terms.match={peer}",
        "stages=[{terms:match,steps:30},{horizons:[0.5,1]}]",
        "trainer.record_every=1",
        "trainer.checkpoint_every=5",
    ]
    config = typed(compose([*words, "trainer.steps=60", "trainer.figures=false"]))
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    whole.mkdir()
    cut.mkdir()
    assert run_module.train(config, whole, words, quiet=True) == 0
    assert run_module.train(config, cut, words, quiet=True, watch=InterruptedAt(12)) == 130
    assert record(cut)["steps"] == 12
    assert run_module.resume(config, cut, record(cut), quiet=True, watch=InterruptedAt(47)) == 130
    assert run_module.resume(config, cut, record(cut), quiet=True) == 0
    assert without_time(cut) == without_time(whole)
    losses = {name: [float(row[name]) for row in metrics(whole)] for name in ("sol", "match")}
    assert losses["match"][29] < 0.98 * losses["match"][0]


def test_noise_shows_in_the_data_and_nowhere_else(tmp_path: Path) -> None:
    words = ("system=oscillator", "grads=sol+frq", "trainer.steps=1", "trainer.figures=false")
    clean = train(tmp_path, *words, "hydra.run.dir=clean")
    noisy = train(tmp_path, *words, "system.noise=0.1", "hydra.run.dir=noisy")
    first = [metrics(tmp_path / run)[0] for run in (clean, noisy)]
    changed = {name for name in first[0] if first[0][name] != first[1][name]}
    assert changed - {"train_seconds"} == {"sol"}
    shown = [np.genfromtxt(tmp_path / run / "data.csv", delimiter=",", skip_header=1)[:, 1] for run in (clean, noisy)]
    assert shown[0][0] == shown[1][0]
    assert np.std(shown[1] - shown[0]) == pytest.approx(0.1, rel=0.3)
    targets = [np.genfromtxt(tmp_path / run / "eigenvalues.csv", delimiter=",", names=True) for run in (clean, noisy)]
    np.testing.assert_array_equal(targets[0]["target_im"], targets[1]["target_im"])


class InterruptedAt(QuietDisplay):
    """The user's Ctrl-C at a record."""

    def __init__(self, step: int) -> None:
        self.step = step

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        del losses, rate
        if step == self.step:
            raise KeyboardInterrupt


def test_interrupted_run_says_how_to_go_on(tmp_path: Path) -> None:
    process = start(tmp_path, "train", "grads=sol", "trainer.steps=100000", "engine=torch", "hydra.run.dir=run")
    while process.poll() is None and not (tmp_path / "run" / "checkpoints" / "last.json").exists():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "eigenode resume" in err
    assert "Traceback" not in err
    assert record(tmp_path / "run")["status"] == "interrupted"


def test_field_that_blows_up_heals_and_says_so(tmp_path: Path) -> None:
    field = ("system=oscillator", "network=polynomial", "grads=sol+stb", "seed=10", "solver.max_steps=500")
    length = ("trainer.steps=200", "trainer.record_every=1", "hydra.run.dir=run")
    status, out, err = eigenode(tmp_path, "train", *field, *length)
    assert (status, err) == (0, "")
    assert "step 0: the solve failed (underflow)" in out
    assert "solvable again after" in out
    rows = metrics(tmp_path / "run")
    assert rows[0]["status"] == "underflow"
    assert (rows[0]["sol"], rows[0]["dense_error"]) == ("", "")
    assert float(rows[0]["stb"]) > 0.0
    assert rows[-1]["status"] == "ok"
    assert int(record(tmp_path / "run")["unsolvable_steps"]) > 0  # type: ignore[call-overload]


def test_stop_on_an_unsolvable_field_fails_by_name(tmp_path: Path) -> None:
    words = ("system=oscillator", "network=polynomial", "grads=sol+stb", "seed=10", "trainer.on_unsolvable=stop")
    status, _, err = eigenode(tmp_path, "train", *words, "solver.max_steps=500", "hydra.run.dir=run")
    assert status == 1
    assert err.startswith("eigenode: failed: the solve failed (underflow) at step 0; trainer.on_unsolvable=stabilise")
    assert record(tmp_path / "run")["status"] == "failed"
    assert len(metrics(tmp_path / "run")) == 1


def test_users_own_term_trains_and_is_recorded(tmp_path: Path) -> None:
    source = "def calm(trajectory, spectra, times):\n    return (trajectory[:, 1] ** 2).mean()\n"
    (tmp_path / "mine.py").write_text(source)
    run = train(tmp_path, "system=oscillator", "+terms.calm=mine:calm", "grads=sol+calm", "trainer.steps=2")
    assert float(metrics(run)[0]["calm"]) > 0.0
    assert list(metrics(run)[0])[-1] == "calm"


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_users_own_term_that_raises(engine: str, tmp_path: Path) -> None:
    """Recorded only, its column is empty; in grads, the run fails and names it."""
    (tmp_path / "mine.py").write_text("def calm(times):\n    raise OSError('gone')\n")
    words = ("train", "system=oscillator", "+terms.calm=mine:calm", f"engine={engine}", "trainer.steps=2")
    status, out, err = eigenode(tmp_path, *words, "grads=sol", "trainer.record_every=1", "hydra.run.dir=recorded")
    assert (status, err) == (0, "")
    assert out.count("terms.calm=mine:calm: OSError: gone (only recorded, so the run goes on") == 1
    assert [row["calm"] for row in metrics(tmp_path / "recorded")] == ["", "", ""]
    assert float(metrics(tmp_path / "recorded")[2]["sol"]) > 0.0
    status, _, err = eigenode(tmp_path, *words, "grads=sol+calm", "hydra.run.dir=trained")
    assert status == 1
    assert err == "eigenode: failed: terms.calm=mine:calm: OSError: gone (traceback in error.txt)\n"
    assert record(tmp_path / "trained")["status"] == "failed"
    assert "raise OSError('gone')" in (tmp_path / "trained" / "error.txt").read_text()


@pytest.mark.parametrize("system", SYSTEMS)
def test_each_system_trains(system: str, tmp_path: Path) -> None:
    check_finished(train(tmp_path, f"system={system}", "grads=sol+stb", "trainer.steps=50"), "sol+stb")


@pytest.mark.parametrize("name", COMBINATIONS)
def test_each_combination_trains(name: str, tmp_path: Path) -> None:
    words = ("system=oscillator", "grads=sol+stb", "trainer.steps=50", f"combine={name}")
    check_finished(train(tmp_path, *words), "sol+stb")


@pytest.mark.parametrize("name", INITS)
def test_each_initialisation_trains(name: str, tmp_path: Path) -> None:
    words = ("system=oscillator", "grads=sol+stb", "trainer.steps=50", f"network.init={name}")
    check_finished(train(tmp_path, *words), "sol+stb")


def test_a_stated_step_is_recorded_and_drawn(tmp_path: Path) -> None:
    run = train(
        tmp_path, "system=oscillator", "system.d=50", "grads=stp+sol", "stp.step=0.1", "trainer.steps=3", "seed=1"
    )
    rows = metrics(run)
    assert list(rows[0]) == [*COLUMNS.split(","), "stp"]
    assert all(float(row["stp"]) >= 0.0 for row in rows)
    assert (run / "plots" / "region.png").is_file()
    assert record(run)["grads"] == "sol+stp"
    status, _, err = eigenode(tmp_path, "train", "grads=sol+stp", "stp.method=euler")
    assert status == 2
    assert "grads=sol+stp: stp has no solver to keep to; state stp.step=... in s, and stp.method" in err
    status, _, err = eigenode(tmp_path, "train", "stp.method=euler")
    assert (status, err) == (2, "eigenode: error: stp.method: no effect, no step is stated; write stp.step=... in s\n")
