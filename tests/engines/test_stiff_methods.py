"""Rosenbrock methods and `auto` in both engines: same steps, same gradients both ways, with and without an input."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.solve.drive import Drive
from eigenode_cli.solve.settings import AdaptiveSolver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.switching import STIFF
from tests.engines.compiled import oracle
from tests.engines.test_residuals import SQUARES


def field_of(n: int, structure: str, hidden: tuple[int, ...], linear: bool, inputs: int, stiff: float) -> VectorField:
    """A field with random weights and, where it is `linear`, a decay of the given rate in 1/s."""
    generator = torch.Generator().manual_seed(5)
    outputs = n // 2 if structure == "second_order" else n
    matrix = 0.3 * torch.randn((outputs, n + inputs), generator=generator, dtype=torch.float64)
    matrix[:, n - outputs : n] -= stiff * torch.eye(outputs, dtype=torch.float64)
    scale = 0.5 + torch.rand(n + inputs, generator=generator, dtype=torch.float64)
    network = Mlp(n + inputs, hidden, outputs, generator=generator, input_scale=scale)
    return VectorField(network, structure, matrix if linear else None, inputs=inputs)


def problem_of(n: int, inputs: int, name: str, **changes) -> Problem:
    problem = oracle.make_problem(n, count=7, errors=SQUARES, solver=AdaptiveSolver(name))
    data, start = problem.data, problem.data.initial_state.copy()
    start[0] = np.nan
    drive = None
    if inputs:
        drive = Drive(np.array([0.0, 0.45, 1.0]), np.linspace(-1.0, 2.0, 3 * inputs).reshape(3, inputs))
    return replace(problem, data=Series(data.times, data.values, start, drive=drive), **changes)


def parameters_of(field: VectorField) -> Floats:
    return np.concatenate([flat_parameters(field), [0.4]])


class Case(NamedTuple):
    """A field and data for it."""

    n: int
    structure: str
    hidden: tuple[int, ...]
    linear: bool
    inputs: int

    def parts(self, name: str) -> tuple[VectorField, Problem, Floats]:
        """Return the field, the problem for a solver, and all parameters."""
        field = field_of(*self, stiff=3.0)
        return field, problem_of(self.n, self.inputs, name), parameters_of(field)


CASES = [
    Case(2, "second_order", (7, 5), True, 0),
    Case(4, "full", (6,), False, 1),
    Case(10, "second_order", (8,), True, 0),
]


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("case", CASES)
def test_both_engines_and_both_ways_agree(case: Case, name: str) -> None:
    field, problem, theta = case.parts(name)
    adjoint = CompiledEngine(shape_of(field), problem)
    free, reference = adjoint.loss_jacobian(theta), TorchEngine(field, problem, {})
    wanted = reference.loss_jacobian(theta)
    assert free.status is Status.OK
    if not case.inputs:  # the torch engine chooses a first step behind every knot of an input
        assert (free.n_accepted, free.n_rejected) == (wanted.n_accepted, wanted.n_rejected)
        np.testing.assert_allclose(free.trajectory, wanted.trajectory, rtol=1e-9, atol=1e-10)
    steps = adjoint.steps
    found = adjoint.loss_jacobian(theta, steps)
    forward = CompiledEngine(shape_of(field), problem, sensitivity="forward").loss_jacobian(theta, steps)
    wanted = reference.loss_jacobian(theta, steps.tolist())
    scale = np.abs(wanted.gradients).max(axis=1, keepdims=True) + 1e-12
    np.testing.assert_allclose(found.values, wanted.values, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.gradients / scale, wanted.gradients / scale, atol=1e-9)
    np.testing.assert_allclose(forward.gradients / scale, wanted.gradients / scale, atol=1e-9)


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("case", CASES)
def test_gradients_are_five_point_differences(case: Case, name: str) -> None:
    field, problem, theta = case.parts(name)
    engine = CompiledEngine(shape_of(field), problem)
    engine.loss_jacobian(theta)
    steps = engine.steps
    found = engine.loss_jacobian(theta, steps)
    direction = np.random.default_rng(0).standard_normal(theta.size)
    direction, size = direction / np.linalg.norm(direction), 2e-4
    ahead = [engine.loss_jacobian(theta + k * size * direction, steps).values for k in (-2, -1, 1, 2)]
    difference = (ahead[0] - 8.0 * ahead[1] + 8.0 * ahead[2] - ahead[3]) / (12.0 * size)
    np.testing.assert_allclose(found.gradients @ direction, difference, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("name", STIFF)
def test_residual_jacobians_agree(name: str) -> None:
    field, problem = field_of(2, "second_order", (7,), True, 1, 3.0), problem_of(2, 1, name)
    theta, engine = parameters_of(field), CompiledEngine(shape_of(field), problem)
    engine.loss_jacobian(theta)
    steps = engine.steps
    ours = engine.residual_jacobian(theta, steps=steps)
    theirs = TorchEngine(field, problem, {}).residual_jacobian(theta, steps=steps.tolist())
    np.testing.assert_allclose(ours.residuals, theirs.residuals, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(ours.jacobian, theirs.jacobian, rtol=1e-6, atol=1e-8 * np.abs(theirs.jacobian).max())


def test_auto_changes_its_method_where_stability_limits_the_step() -> None:
    """A decay of 2,000/s: Tsit5 needs hundreds of steps, `auto` few; both engines change at the same steps."""
    field = field_of(2, "second_order", (7,), True, 0, 2000.0)
    theta, found = parameters_of(field), {}
    for name in ("tsit5", "rodas5p", "auto"):
        problem = problem_of(2, 0, name)
        engine = CompiledEngine(shape_of(field), problem)
        found[name] = engine.loss_jacobian(theta)
        wanted = TorchEngine(field, problem, {}).loss_jacobian(theta)
        assert abs(found[name].n_accepted - wanted.n_accepted) <= (2 if name == "tsit5" else 0)
        if name == "auto":
            again = engine.loss_jacobian(theta, engine.steps)
            frozen = TorchEngine(field, problem, {}).loss_jacobian(theta, engine.steps.tolist())
            scale = np.abs(frozen.gradients).max(axis=1, keepdims=True) + 1e-12
            np.testing.assert_allclose(again.gradients / scale, frozen.gradients / scale, atol=1e-8)
    assert found["tsit5"].n_accepted > 300
    assert found["auto"].n_accepted < 40
    assert found["rodas5p"].n_accepted < 40
    np.testing.assert_allclose(found["auto"].trajectory, found["tsit5"].trajectory, rtol=1e-2, atol=1e-4)
