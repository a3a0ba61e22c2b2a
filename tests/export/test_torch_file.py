"""The Python file: imported and run as a user does, against eigenode's own modules."""

import ast
import importlib.util
import io
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.from_run import exported_model
from eigenode_cli.export.torch_file import torch_file
from eigenode_cli.spectra.jacobian import jacobian
from tests.export.helpers import VARIANTS, awkward, disagreement, expected, made, own_field, random_points


def imported(model: ExportedModel, folder: Path) -> ModuleType:
    """The file as a module."""
    path = folder / "exported_field.py"
    path.write_text(torch_file(model))
    spec = importlib.util.spec_from_file_location("exported_field", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("model", VARIANTS.values(), ids=VARIANTS)
def test_its_rates(model: ExportedModel, tmp_path: Path) -> None:
    field = imported(model, tmp_path).Field()
    x, u = random_points(model)
    found = field(torch.from_numpy(x), torch.from_numpy(u) if model.inputs else None)
    assert found.dtype == torch.float64
    assert disagreement(found.numpy(), expected(model, x, u)) < 1e-9
    alone = field(torch.from_numpy(x[3]), torch.from_numpy(u[3]) if model.inputs else None)
    np.testing.assert_allclose(alone.numpy(), found[3].numpy(), rtol=1e-12, atol=1e-12)
    rest = expected(model, x, np.zeros_like(u))
    assert disagreement(field(torch.from_numpy(x)).numpy(), rest) < 1e-9


@pytest.mark.parametrize("kind", ["silu", "polynomial with inputs", "four states"])
def test_it_is_differentiable(kind: str, tmp_path: Path) -> None:
    model = VARIANTS[kind]
    field = imported(model, tmp_path).Field()
    x, u = (torch.from_numpy(part) for part in random_points(model, 20))
    found = torch.func.vmap(torch.func.jacrev(field))(x, u)
    own = own_field(model)
    wanted = jacobian(lambda states: own(states, u[:, None].expand(*states.shape[:-1], -1)), x, "autodiff")
    assert disagreement(found.numpy(), wanted.detach().numpy()) < 1e-9
    assert not any(parameter.requires_grad for parameter in field.parameters())
    field.requires_grad_()
    field(x, u).sum().backward()
    assert all(parameter.grad is not None for parameter in field.parameters())


def test_it_simulates_with_inputs(tmp_path: Path) -> None:
    model = made(n=4, k=2, scaled=True, linear=True)
    module = imported(model, tmp_path)
    times = np.linspace(0.0, 2.0, 9)

    def u(t: float) -> np.ndarray:
        return np.array([np.sin(3.0 * t), 0.4])

    wanted = solve_ivp(
        lambda t, x: model.rates(x[None], u(t)[None])[0],
        *((0.0, 2.0), model.initial_state, "DOP853", times),
        rtol=1e-11,
        atol=1e-11,
    ).y.T
    found = module.simulate(module.INITIAL_STATE, times, lambda t: torch.from_numpy(u(t)))
    assert disagreement(found.numpy(), wanted) < 1e-7
    held = module.simulate(module.INITIAL_STATE, times, torch.tensor([0.0, 0.4], dtype=torch.float64))
    assert disagreement(held.numpy(), wanted) > 1e-4


def test_it_runs_alone(one_run: en.RecordedRun, tmp_path: Path) -> None:
    model = exported_model(one_run.folder)
    path = tmp_path / "alone.py"
    path.write_text(torch_file(model))
    tree = ast.parse(path.read_text())
    assert {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names} == {
        "math",
        "torch",
    }
    assert not any(isinstance(node, ast.ImportFrom) for node in ast.walk(tree))
    done = subprocess.run([sys.executable, "-W", "error", path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    table = pd.read_csv(io.StringIO(done.stdout))
    assert list(table.columns) == ["t", *one_run.states]
    wanted = one_run.simulate(table["t"].to_numpy())
    assert len(table) == 101
    assert disagreement(table[list(one_run.states)].to_numpy(), wanted) < 1e-5


def test_its_constants(tmp_path: Path) -> None:
    model = awkward()
    module = imported(model, tmp_path)
    assert model.command == module.COMMAND
    assert [state.name for state in model.states] == module.STATES
    assert [state.unit for state in model.inputs] == module.INPUT_UNITS
    assert list(model.modes) == module.MODES
    assert model.highest.tolist() == module.HIGHEST
