"""The same sweep through every launcher: the same numbers. A tier of its own, with the extras `slurm` and `ray`."""

import importlib.util
from pathlib import Path

import pytest

from tests.batch.helpers import SHORT, assert_equal_sweeps, eigenode, runs

MODULES = {"submitit_local": "hydra_plugins.hydra_submitit_launcher", "ray": "hydra_plugins.hydra_ray_launcher"}
SWEEP = ("train", "-m", *SHORT, "grads=sol,sol+frq+dmp", "seed=range(6)")


@pytest.fixture(scope="module")
def joblib(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep of twelve runs through joblib."""
    folder = tmp_path_factory.mktemp("joblib")
    status, _, err = eigenode(folder, *SWEEP, "hydra.sweep.dir=sweep")
    assert (status, err) == (0, "")
    assert len(runs(folder / "sweep")) == 12
    return folder / "sweep"


@pytest.mark.slow
@pytest.mark.parametrize("launcher", MODULES)
def test_the_same_numbers(launcher: str, joblib: Path, tmp_path: Path) -> None:
    if importlib.util.find_spec(MODULES[launcher]) is None:
        pytest.skip(f"{launcher} is not installed: pip install '.[slurm,ray]'")
    status, out, err = eigenode(tmp_path, *SWEEP, f"hydra/launcher={launcher}", "hydra.sweep.dir=sweep")
    assert status == 0, err
    assert "sweep  12/12  12 finished, 0 failed, 0 running" in out.splitlines()
    assert_equal_sweeps(joblib, tmp_path / "sweep")


@pytest.mark.parametrize(
    ("launcher", "extra"), [("submitit_local", "slurm"), ("submitit_slurm", "slurm"), ("ray", "ray")]
)
def test_a_launcher_that_is_not_installed(launcher: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from eigenode_cli.batch import launch  # noqa: PLC0415

    monkeypatch.setattr(launch.importlib.util, "find_spec", lambda name: None)
    words = ["hydra.sweeper.max_batch_size=3", f"hydra/launcher={launcher}"]
    assert launch.launcher_faults(words) == [
        f"hydra/launcher={launcher}: not installed; pip install 'eigenode[{extra}]'"
    ]
    assert launch.launcher_faults(["hydra/launcher=basic", "hydra/launcher=joblib"]) == []
