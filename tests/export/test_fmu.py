"""The FMU: validated by FMPy, its functions called, simulated with CVode."""

import ctypes
import subprocess
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
import torch
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.errors import UserError
from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.fmu import fmu
from eigenode_cli.export.from_run import exported_model
from eigenode_cli.systems.base import State
from tests.export.helpers import VARIANTS, awkward, disagreement, expected, made, own_field, random_points

SOME = ("silu", "plain", "full scaled", "four states", "polynomial with inputs")
STATES = 300


def written(model: ExportedModel, folder: Path) -> Path:
    path = folder / "field.fmu"
    path.write_bytes(fmu(model))
    return path


@contextmanager
def instance(path: Path, folder: Path, guid: str | None = None) -> Iterator[FMU2Model]:
    """The FMU in its continuous-time mode."""
    description = fmpy.read_model_description(path)
    name = description.modelExchange.modelIdentifier
    unpacked = fmpy.extract(path, str(folder / "unpacked"))
    model = FMU2Model(guid=guid or description.guid, unzipDirectory=unpacked, modelIdentifier=name, instanceName="one")
    model.instantiate()
    model.setupExperiment()
    model.enterInitializationMode()
    model.exitInitializationMode()
    model.newDiscreteStates()
    model.enterContinuousTimeMode()
    try:
        yield model
    finally:
        model.terminate()
        model.freeInstance()


def rates(model: FMU2Model, x: Floats, u: Floats) -> Floats:
    """Derivatives `(N, n)` as a solver gets them."""
    n = x.shape[1]
    found, buffer = np.empty_like(x), (ctypes.c_double * n)()
    for here, inputs, row in zip(x, u, found, strict=True):
        model.setReal(range(2 * n, 2 * n + inputs.size), inputs.tolist())
        model.setContinuousStates((ctypes.c_double * n)(*here), n)
        model.getDerivatives(buffer, n)
        row[:] = buffer
    return found


@pytest.mark.parametrize("kind", SOME)
def test_it_is_valid_and_gives_the_rates(kind: str, tmp_path: Path) -> None:
    model = VARIANTS[kind]
    path = written(model, tmp_path)
    assert validate_fmu(str(path)) == []
    x, u = random_points(model, STATES)
    n, k = len(model.states), len(model.inputs)
    with instance(path, tmp_path) as loaded:
        assert disagreement(rates(loaded, x, u), expected(model, x, u)) < 1e-9
        by_name = np.array(loaded.getReal(range(n, 2 * n)))
        assert disagreement(by_name, expected(model, x[-1:], u[-1:])[0]) < 1e-9
        assert loaded.getReal(range(n)) == x[-1].tolist()
        unknown, known = list(range(n, 2 * n)), [*range(n), *range(2 * n, 2 * n + k)]
        seed = np.random.default_rng(1).normal(size=n + k)
        found = loaded.getDirectionalDerivative(unknown, known, seed.tolist())
    own = own_field(model)
    here = (torch.from_numpy(x[-1]), torch.from_numpy(u[-1]))
    wanted = torch.func.jvp(own, here, tuple(torch.from_numpy(seed).split([n, k])))[1].detach().numpy()
    assert disagreement(np.array(found), wanted) < 1e-9


def test_that_of_a_run(run: en.RecordedRun, tmp_path: Path) -> None:
    model = exported_model(run.folder)
    path = written(model, tmp_path)
    assert validate_fmu(str(path)) == []
    x, u = random_points(model, STATES)
    with torch.no_grad():
        wanted = run.field()(torch.from_numpy(x)).numpy()
    with instance(path, tmp_path) as loaded:
        assert disagreement(rates(loaded, x, u), wanted) < 1e-9
    found = fmpy.simulate_fmu(str(path), solver="CVode", relative_tolerance=1e-9, output_interval=model.end / 100.0)
    path_of_states = np.column_stack([found[name] for name in run.states])
    assert found["time"][-1] == pytest.approx(run.config.system.horizon)
    own = run.simulate(found["time"])
    assert (np.abs(path_of_states - own).max(axis=0) < 1e-5 * np.abs(own).max(axis=0)).all()


