"""docs/extending.md from an empty folder: its files are written, its commands run, what they print is as it says."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.batch.helpers import inside

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"
PART = re.compile(r"(?:^`([\w/.]+)`:\n\n)?^```(python|yaml|bash|text)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
QUICK = "trainer.figures=false"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("outside")


def parts() -> list[tuple[str, str, str]]:
    return [(found[1] or "", found[2], found[3]) for found in PART.finditer(PAGE.read_text())]


@pytest.fixture(scope="module")
def said(folder: Path) -> dict[str, tuple[int, str, str]]:
    """Exit status, output and errors of every command, in their order."""
    results = {}
    for name, kind, text in parts():
        if kind in ("python", "yaml"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        elif kind == "bash":
            for line in text.splitlines():
                words = shlex.split(line)[1:]
                results[line] = inside(folder, *words, *([QUICK] if words[0] == "train" else []))
    return results


def test_every_command_does_what_the_page_says(said: dict[str, tuple[int, str, str]]) -> None:
    errors = {text.strip() for _, kind, text in parts() if kind == "text"}
    wrong = {line: found for line, found in said.items() if found[0] != 0}
    assert {found[2].strip() for found in wrong.values()} == errors
    assert {found[0] for found in wrong.values()} == {2}


def test_the_pendulum_is_listed_with_its_line(said: dict[str, tuple[int, str, str]]) -> None:
    listed = next(found[1] for line, found in said.items() if line.startswith("eigenode list"))
    assert re.search(r"^pendulum +Pendulum of 1 m, released at 1 rad$", listed, re.MULTILINE)


@pytest.mark.parametrize("run", ["first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"])
def test_each_run_finished_and_can_go_further(run: str, folder: Path, said: dict[str, tuple[int, str, str]]) -> None:
    assert said
    record = json.loads((folder / run / "run.json").read_text())
    assert record["status"] == "finished"
    more = f"trainer.steps={2 * record['steps']}"
    status, _, err = inside(folder, "resume", run, more)
    assert (status, err) == (0, "")
    again = json.loads((folder / run / "run.json").read_text())
    assert (again["status"], again["steps"]) == ("finished", 2 * record["steps"])


def test_a_run_that_went_further_is_the_longer_run(folder: Path, said: dict[str, tuple[int, str, str]]) -> None:
    assert said
    words = ["train", "system=oscillator", "optimizer=my_optimizers:Lion", "trainer.record_every=5", QUICK]
    assert inside(folder, *words, "trainer.steps=40", "hydra.run.dir=long")[0] == 0
    assert inside(folder, *words, "trainer.steps=20", "hydra.run.dir=short")[0] == 0
    assert inside(folder, "resume", "short", "trainer.steps=40")[0] == 0

    def rows(run: str) -> list[list[str]]:
        lines = (folder / run / "metrics.csv").read_text().splitlines()
        return [line.split(",")[:1] + line.split(",")[2:] for line in lines]

    assert rows("short") == rows("long")
