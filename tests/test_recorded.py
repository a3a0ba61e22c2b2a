"""Runs from Python: started, read as tables, simulated, drawn; warm starts, stopping, the weights that are kept."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from safetensors.numpy import load_file

import eigenode_cli as en
from eigenode_cli.errors import UserError
from tests.batch.helpers import inside

SHORT = ("system=oscillator", "trainer.steps=20", "trainer.record_every=5", "trainer.figures=false")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> en.RecordedRun:
    return en.train(*SHORT, "grads=sol+frq", folder=tmp_path_factory.mktemp("runs") / "one")


def test_its_tables_are_data_frames(run: en.RecordedRun) -> None:
    assert run.status == "finished"
    assert list(run.metrics["step"]) == [0, 5, 10, 15, 20]
    assert run.metrics["sol"].dtype == np.float64
    assert {"truth_s", "model_s", "horizon"} < set(run.solution.columns)
    assert len(run.data) == run.config.system.points
    assert {"mode", "re", "target_re"} < set(run.eigenvalues.columns)


def test_training_prints_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    en.train(*SHORT, folder=tmp_path / "quiet")
    assert capsys.readouterr() == ("", "")


def test_it_is_the_run_of_the_command(run: en.RecordedRun, tmp_path: Path) -> None:
    status, _, err = inside(tmp_path, "train", *SHORT, "grads=sol+frq", "hydra.run.dir=two")
    assert (status, err) == (0, "")
    assert (tmp_path / "two" / "solution.csv").read_bytes() == (run.folder / "solution.csv").read_bytes()
    assert json.loads((tmp_path / "two" / "run.json").read_text())["config"] == run.record["config"]
    assert (run.folder / ".hydra" / "config.yaml").is_file()


def test_its_model_simulates(run: en.RecordedRun) -> None:
    times = run.solution["t"].to_numpy()
    states = run.simulate(times)
    # the run's own solver has a tolerance of 1e-3
    np.testing.assert_allclose(states[:, 0], run.solution["model_s"], atol=0.02)
    other = run.simulate([0.0, 0.5], [0.5, 0.1])
    np.testing.assert_array_equal(other[0], [0.5, 0.1])
    spectra = run.spectra(states[:5])
    assert spectra.shape == (5, 2)
    with pytest.raises(ValueError, match="give one value for each of s, v"):
        run.simulate(times, [1.0])


def test_it_is_compared_with_the_truth(run: en.RecordedRun) -> None:
    found = run.evaluate()
    dense = run.metrics["dense_error"].iloc[-1]
    assert found.errors.loc["s", "mean"] == pytest.approx(dense, rel=0.05)
    other = run.evaluate(initial_state=[0.5, 0.0], horizon=2.0)
    assert other.table["t"].iloc[-1] == 2.0
    truth = en.Truth(en.Oscillator(), (0.5, 0.0)).states(other.table["t"].to_numpy())
    np.testing.assert_allclose(other.table[["truth_s", "truth_v"]], truth, atol=1e-8)


def test_its_weights_at_a_step(run: en.RecordedRun) -> None:
    start, end = run.field(0), run.field()
    weights = load_file(run.folder / "checkpoints" / "step-000000.safetensors")["layers.0.weight"]
    np.testing.assert_array_equal(start.network.state_dict()["layers.0.weight"].numpy(), weights)
    assert not np.array_equal(end.network.state_dict()["layers.0.weight"].numpy(), weights)
    with pytest.raises(UserError, match="no checkpoint of step 7; there are 0, 20"):
        run.field(7)


def test_its_figures_are_matplotlib_objects(run: en.RecordedRun) -> None:
    for name in run.figures:
        assert isinstance(run.figure(name), Figure)
    with pytest.raises(ValueError, match="figure bode: choose from convergence, stability"):
        run.figure("bode")


def test_wrong_settings_and_folders(run: en.RecordedRun, tmp_path: Path) -> None:
    with pytest.raises(UserError) as caught:
        en.train("system=vpd", "trainer.steps=0")
    assert len(caught.value.faults) == 2
    with pytest.raises(UserError, match="holds a run already"):
        en.train(*SHORT, folder=run.folder)
    with pytest.raises(UserError, match="no such folder"):
        en.load_run(tmp_path / "nowhere")


def test_evaluate_on_the_command_line(run: en.RecordedRun, tmp_path: Path) -> None:
    words = ("system.initial_state=[0.5,0.0]", "system.horizon=2")
    status, out, err = inside(tmp_path, "evaluate", str(run.folder), *words, "--output", "found.csv", "--points", "11")
    assert (status, err) == (0, "")
    assert "oscillator over 2 s from [0.5, 0.0]" in out
    assert len((tmp_path / "found.csv").read_text().splitlines()) == 12
    status, _, err = inside(tmp_path, "evaluate", str(run.folder), "system.horizn=2", "trainer.steps=3")
    assert status == 2
    assert "did you mean system.horizon?" in err.splitlines()[0]
    assert len(err.splitlines()) == 2


def test_warm_start(run: en.RecordedRun, tmp_path: Path) -> None:
    warm = en.train(*SHORT, f"trainer.start={run.folder}", folder=tmp_path / "warm")
    first, last = (
        load_file(folder / "checkpoints" / name)
        for folder, name in ((warm.folder, "step-000000.safetensors"), (run.folder, "step-000020.safetensors"))
    )
    for name, weights in first.items():
        np.testing.assert_array_equal(weights, last[name])
    assert warm.metrics["sol"].iloc[0] == run.metrics["sol"].iloc[-1]


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("network.hidden=[16]",), "layers.0.bias has the shape (32,) there, (16,) here"),
        (("trainer.start=nowhere",), "no such folder"),
        (("trainer.start=nowhere.safetensors",), "no such file"),
    ],
)
def test_a_warm_start_that_does_not_fit(
    run: en.RecordedRun, tmp_path: Path, words: tuple[str, ...], fault: str
) -> None:
    start = () if "start" in words[0] else (f"trainer.start={run.folder}",)
    status, _, err = inside(tmp_path, "train", *SHORT, *start, *words)
    assert status == 2
    assert fault in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "outputs").exists()


def test_stopping_and_the_best_weights(tmp_path: Path) -> None:
    words = ("system=oscillator", "grads=sol", "trainer.figures=false", "optimizer.lr=1", "trainer.record_every=5")
    whole = en.train(*words, "trainer.steps=300", folder=tmp_path / "whole").metrics
    lowest = int(whole["step"][whole["sol"].idxmin()])
    assert lowest < 300
    kept = en.train(*words, "trainer.steps=300", "trainer.keep=best", folder=tmp_path / "kept")
    assert kept.record["best_step"] == kept.record["final"]["step"] == lowest
    assert kept.record["final"]["sol"] == whole["sol"].min()
    assert (kept.folder / "checkpoints" / f"step-{lowest:06d}.safetensors").is_file()
    dense = np.abs(kept.solution["truth_s"] - kept.solution["model_s"])[kept.solution["horizon"] == "train"].mean()
    assert dense == pytest.approx(whole["dense_error"][whole["sol"].idxmin()], rel=1e-2)
    stopped = en.train(*words, "trainer.steps=300", "trainer.stop.patience=4", folder=tmp_path / "stopped")
    assert stopped.status == "finished"
    assert "no lower sum of the terms in 4 records" in stopped.record["stopped"]
    assert stopped.record["steps"] < 300
    enough = en.train(*words, "trainer.steps=300", "trainer.stop.sol=0.6", folder=tmp_path / "enough").metrics["sol"]
    assert enough.iloc[-1] <= 0.6 < enough.iloc[:-1].min()


def test_a_stopped_run_goes_on(tmp_path: Path) -> None:
    words = ("train", *SHORT[:1], "grads=sol", "trainer.record_every=5", "trainer.figures=false")
    assert inside(tmp_path, *words, "trainer.steps=40", "trainer.stop.sol=100", "hydra.run.dir=run")[0] == 0
    assert json.loads((tmp_path / "run" / "run.json").read_text())["steps"] == 0
    status, _, err = inside(tmp_path, "resume", "run", "trainer.stop.sol=null")
    assert (status, err) == (0, "")
    assert json.loads((tmp_path / "run" / "run.json").read_text())["steps"] == 40
    status, _, err = inside(tmp_path, "resume", "run", "trainer.steps=30", "optimizer.lr=1")
    assert status == 2
    assert "optimizer.lr=1: can't change here" in err
    status, _, err = inside(tmp_path, "resume", "run", "trainer.steps=30")
    assert (status, err) == (2, "eigenode: error: trainer.steps=30: the run has done 40; give more of them\n")
