"""The C file: compiled with every warning an error, and called."""

import ctypes
import io
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.export.c_file import c_file
from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.from_run import exported_model
from eigenode_cli.export.text import identifier
from eigenode_cli.spectra.jacobian import jacobian
from tests.export.helpers import VARIANTS, awkward, disagreement, expected, made, own_field, random_points

STRICT = ("gcc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1")
NUMBERS = np.ctypeslib.ndpointer(dtype=np.float64, flags="C_CONTIGUOUS")


class Library:
    """The file as a shared object."""

    def __init__(self, model: ExportedModel, folder: Path) -> None:
        self.name = identifier(model.name)
        self._n, self._k = len(model.states), len(model.inputs)
        (folder / "field.c").write_text(c_file(model))
        subprocess.run([*STRICT, "-fPIC", "-shared", "field.c", "-o", "field.so", "-lm"], cwd=folder, check=True)
        self.loaded = ctypes.CDLL(str(folder / "field.so"))

    def call(self, function: str, x: Floats, u: Floats, columns: int) -> Floats:
        """Numbers `(N, columns)` that a function gives at each of the states."""
        called = getattr(self.loaded, f"{self.name}_{function}")
        called.argtypes, called.restype = [ctypes.c_void_p] * 3, None
        arrays = [np.ascontiguousarray(x), np.ascontiguousarray(u), np.full((len(x), columns), np.nan)]
        places = [(array.ctypes.data, array.strides[0]) for array in arrays]
        for i in range(len(x)):
            called(*[start + i * size for start, size in places])
        return arrays[2]

    def simulate(self, x: Floats, u: Floats, h: float, steps: int) -> int:
        called = getattr(self.loaded, f"{self.name}_simulate")
        called.argtypes = [NUMBERS, NUMBERS, ctypes.c_double, ctypes.c_long]
        return called(x, u, h, steps)

    def array(self, constant: str, size: int) -> list[float]:
        return list((ctypes.c_double * size).in_dll(self.loaded, f"{self.name}_{constant}"))

    def text(self, constant: str) -> str:
        value = ctypes.c_char_p.in_dll(self.loaded, f"{self.name}_{constant}").value
        return (value or b"").decode()


@pytest.mark.parametrize("model", VARIANTS.values(), ids=VARIANTS)
def test_its_rates_and_jacobians(model: ExportedModel, tmp_path: Path) -> None:
    library = Library(model, tmp_path)
    n, k = len(model.states), len(model.inputs)
    x, u = random_points(model)
    assert disagreement(library.call("rates", x, u, n), expected(model, x, u)) < 1e-9
    x, u = x[:500], u[:500]
    states, inputs = torch.from_numpy(x), torch.from_numpy(u)
    own = own_field(model)
    found = library.call("jacobian", x, u, n * n).reshape(-1, n, n)
    wanted = jacobian(lambda z: own(z, inputs[:, None].expand(*z.shape[:-1], k)), states, "autodiff")
    assert disagreement(found, wanted.detach().numpy()) < 1e-9
    if k:
        found = library.call("input_jacobian", x, u, n * k).reshape(-1, n, k)
        by_input = torch.func.vmap(torch.func.jacrev(own, argnums=1))(states, inputs)
        assert disagreement(found, by_input.detach().numpy()) < 1e-9


def test_it_simulates(tmp_path: Path) -> None:
    model = made(n=4, k=1, scaled=True, linear=True)
    library = Library(model, tmp_path)
    x, u = model.initial_state.copy(), np.array([0.7])
    assert library.simulate(x, u, 0.005, 400) == 0
    wanted = solve_ivp(
        lambda _t, y: model.rates(y[None], u[None])[0],
        *((0.0, 2.0), model.initial_state, "DOP853"),
        rtol=1e-11,
        atol=1e-11,
    ).y[:, -1]
    assert disagreement(x, wanted) < 1e-8
    blown = 1e3 * np.ones(2)
    unstable = Library(made(degree=3, name="unstable"), _folder(tmp_path))
    assert unstable.simulate(blown, np.zeros(0), 1.0, 100) == 1


def test_the_program_of_a_run(run: en.RecordedRun, tmp_path: Path) -> None:
    model = exported_model(run.folder)
    name = identifier(model.name)
    (tmp_path / f"{name}.c").write_text(c_file(model))
    subprocess.run([*STRICT, f"-D{name}_MAIN", f"{name}.c", "-o", "program", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "program"], capture_output=True, text=True, check=True)
    table = pd.read_csv(io.StringIO(done.stdout))
    assert list(table.columns) == ["t", *run.states]
    assert len(table) == 101
    wanted = run.simulate(table["t"].to_numpy())
    assert disagreement(table[list(run.states)].to_numpy(), wanted) < 1e-5
    x, u = random_points(model)
    library = Library(model, tmp_path)
    with torch.no_grad():
        rates = run.field()(torch.from_numpy(x)).numpy()
    assert disagreement(library.call("rates", x, u, len(run.states)), rates) < 1e-9


def test_its_constants(tmp_path: Path) -> None:
    model = awkward()
    library = Library(model, tmp_path)
    subprocess.run([*STRICT, "-Dmodel_9_odd_names_MAIN", "-c", "field.c"], cwd=tmp_path, check=True)
    assert library.name == "model_9_odd_names"
    assert library.text("command") == model.command
    assert library.text("state_names") == model.states[0].name
    assert library.text("input_units") == "N m/s^2"
    assert library.array("highest", 2) == model.highest.tolist()
    assert library.array("modes", 2) == list(model.modes[0])
    assert library.array("initial_state", 2) == model.initial_state.tolist()


def test_it_keeps_nothing_and_allocates_nothing(tmp_path: Path) -> None:
    """Nothing is in the sections of an object for data that changes, and no function of the heap is called."""
    (tmp_path / "field.c").write_text(c_file(VARIANTS["full scaled"]))
    subprocess.run([*STRICT, "-fno-pie", "-c", "field.c"], cwd=tmp_path, check=True)
    symbols = subprocess.run(["nm", "field.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    kinds = {line.split()[-1]: line.split()[-2] for line in symbols.splitlines()}
    assert not {name for name, kind in kinds.items() if kind in "dDbBC"}
    assert not {"malloc", "calloc", "free"} & {name for name, kind in kinds.items() if kind == "U"}


def _folder(path: Path) -> Path:
    (path / "other").mkdir()
    return path / "other"