def test_start_values_and_a_signal(tmp_path: Path) -> None:
    """Steps of the inputs: FMPy holds signals between its output times where there are no event indicators."""
    model = made(n=4, k=2, scaled=True, linear=True, end=2.0)
    path = written(model, tmp_path)
    start = np.array([0.3, -0.2, 0.5, 0.1])
    pieces = [(0.0, 0.5, (0.0, 0.0)), (0.5, 1.2, (2.0, -1.0)), (1.2, 2.0, (2.0, 3.0))]
    signal = [(end, *values) for begin, until, values in pieces for end in (begin, until)]
    found = fmpy.simulate_fmu(
        str(path),
        *(False, 0.0, 2.0),
        relative_tolerance=1e-9,
        output_interval=0.02,
        start_values={state.name: value for state, value in zip(model.states, start, strict=True)},
        input=np.array(signal, dtype=[("time", float), ("u0", float), ("u1", float)]),
    )
    times, here, wanted = found["time"], start, []
    for begin, until, values in pieces:
        inside = times[(times >= begin) & ((times < until) | (until == 2.0))]
        solved = solve_ivp(
            lambda _t, x, u: model.rates(x[None], np.array([u]))[0],
            *((begin, until), here, "DOP853"),
            args=(values,),
            rtol=1e-11,
            atol=1e-11,
            dense_output=True,
        )
        wanted.append(solved.sol(inside).T)
        here = solved.y[:, -1]
    states = np.column_stack([found[state.name] for state in model.states])
    own = np.concatenate(wanted)
    assert (np.abs(states - own).max(axis=0) < 1e-5 * np.abs(own).max(axis=0)).all()


def test_what_the_description_says(tmp_path: Path) -> None:
    model = awkward()
    path = written(model, tmp_path)
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(path)
    first, second, *_ = description.modelVariables
    assert float(first.start) == model.initial_state[0]
    assert (first.name, first.causality, first.unit) == (model.states[0].name.strip("\n") + " ", "output", "\u00b0C")
    assert second.unit == "1/s"
    assert description.modelVariables[4].causality == "input"
    assert description.defaultExperiment.stopTime == "1.0"
    units = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
    assert units["\u00b0C"] is None
    force = units["N m/s^2"]
    assert (force.kg, force.m, force.s, force.factor) == (1, 2, -4, 1.0)
    assert units["1/s2"].s == -2
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        page = archive.read("documentation/index.html").decode()
    assert f"binaries/linux64/{description.modelName}" not in names
    assert "binaries/linux64/model_9_odd_names.so" in names
    assert "sources/model_9_odd_names.c" in names
    assert "&lt;&amp;&gt;" in page
    for text in (page, description.description):
        assert "\x00" not in text


def test_its_sources_compile_without_a_warning(tmp_path: Path) -> None:
    with zipfile.ZipFile(written(VARIANTS["full scaled"], tmp_path)) as archive:
        archive.extractall(tmp_path)
    files = [element.attrib["name"] for element in ElementTree.parse(tmp_path / "modelDescription.xml").iter("File")]
    assert len(files) == 2
    strict = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-c"]
    for prefix in ([], ["-DFMI2_FUNCTION_PREFIX=made_"]):
        subprocess.run([*strict, *prefix, *files], cwd=tmp_path / "sources", check=True)
    symbols = subprocess.run(["nm", "made_fmi2.o"], cwd=tmp_path / "sources", capture_output=True, check=True).stdout
    assert b"T made_fmi2GetDerivatives" in symbols


def test_the_same_model_gives_the_same_bytes_and_another_another_guid(tmp_path: Path) -> None:
    guids = []
    for model in (made(), made("sin")):
        folder = tmp_path / str(len(guids))
        folder.mkdir()
        guids.append(fmpy.read_model_description(written(model, folder)).guid)
    assert (tmp_path / "0" / "field.fmu").read_bytes() == fmu(made())
    assert guids[0] != guids[1]
    with pytest.raises(Exception, match="instantiate"), instance(tmp_path / "0" / "field.fmu", tmp_path, guids[1]):
        pass


def test_calls_that_are_not_allowed_are_answered(tmp_path: Path) -> None:
    path = written(made(), tmp_path)
    with instance(path, tmp_path) as loaded:
        for call in (
            lambda: loaded.getReal([17]),
            lambda: loaded.setReal([2], [1.0]),
            lambda: loaded.getInteger([0]),
            lambda: loaded.getDirectionalDerivative([2], [2], [1.0]),
            loaded.getFMUstate,
        ):
            with pytest.raises(FMICallException):
                call()
        loaded.setReal([0], [5.0])
        loaded.reset()
        assert loaded.getReal([0, 1]) == made().initial_state.tolist()


def test_two_variables_of_one_name_are_refused() -> None:
    states = (State("s", "m", "s"), State("v", "m/s", "v"))
    with pytest.raises(UserError, match="two variables are named v; an FMU needs a name for each"):
        fmu(made(k=1, states=states, inputs=(State("v", "N", "v"),)))
