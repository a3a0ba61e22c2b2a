"""Composition: the shipped numbers, protocols, the user's own configs, and what a run gets to read."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from eigenode_cli.config import catalogue, names
from eigenode_cli.config.catalogue import shipped_files, validate
from eigenode_cli.config.compose import compose, restore, typed
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.schema import SCHEMAS, CompiledEngineConfig, FixedSolverConfig, PolynomialConfig
from eigenode_cli.engines.combine import COMBINATIONS
from eigenode_cli.errors import UserError
from eigenode_cli.model.activations import ACTIVATIONS
from eigenode_cli.model.init import INITS
from eigenode_cli.solve.stability import METHODS
from eigenode_cli.solve.switching import STIFF
from eigenode_cli.solve.torchdiffeq_solvers import ADAPTIVE, FIXED
from eigenode_cli.terms.errors import ERRORS

VDP = "eigenode_cli.systems:VanDerPol"


def test_every_shipped_file_is_composed() -> None:
    result = validate(Composer())
    assert result.faults == []
    assert result.files == shipped_files()
    assert len(result.files) == 55
    choices = sum(len(Composer().choices(group)) for group in SCHEMAS)
    protocols_and_systems = 4 + 4 * 4
    records = 3  # those that ship
    own_classes = 2  # solver=custom and optimizer=custom have no class yet
    assert result.compositions == choices + protocols_and_systems + records - own_classes


def test_a_faulty_config_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "system").mkdir()
    (tmp_path / "system" / "bad.yaml").write_text("# Bad\ndefaults: [vdp, _self_]\npoints: 1\n")
    monkeypatch.setattr(catalogue, "_combinations", lambda composer: [("system=bad",)])
    result = validate(Composer(str(tmp_path)))
    assert result.faults[0] == "eigenode train system=bad: system.points=1: must be at least 2"
    assert "configs/system/oscillator.yaml: no command reaches this file" in result.faults


def test_the_paper() -> None:
    config = compose([])
    assert OmegaConf.to_container(config.optimizer) == {
        "name": "adam",
        "lr": 1e-3,
        "beta1": 0.9,
        "clip": None,
        "beta2": 0.999,
        "eps": 1e-8,
    }
    assert dict(config.scale) == {"sol": 1, "frq": 10, "dmp": 1, "stb": 1000, "osc": 10, "stf": 0.1, "stp": 1}
    assert (config.solver.name, config.solver.rtol, config.solver.atol) == ("tsit5", 1e-3, 1e-6)
    assert (config.system.mu, config.system.horizon, config.system.points) == (2, 30, 91)
    assert (config.network.hidden, config.network.init, config.trainer.steps) == ([32], "glorot", 5000)
    assert (config.protocol, config.grads, config.seed) == ("paper", "sol+frq+dmp+osc", 0)
    assert not config.combine.repeat_last_update


def test_sparse_oscillator_is_an_oscillator_with_its_own_name_and_steps() -> None:
    config = compose(["system=sparse_oscillator"])
    assert (config.system.name, config.system.target) == ("sparse_oscillator", "eigenode_cli.systems:Oscillator")
    assert (config.system.points, config.system.horizon, config.trainer.steps) == (14, 9.75, 7500)
    assert compose(["system=sparse_oscillator", "trainer.steps=5"]).trainer.steps == 5


def test_the_authors() -> None:
    config = compose(["protocol=authors"])
    assert (config.network.init, config.combine.repeat_last_update) == ("uniform01", True)
    assert (config.system.points, config.scale.stf) == (101, 1e-3)
    other = compose(["protocol=authors", "system=oscillator", "combine=sum", "network=polynomial"])
    assert (other.scale.stf, other.combine.name, other.network.name) == (0.1, "sum", "polynomial")


def test_grads_are_canonical() -> None:
    assert compose(["grads=OSC+sol+Frq"]).grads == "sol+frq+osc"
    words = ["stages=[{terms:dmp+FRQ,steps:5},{}]", "grads=sol", "scale.frq=3"]
    assert compose(words).stages[0].terms == "frq+dmp"  # whose scale is read, then, too


def test_nothing_of_the_ablations_is_on_by_itself() -> None:
    for protocol in ("paper", "authors", "journal"):
        for system in ("oscillator", "sparse_oscillator", "vdp"):
            config = compose([f"protocol={protocol}", f"system={system}"])
            assert (config.system.noise, config.target.frequency_factor) == (0.0, 1.0)
            assert [(stage.steps, stage.terms, list(stage.horizons)) for stage in config.stages] == [
                (None, None, [1.0])
            ]


def test_typed_objects_have_the_class_of_the_choice() -> None:
    config = typed(compose(["solver=rk4", "engine=compiled"]))
    assert isinstance(config.solver, FixedSolverConfig)
    assert isinstance(config.engine, CompiledEngineConfig)
    assert isinstance(typed(compose(["network=polynomial"])).network, PolynomialConfig)


@pytest.mark.parametrize(
    "words",
    [
        [],
        [
            "solver=rk4",
            "target=stated",
            "stages=[{terms:stb,steps:3},{}]",
            "grads=sol",
            "combine=mix",
            "engine=compiled",
        ],
    ],
)
def test_restored_from_a_record(words: list[str]) -> None:
    config = compose(words)
    record = OmegaConf.to_container(config)
    assert isinstance(record, dict)
    assert restore({str(key): value for key, value in record.items()}) == typed(config)


def test_a_record_of_another_version_is_refused() -> None:
    with pytest.raises(UserError, match=r"run\.json: config\.solver\.tolerance: Key .tolerance. not in"):
        restore({"solver": {"name": "tsit5", "tolerance": 1}})


def test_own_term(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_own_term.py").write_text("import torch\n\n\ndef distance(*_):\n    return torch.zeros(())\n")
    monkeypatch.syspath_prepend(tmp_path)
    config = compose(["+terms.mine=my_own_term:distance", "grads=mine+sol"])
    assert (config.grads, config.scale.mine) == ("sol+mine", 1.0)
    assert compose(["terms.mine=my_own_term:distance", "grads=mine", "scale.mine=7"]).scale.mine == 7
    with pytest.raises(UserError, match="did you mean distance"):
        compose(["terms.mine=my_own_term:distanze", "grads=mine"])


def test_own_system(tmp_path: Path) -> None:
    (tmp_path / "system").mkdir()
    (tmp_path / "system" / "mild.yaml").write_text("# Mild\ndefaults: [vdp, _self_]\nmu: 0.1\n")
    config = compose(["system=mild"], config_dir=str(tmp_path))
    assert (config.system.name, config.system.target, config.system.mu) == (
        "mild",
        "eigenode_cli.systems:VanDerPol",
        0.1,
    )


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("defaults: [vdp, _self_]\nmuh: 0.1\n", "Key 'muh' not in 'VanDerPolConfig'"),
        ("defaults: [vpd, _self_]\n", "In 'system/mine': Could not load 'system/vpd'"),
        ("defaults: [vdp, _self_]\nmu: [\n", "while parsing"),
        (
            "defaults: [vdp, _self_]\ntarget: eigenode_cli.systems:Duffing\n",
            "has no such class; unknown class 'Duffing'",
        ),
        (
            "defaults: [/schema/system/vdp@_here_, _self_]\ntarget: eigenode_cli.systems:VanDerPol\n",
            "system.initial_state: missing",
        ),
    ],
)
def test_a_fault_in_an_own_system(text: str, fault: str, tmp_path: Path) -> None:
    (tmp_path / "system").mkdir()
    (tmp_path / "system" / "mine.yaml").write_text(text)
    with pytest.raises(UserError) as caught:
        compose(["system=mine"], config_dir=str(tmp_path))
    assert fault in caught.value.faults[0]
    assert all("\n" not in line for line in caught.value.faults)


def test_own_primary_config_and_own_group(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "short.yaml").write_text("# @package _global_\ntrainer:\n  steps: 7\n")
    assert compose(["+study=short"], config_dir=str(tmp_path)).trainer.steps == 7
    with pytest.raises(UserError, match=r"write \+study=short"):
        compose(["study=short"], config_dir=str(tmp_path))


def test_lists_of_names_are_those_of_the_modules() -> None:
    assert tuple(ACTIVATIONS) == names.ACTIVATIONS
    assert tuple(INITS) == names.INITS
    assert tuple(ERRORS) == names.ERRORS
    assert METHODS == names.STEPPERS


def test_every_solver_config_is_implemented() -> None:
    solvers = {name: compose([f"solver={name}"]).solver for name in Composer().choices("solver") if name != "custom"}
    assert {name for name, solver in solvers.items() if "rtol" in solver} == {*ADAPTIVE, *STIFF}
    assert {name for name, solver in solvers.items() if "step" in solver} == set(FIXED)
    assert all(name == solver.name for name, solver in solvers.items())


def test_every_combination_is_implemented() -> None:
    assert set(Composer().choices("combine")) == set(COMBINATIONS)
