"""Experiment files: the shipped ones are sound and complete, and a wrong one says everything that is wrong."""

from pathlib import Path

import pytest

from eigenode_cli.config.composer import Composer
from eigenode_cli.errors import UserError
from eigenode_cli.reproduce.library import AT_A_STEP, check_all, load, names, read, words_of
from eigenode_cli.reproduce.measures import MEASURES, TIMED
from eigenode_cli.reproduce.schema import MEASURES as NAMES
from eigenode_cli.reproduce.schema import RunSpec
from eigenode_cli.runs.paths import EXPERIMENT_DIR
from tests.reproduce.conftest import EXPERIMENT, write_experiment

PAPER = ("cost", "local_minimum", "network", "oscillator", "sparse_oscillator", "vdp")
FIGURES = {
    "oscmin",
    "transsol1",
    "transconv1",
    "transstab1",
    "transsol2",
    "transconv2",
    "transstab2",
    "transsol3_1",
    "transconv3",
}


OURS = {"test_sol", "twice_error", "tight_error"}
"""Measures that no claim of the paper asks for."""


def files() -> list[Path]:
    """All experiments; the settings of measured records are none."""
    return [path for path in EXPERIMENT_DIR.rglob("*.yaml") if path.parent.name != "measured"]


def test_every_shipped_experiment_is_checked() -> None:
    checked = check_all(Composer())
    assert checked.faults == []
    assert checked.experiments == len(files()) == 17
    assert checked.compositions == 2 * 26 + 15 + 50 + 10


def test_the_paper_is_complete() -> None:
    experiments = [load(name) for name in PAPER]
    assert {figure.name for experiment in experiments for figure in experiment.figures} == FIGURES
    assert all(experiment.protocols == ["paper", "authors"] for experiment in experiments)
    assert {claim.measure for experiment in experiments for claim in experiment.claims} == set(NAMES) - OURS
    grads = {
        name: {run.grads for run in load(name).runs.values()} for name in ("oscillator", "sparse_oscillator", "vdp")
    }
    assert {name: len(found) for name, found in grads.items()} == {"oscillator": 7, "sparse_oscillator": 3, "vdp": 5}


def test_registry_and_schema_name_the_same_measures() -> None:
    assert tuple(MEASURES) == NAMES
    assert set(AT_A_STEP) | set(TIMED) <= set(NAMES)


def test_a_run_may_name_its_protocol() -> None:
    run = RunSpec(system="vdp", grads="osc+sol", overrides=["trainer.steps=7"])
    assert words_of(run, "paper") == [
        "protocol=paper",
        "system=vdp",
        "grads=sol+osc",
        "trainer.steps=7",
        "trainer.figures=false",
    ]
    run.protocol = "authors"
    assert words_of(run, "paper")[0] == "protocol=authors"


@pytest.mark.parametrize(
    ("old", "new", "faults"),
    [
        ("title: A small study", "tilte: A", ["tilte: no such setting, did you mean title?", "title: missing"]),
        ("table: true", "table: 3", ["table=3: must be true or false"]),
        (
            "kind: stability",
            "kind: stabilty",
            ["figures[2].kind=stabilty: unknown name 'stabilty', did you mean stability?"],
        ),
        ("runs: [sol+stb, sol]", "runs: [sol+stp]", ["figure losses: unknown run 'sol+stp', did you mean sol+stb?"]),
        (
            "kind: convergence",
            "kind: convergence, twice: true",
            ["figure losses: twice: a figure of the convergence has"],
        ),
        ("name: same", "name: size", ["claim size: is there twice"]),
        ("run: sol, measure: parameters", "run: s, measure: parameters", ["claim size: unknown run 's'"]),
        ("at_most: 1.0e-9", "step: 5", ["claim perfect: needs at_least, at_most or both"]),
        ("measure: relative_error", "measure: stable_from", ["claim perfect: tolerance: missing for stable_from"]),
        ("measure: relative_error", "measure: rebound", ["claim perfect: window: rebound takes"]),
        ("measure: parameters", "measure: parameters, step: 5", ["claim size: step: not read by parameters"]),
        ("measure: parameters", "measure: parameters, step: -1", ["claims[0].step=-1: must be at least 0"]),
        ("at_most: 1.0e-9", "at_most: 1, share: 0.4", ["claims[2].share=0.4: must be above 0.5 and at most 1"]),
        (
            "at_most: 1.0e-9",
            "at_most: 1, share: 0.9, statistic: median",
            ["claim perfect: share: not read by the median"],
        ),
        ("protocols: [paper]", "protocols: paper", ["protocols=paper: must be a list"]),
        ("protocols: [paper]", "protocols: []", ["protocols: name at least one"]),
        ("{system: oscillator, grads: sol+stb, overrides: *short}", "5", ["runs.sol+stb: must be a mapping"]),
    ],
)
def test_a_fault_is_named(old: str, new: str, faults: list[str], tmp_path: Path) -> None:
    assert old in EXPERIMENT
    path = write_experiment(tmp_path, EXPERIMENT.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        read(Path(path))
    assert len(caught.value.faults) == len(faults)
    for line, fault in zip(caught.value.faults, faults, strict=True):
        assert line.startswith(f"small.yaml: {fault}")


def test_what_is_no_experiment(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"unknown experiment 'vdb', did you mean vdp\?"):
        load("vdb")
    with pytest.raises(UserError, match=r"gone\.yaml: cannot be read"):
        load(str(tmp_path / "gone.yaml"))
    with pytest.raises(UserError, match="not valid YAML"):
        load(write_experiment(tmp_path, "a: ["))
    with pytest.raises(UserError, match="must be a mapping"):
        load(write_experiment(tmp_path, "[]"))


def test_faults_of_runs_and_protocols_come_together(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("grads: sol+stb", "grads: sol+stq").replace(
        "protocols: [paper]", "protocols: [paper, papr]"
    )
    write_experiment(tmp_path, text)
    faults = check_all(Composer(), tmp_path).faults
    assert len(faults) == 2
    assert faults[0].startswith("small: run sol+stb: grads=sol+stq: unknown term 'stq'")
    assert faults[1].startswith("small.yaml: unknown protocol 'papr', did you mean paper?")


def test_names_are_unique() -> None:
    assert len(names()) == len(files())
