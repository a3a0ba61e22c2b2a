"""Reading a run's folder: what is there, and what is said when something is not."""

import json
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.runs.reader import RecordError, read_run
from tests import fake_run

FILES = ("run.json", "metrics.csv", "solution.csv", "eigenvalues.csv", "data.csv")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of an oscillator's run."""
    return fake_run.write_oscillator(tmp_path / "run")


def replace(path: Path, old: str, new: str) -> None:
    """Replace the first occurrence of a text that must be there."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_everything_is_read(folder: Path) -> None:
    run = read_run(folder)
    assert (run.status, run.error, run.system, run.title, run.seed) == ("finished", None, "oscillator", "Oscillator", 0)
    assert run.grads == ("sol", "frq", "dmp", "osc")
    assert [(state.name, state.unit) for state in run.states] == [("s", "m"), ("v", "m/s")]
    assert run.metrics.step[[0, 1, -1]].tolist() == [0.0, 25.0, 5000.0]
    assert run.metrics.failed.sum() == 3
    assert run.solution.model.shape == run.solution.truth.shape == (2001, 2)
    assert run.solution.beyond.sum() == 1000
    assert run.eigenvalues.values.shape == (202,)
    assert run.data.mask.sum(axis=0).tolist() == [101, 0]


def test_numbers_come_back_to_the_last_digit(folder: Path) -> None:
    solution = read_run(folder).solution
    np.testing.assert_array_equal(solution.truth, fake_run.spiral(np.linspace(0.0, 20.0, 2001), -0.025 + 5.0j))


def test_empty_is_nan_and_never_zero(folder: Path) -> None:
    metrics = read_run(folder).metrics
    assert np.isnan(metrics.terms["sol"][metrics.failed]).all()
    assert np.isnan(metrics.dense_error[metrics.failed]).all()
    assert np.isfinite(metrics.terms["frq"]).all()


def test_own_terms_follow(folder: Path) -> None:
    lines = (folder / "metrics.csv").read_text().splitlines()
    lines = [lines[0] + ",energy", *(f"{line},{0.5 * i}" for i, line in enumerate(lines[1:]))]
    (folder / "metrics.csv").write_text("\n".join(lines) + "\n")
    metrics = read_run(folder).metrics
    assert metrics.own_terms == ("energy",)
    assert list(metrics.terms)[-1] == "energy"
    assert metrics.terms["energy"][3] == 1.5


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(RecordError, match=f"^{name} is missing in "):
        read_run(folder)


@pytest.mark.parametrize("name", FILES[1:])
def test_a_file_without_records(folder: Path, name: str) -> None:
    path = folder / name
    path.write_text(path.read_text().splitlines()[0] + "\n")
    with pytest.raises(RecordError, match=f"^{name}: holds no record"):
        read_run(folder)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("metrics.csv", "dense_error", "dense", r"metrics.csv: column dense_error is missing"),
        ("metrics.csv", ",ok,", ",fine,", r"metrics.csv, line 2: status is 'fine', not one of ok, underflow, "),
        ("metrics.csv", "\n25,", "\nx,", r"metrics.csv, line 3: step is 'x', not a number"),
        ("metrics.csv", "\n25,", "\n,", r"metrics.csv, line 3: step is not finite"),
        ("metrics.csv", "\n25,", "\n25,25,", r"metrics.csv, line 3: 15 cells in 14 columns"),
        ("solution.csv", "model_v", "model_w", r"solution.csv: column model_v is missing"),
        ("solution.csv", ",train", ",past", r"solution.csv, line 2: horizon is 'past', not one of train, beyond"),
        ("eigenvalues.csv", "target_im", "im_target", r"eigenvalues.csv: column target_im is missing"),
        ("data.csv", "t,s,v", "t,s", r"data.csv, line 2: 3 cells in 2 columns"),
        ("run.json", '"finished"', '"done"', r"run.json: status is 'done', not one of running, finished, failed"),
        ("run.json", '"finished"', "3", r"run.json: status is 3, not text"),
        ("run.json", '"parameters": 129', '"parameters": true', r"run.json: parameters is True, not an integer"),
        ("run.json", '"symbol": "v"', '"s": "v"', r"run.json: system\.states\[1\]\.symbol is missing"),
        ("run.json", '"protocol"', '"protocols"', r"run.json: config\.protocol is missing"),
        ("run.json", "{", "[", r"run.json: not valid JSON"),
    ],
)
def test_what_is_wrong_is_named(folder: Path, name: str, old: str, new: str, message: str) -> None:
    replace(folder / name, old, new)
    with pytest.raises(RecordError, match=message):
        read_run(folder)


def test_run_json_must_be_a_mapping(folder: Path) -> None:
    (folder / "run.json").write_text(json.dumps(["finished"]))
    with pytest.raises(RecordError, match="not a mapping"):
        read_run(folder)


def test_a_system_without_states(folder: Path) -> None:
    fake_run.change_json(folder, system={"name": "x", "title": "X", "states": []})
    with pytest.raises(RecordError, match=r"run.json: system\.states is empty"):
        read_run(folder)
