"""Classes named by `module:Class`: the schemas of shipped ones fit them, and a user's own is checked like them."""

import inspect
from dataclasses import fields
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from eigenode_cli.config.build import build_system
from eigenode_cli.config.compose import compose, restore, typed
from eigenode_cli.config.plugins import GROUPS, load_class
from eigenode_cli.config.schema import SCHEMAS, CombineConfig, SequentialConfig
from eigenode_cli.errors import UserError

PENDULUM = """
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from eigenode_cli.systems import Parameter, State, System


class Pendulum(System):
    title = "Pendulum"
    states = (State("phi", "rad", "p"), State("omega", "rad/s", "w"))

    def __init__(self, length: Annotated[float, Gt(0)] = 1.0, rod: Literal["light", "heavy"] = "light") -> None:
        if rod == "heavy" and length > 5:
            raise ValueError("a heavy rod is at most 5 m long")
        self.parameters = (Parameter("length", length, "m"),)
        self.k = 9.81 / length

    def dynamics(self, x):
        return np.stack([x[..., 1], -self.k * np.sin(x[..., 0])], axis=-1)

    def jacobian(self, x):
        a = np.zeros((*x.shape[:-1], 2, 2))
        a[..., 0, 1], a[..., 1, 0] = 1.0, -self.k * np.cos(x[..., 0])
        return a


class Odd(System):
    def __init__(self, what: dict) -> None: ...


class Unrelated: ...
"""
MODULE = "pendulum_of_a_test"
DATA = ["system.initial_state=[1,0]", "system.horizon=5", "system.points=11", "system.observed=[phi]"]


@pytest.fixture(autouse=True)
def user_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of the user's in the current folder."""
    (tmp_path / f"{MODULE}.py").write_text(PENDULUM)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize(("group", "target"), [(g, t) for g, kind in GROUPS.items() for t in kind.shipped])
def test_the_schema_of_a_shipped_class_has_the_arguments_of_its_constructor(group: str, target: str) -> None:
    kind = GROUPS[group]
    base = {entry.name for entry in fields(kind.base)}
    options = {entry.name for entry in fields(kind.shipped[target])} - base - {"scaling_from"}
    arguments = set(inspect.signature(load_class(target)).parameters) - set(kind.given)
    renamed = {"input_scaling": "input_scale", "output_scaling": "output_scale"}  # from the data, not from the user
    assert {renamed.get(option, option) for option in options} == arguments


def test_a_class_in_place_of_a_choice() -> None:
    config = typed(compose([f"system={MODULE}:Pendulum", *DATA, "system.length=2"]))
    assert (config.system.name, config.system.target) == ("pendulum", f"{MODULE}:Pendulum")
    assert build_system(config.system).k == 9.81 / 2
    assert typed(compose([f"system.target={MODULE}:Pendulum", *DATA])).system.length == 1.0


def test_an_own_choice_with_its_config_file(tmp_path: Path) -> None:
    (tmp_path / "mine" / "system").mkdir(parents=True)
    (tmp_path / "mine" / "system" / "swing.yaml").write_text(
        f"# A swing\ndefaults: [custom, _self_]\ntarget: {MODULE}:Pendulum\nlength: 3\ninitial_state: [1.0, 0.0]\n"
        "horizon: 5.0\npoints: 11\nobserved: [phi]\n"
    )
    config = compose(["system=swing", "system.rod=heavy"], str(tmp_path / "mine"))
    assert (config.system.name, config.system.length, config.system.rod) == ("swing", 3.0, "heavy")
    record = OmegaConf.to_container(config)
    assert isinstance(record, dict)
    assert restore({str(key): value for key, value in record.items()}) == typed(config)


@pytest.mark.parametrize(
    ("words", "faults"),
    [
        (
            ["system.lenght=2"],
            ["system.lenght=2: custom has no option 'lenght', did you mean system.length? (it has: "],
        ),
        (["system.length=x", "sede=1"], ["sede=1: unknown setting 'sede'", "system.length=x: not a number"]),
        (["system.length=-1"], ["system.length=-1: must be above 0"]),
        (["system.rod=hevy"], ["system.rod=hevy: unknown name 'hevy', did you mean heavy?"]),
        (["system.length=6", "system.rod=heavy"], ["system=pendulum: a heavy rod is at most 5 m long"]),
    ],
)
def test_options_of_an_own_class_are_checked(words: list[str], faults: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        compose([f"system={MODULE}:Pendulum", *DATA, *words])
    assert len(caught.value.faults) == len(faults)
    for fault in faults:
        assert any(line.startswith(fault) for line in caught.value.faults), caught.value.faults


@pytest.mark.parametrize(
    ("target", "fault"),
    [
        (f"{MODULE}:Pendlum", f"module {MODULE} has no such class; unknown class 'Pendlum', did you mean Pendulum?"),
        ("no_such_module:Pendulum", "cannot import no_such_module (ModuleNotFoundError"),
        (f"{MODULE}:Unrelated", "Unrelated does not derive from eigenode_cli.systems.System"),
        (f"{MODULE}:Odd", "Odd: its argument 'what' needs a type: float, int, str, bool, or a list of them"),
    ],
)
def test_a_class_that_cannot_be_used_is_one_line(target: str, fault: str) -> None:
    with pytest.raises(UserError) as caught:
        compose([f"system={target}", *DATA, "system.length=2"])
    assert len(caught.value.faults) == 1
    assert caught.value.faults[0].startswith(f"system.target={target}: {fault}")


def test_choices_with_the_same_options_are_told_apart_by_their_schema() -> None:
    config = compose(["combine=sum"])
    record = {str(key): value for key, value in OmegaConf.to_container(config).items()}
    record["combine"] = {"name": "mine", "repeat_last_update": False}
    assert isinstance(restore(record).combine, SequentialConfig)
    assert SequentialConfig.__mro__[1] is CombineConfig
    record["solver"] = {"name": "mine", "rtol": 1e-3, "atol": 1e-6, "max_steps": 10}
    names = {group: type(getattr(restore(record), group)).__name__ for group in SCHEMAS}
    assert names["solver"] == "AdaptiveSolverConfig"
    assert restore(record, names) == restore(record)
