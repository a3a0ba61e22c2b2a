"""The wheel holds everything: what is installed does all that a clone does."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_wheel_runs_from_another_folder(tmp_path: Path) -> None:
    wheels = tmp_path / "wheels"
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(wheels), str(ROOT)]
    subprocess.run(build, check=True)
    (wheel,) = wheels.glob("eigenode-*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    package = site / "eigenode_cli"
    for folder in ("configs", "experiments"):
        shipped = {path.relative_to(ROOT / folder) for path in (ROOT / folder).rglob("*.yaml")}
        assert {path.relative_to(package / folder) for path in (package / folder).rglob("*.yaml")} == shipped
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(site)}
    run = [sys.executable, "-m", "eigenode_cli"]
    train = ["train", "system=oscillator", "trainer.steps=3", "hydra.run.dir=run"]
    for words in (["validate"], train, ["export", "run", "--to", "c"]):
        done = subprocess.run(
            [*run, *words], cwd=elsewhere, env=environment, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
    assert (elsewhere / "run" / "report.html").exists()
