"""README and the gate say the same, and only what is there."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def commands() -> list[str]:
    return [line for line in README.splitlines() if line.startswith("python3 -m venv")]


def test_the_gate_runs_the_readmes_test_command() -> None:
    assert len(commands()) == 2
    assert commands()[1] in (ROOT / ".ci" / "run").read_text()


def test_the_first_command_runs_the_main_job() -> None:
    assert commands()[0].endswith("eigenode train system=vdp grads=sol+frq+dmp+osc")


def test_every_file_that_it_points_to_exists() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert links
    for link in links:
        assert (ROOT / link).exists(), link


def test_declared_versions_agree() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11,<3.14"
    assert "Python 3.11 to 3.13" in README
    pinned = {
        line.split("==")[0].lower().replace("_", "-")
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if "==" in line
    }
    everything = [*project["dependencies"], *(d for extra in project["optional-dependencies"].values() for d in extra)]
    missing = {re.split(r"[<>=\[]", entry)[0].lower() for entry in everything} - pinned
    assert not missing
