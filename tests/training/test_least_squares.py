"""Levenberg-Marquardt: on a linear problem, with a ridge, robust losses, the evidence, and where it ends."""

import math

import numpy as np
import pytest

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import ResidualJacobian
from eigenode_cli.solve.status import Status
from eigenode_cli.training.least_squares import Iteration, LeastSquares, term_units
from tests.conftest import make_case

RANDOM = np.random.default_rng(5)


class Linear:
    """Residuals `A theta - b` of SOL, and those of a second term that are zero; fails where theta[0] is above 100."""

    def __init__(self, matrix: Floats, goal: Floats) -> None:
        self.matrix, self.goal, self.calls = matrix, goal, 0

    def residual_jacobian(self, theta: Floats, differentiated: bool = True) -> ResidualJacobian:
        self.calls += 1
        count, size = self.goal.size, theta.size
        residuals = np.concatenate([self.matrix @ theta - self.goal, np.zeros(3)])
        jacobian = np.vstack([self.matrix, np.zeros((3, size))]) if differentiated else np.zeros((0, size))
        rows = {"sol": slice(0, count), "frq": slice(count, count + 3)}
        status = Status.OK if theta[0] < 100.0 else Status.UNDERFLOW
        return ResidualJacobian(residuals, jacobian, rows, np.zeros(2), status, 1)


def problem(rows: int = 12, columns: int = 4, noise: float = 0.0) -> tuple[Linear, Floats]:
    matrix, truth = RANDOM.normal(size=(rows, columns)), RANDOM.normal(size=columns)
    return Linear(matrix, matrix @ truth + noise * RANDOM.normal(size=rows)), truth


def minimised(engine: Linear, start: Floats, steps: int = 60, **options: object) -> tuple[Floats, Iteration]:
    squares = LeastSquares(engine, np.ones(2), **options)  # type: ignore[arg-type]
    iteration, theta = Iteration(1e-3, 1e-14), start.copy()
    for _ in range(steps):
        iteration.step(theta, squares.at(theta), squares.value)
    return theta, iteration


def test_a_linear_problem_is_solved() -> None:
    engine, truth = problem()
    theta, iteration = minimised(engine, np.zeros(4))
    np.testing.assert_allclose(theta, truth, atol=1e-9)
    assert iteration.converged
    assert iteration.memory[3] < 30


def test_gradient_and_matrix_are_those_of_the_sum() -> None:
    engine, _ = problem(noise=0.3)
    penalised = np.array([True, False, True, False])
    squares = LeastSquares(engine, np.array([2.0, 1.0]), penalised=penalised)
    squares.ridge = 0.7
    theta = RANDOM.normal(size=4)
    here = squares.at(theta)
    assert here.value == pytest.approx(squares.value(theta))
    for i in range(4):
        step = np.zeros(4)
        step[i] = 1e-6
        slope = (squares.value(theta + step) - squares.value(theta - step)) / 2e-6
        assert 2.0 * here.gradient[i] == pytest.approx(slope, rel=1e-6, abs=1e-8)
        curved = (squares.value(theta + step * 1e3) - 2 * here.value + squares.value(theta - step * 1e3)) / 1e-6
        assert 2.0 * here.curvature[i] == pytest.approx(curved, rel=1e-5)


def test_the_slope_of_huber_is_that_of_its_value() -> None:
    engine, _ = problem(noise=1.0)
    squares = LeastSquares(engine, np.ones(2), huber=0.4)
    theta = RANDOM.normal(size=4)
    direction = RANDOM.normal(size=4)
    slope = (squares.value(theta + 1e-6 * direction) - squares.value(theta - 1e-6 * direction)) / 2e-6
    assert 2.0 * squares.at(theta).gradient @ direction == pytest.approx(slope, rel=1e-6)


def test_huber_does_not_follow_an_outlier() -> None:
    engine, truth = problem(rows=40)
    engine.goal[3] += 50.0
    plain, _ = minimised(engine, np.zeros(4))
    robust, _ = minimised(engine, np.zeros(4), steps=200, huber=0.01)
    assert np.abs(plain - truth).max() > 0.1
    assert np.abs(robust - truth).max() < 0.01


def test_held_parameters_stay() -> None:
    engine, _ = problem()
    trained = np.array([True, True, False, True])
    theta, _ = minimised(engine, np.full(4, 0.25), trained=trained)
    assert theta[2] == 0.25
    assert (theta[trained] != 0.25).all()


def test_the_evidence_knows_noise_from_signal() -> None:
    """The ridge is the ratio of the variances of noise and parameters, here 0.1^2 / (N 1) in units of the mean."""
    matrix, truth = RANDOM.normal(size=(400, 60)), RANDOM.normal(size=60)
    engine = Linear(matrix, matrix @ truth + 0.1 * RANDOM.normal(size=400))
    squares = LeastSquares(engine, np.ones(2), penalised=np.ones(60, dtype=bool), evidence=True)
    iteration, theta = Iteration(1e-3, 0.0), np.zeros(60)
    squares.ridge = 1e-6
    for _ in range(30):
        iteration.step(theta, squares.at(theta), squares.value)
        squares.ridge = squares.evidence_ridge(theta)
        iteration.restart()
    assert squares.ridge == pytest.approx(0.01 / 400, rel=0.5)


def test_where_the_solve_fails_it_turns_back() -> None:
    engine = Linear(np.eye(2), np.array([99.0, 0.0]))
    squares = LeastSquares(engine, np.ones(2))
    theta = np.array([0.0, 0.0])
    assert math.isinf(squares.value(np.array([200.0, 0.0])))
    iteration = Iteration(1e-3, 1e-12)
    for _ in range(50):
        iteration.step(theta, squares.at(theta), squares.value)
    np.testing.assert_allclose(theta, [99.0, 0.0], atol=1e-6)


def test_units_are_those_of_data_and_targets() -> None:
    case = make_case("oscillator")
    units = term_units(case.problem())
    frequency = np.sqrt(25.0 - 0.025**2) / (2.0 * np.pi)
    assert units["frq"] == pytest.approx(frequency**2)
    assert units["stb"] == pytest.approx((2.0 * np.pi * frequency) ** 2)
    assert units["sol"] == pytest.approx(np.nanmean(case.problem().data.values ** 2))
    assert units["dmp"] == units["stf"] == 1.0


@pytest.mark.parametrize("rows", [3, 40])
def test_a_step_solves_the_damped_normal_equations_whichever_way(rows: int) -> None:
    matrix, right, theta = RANDOM.normal(size=(rows, 12)), RANDOM.normal(size=rows), RANDOM.normal(size=12)
    penalised = np.arange(12) < 7
    function = LeastSquares(Linear(matrix, right), np.ones(2), penalised=penalised)  # type: ignore[arg-type]
    function.ridge = 0.3
    here = function.at(theta)
    change = here.change(0.05)
    assert change is not None
    weighted = matrix / np.sqrt(rows)
    normal = weighted.T @ weighted + np.diag(0.3 * penalised + 0.05)
    np.testing.assert_allclose(normal @ change, -here.gradient, rtol=1e-9, atol=1e-12)
