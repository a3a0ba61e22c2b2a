"""Inputs, measured derivatives and offsets: both engines agree, gradients are those of the values, SciPy's solution."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import StatedTarget
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import Mlp, VectorField, flat_parameters
from eigenode_cli.solve.drive import Drive, steps_to_knots
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.terms import NAMES

ADAPTIVE, FIXED = AdaptiveSolver(rtol=1e-5, atol=1e-6), FixedStepSolver("rk4", 0.13)
CASES = {
    "offset": (2, 0, "second_order", "linear", False, (0,), ADAPTIVE),
    "lines": (2, 1, "second_order", "linear", False, (0,), ADAPTIVE),
    "held, derivative": (2, 2, "second_order", "zero", True, (0, 3), ADAPTIVE),
    "two degrees": (4, 1, "second_order", "zero", True, (1, 7), ADAPTIVE),
    "full": (3, 2, "full", "zero", True, (2,), ADAPTIVE),
    "fixed, held": (2, 1, "second_order", "zero", True, (1,), FIXED),
    "fixed, lines": (2, 1, "full", "linear", True, (), FIXED),
}
"""States, inputs, structure, hold, whether a derivative is measured, channels with an offset, solver."""


def problem_of(case: tuple[Any, ...], hidden: tuple[int, ...] = (5,)) -> tuple[VectorField, Problem, Floats]:
    n, k, structure, hold, derivative, offsets, solver = case
    rng, generator = np.random.default_rng(n + k), torch.Generator().manual_seed(k)
    m = n // 2 if structure == "second_order" else n
    scale = torch.rand(n + k, dtype=torch.float64, generator=generator) + 0.5
    network = Mlp(n + k, hidden, m, input_scale=scale, generator=generator)
    linear = 0.3 * torch.randn(m, n + k, dtype=torch.float64, generator=generator)
    field = VectorField(network, structure, linear, inputs=k)
    times = np.linspace(0.0, 2.0, 9)
    values = rng.standard_normal((9, n))
    values[3, 0] = np.nan
    rates = None
    if derivative:
        rates = np.full((9, n), np.nan)
        rates[::2, n - 1] = rng.standard_normal(5)
    start = rng.standard_normal(n)
    start[-1] = np.nan
    drive = Drive(np.linspace(-0.1, 1.7, 7), rng.standard_normal((7, k)), hold) if k else None
    series = Series(times, values, start, rates, np.array(offsets, dtype=np.int64), drive)
    problem = Problem(
        series,
        StatedTarget((0.5,), (0.1,)).rows(times),
        states=np.nan_to_num(values),
        errors=np.ones(len(NAMES), dtype=np.int64),
        solver=solver,
    )
    return field, problem, np.concatenate([flat_parameters(field), 0.3 * rng.standard_normal(series.trained)])


def near(one: Floats, other: Floats) -> bool:
    return np.allclose(one, other, rtol=1e-9, atol=1e-9 * (1.0 + np.nanmax(np.abs(other), initial=0.0)), equal_nan=True)


@pytest.mark.parametrize("hidden", [(5,), (), (4, 3)], ids=["one layer", "no layer", "two layers"])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_both_engines_agree_at_the_same_steps(case: tuple[Any, ...], hidden: tuple[int, ...]) -> None:
    field, problem, theta = problem_of(case, hidden)
    compiled, torch_engine = (build_engine(field, problem, engine=name) for name in ("compiled", "torch"))
    found: Any = compiled.loss_jacobian(theta)
    steps = compiled.steps  # type: ignore[attr-defined]
    same = {} if isinstance(problem.solver, FixedStepSolver) else {"steps": steps.tolist()}
    expected = torch_engine.loss_jacobian(theta, **same)
    assert near(found.values, expected.values)
    assert near(found.gradients, expected.gradients)
    assert near(found.trajectory, expected.trajectory)
    forward: Any = build_engine(field, problem, engine="compiled", sensitivity="forward")
    assert near(forward.loss_jacobian(theta, steps).gradients, found.gradients)
    residuals: Any = compiled.residual_jacobian(theta, steps=steps)  # type: ignore[call-arg]
    oracle = torch_engine.residual_jacobian(theta, **same)
    assert near(residuals.residuals, oracle.residuals)
    assert near(residuals.jacobian, oracle.jacobian)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_gradient_of_sol_is_that_of_its_values(case: tuple[Any, ...]) -> None:
    field, problem, theta = problem_of(case)
    engine: Any = build_engine(field, problem.changed(terms=("sol",)), engine="compiled")
    found, steps = engine.loss_jacobian(theta), engine.steps
    rng, reach = np.random.default_rng(0), 1e-3
    for _ in range(3):
        direction = rng.standard_normal(theta.size)
        at = [engine.loss_jacobian(theta + k * reach * direction, steps).values[0] for k in (-2, -1, 1, 2)]
        quotient = (at[0] - 8.0 * at[1] + 8.0 * at[2] - at[3]) / (12.0 * reach)
        assert quotient == pytest.approx(found.gradients[0] @ direction, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("hold", ["linear", "zero"])
@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_a_driven_solution_is_scipys(engine: str, hold: str) -> None:
    solver: Solver = AdaptiveSolver(rtol=1e-9, atol=1e-10)
    field, problem, theta = problem_of((2, 2, "second_order", hold, False, (), solver))
    drive = problem.data.drive
    assert drive is not None
    found = build_engine(field, problem, engine=engine).loss_jacobian(theta).trajectory
    start = problem.data.initial_state.copy()
    start[-1] = theta[-1]
    knots = [0.0, *drive.times[(drive.times > 0.0) & (drive.times < 2.0)], 2.0]
    state, states = start, [start]
    for here, there in pairwise(knots):
        middle = drive.at(np.array([here]))[0]
        slope = 0.0 if hold == "zero" else (drive.at(np.array([there]))[0] - middle) / (there - here)

        def rate(t: float, x: Floats, here: float = here, middle: Floats = middle, slope: Any = slope) -> Floats:
            with torch.no_grad():
                return field(torch.from_numpy(x.copy()), torch.from_numpy(middle + slope * (t - here))).numpy()

        inside = problem.data.times[(problem.data.times > here) & (problem.data.times <= there)]
        solution = solve_ivp(
            rate, (here, there), state, rtol=1e-12, atol=1e-12, t_eval=[*inside, *([] if there in inside else [there])]
        )
        states += list(solution.y.T[: inside.size])
        state = solution.y[:, -1]
    assert np.abs(found - np.array(states)).max() < 1e-7


def test_steps_end_at_knots_and_one_of_no_length_follows_a_jump() -> None:
    drive = Drive(np.array([0.0, 0.25, 0.5]), np.array([[0.0], [1.0], [0.0]]), "zero")
    steps = steps_to_knots(np.full(5, 0.2), 0.0, drive)
    assert steps == pytest.approx([0.2, 0.05, 0.0, 0.15, 0.1, 0.0, 0.1, 0.2, 0.2])


def test_an_input_keeps_its_first_and_last_value_outside_of_its_samples() -> None:
    drive = Drive(np.array([1.0, 2.0]), np.array([[1.0, 4.0], [3.0, 2.0]]))
    assert drive.at(np.array([0.0, 1.0, 1.5, 2.0, 9.0])).tolist() == [[1, 4], [1, 4], [2, 3], [3, 2], [3, 2]]
    held = Drive(np.array([1.0, 2.0]), np.array([[1.0], [3.0]]), "zero")
    assert held.at(np.array([0.0, 1.5, 2.0])).ravel().tolist() == [1, 1, 3]


def test_pieces_on_one_line_are_one() -> None:
    times = np.linspace(0.0, 1.0, 11)
    assert Drive(times, 2.0 * times[:, None]).pieces[0].size == 3  # before, along, behind
    assert Drive(times, np.ones((11, 1)), "zero").pieces[0].size == 1
