"""BFGS against known minima and scipy's, its line search against the conditions that it promises."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from eigenode_cli.arrays import Floats
from eigenode_cli.training.bfgs import CURVATURE, DECREASE, TRIALS, Bfgs, Lbfgs, Point, QuasiNewton, line_search


def rosenbrock(theta: Floats) -> Point:
    return Point(float(rosen(theta)), rosen_der(theta))


def descend(bfgs: QuasiNewton, theta: Floats, function, steps: int) -> None:
    for _ in range(steps):
        bfgs.step(theta, function(theta), function)


def test_reaches_the_minimum_of_rosenbrock_about_as_fast_as_scipy() -> None:
    start = np.array([-1.2, 1.0, -0.5, 0.8])
    peer = minimize(rosen, start, jac=rosen_der, method="BFGS", options={"gtol": 1e-8})
    theta, bfgs = start.copy(), Bfgs(4)
    descend(bfgs, theta, rosenbrock, 2 * peer.nit)
    np.testing.assert_allclose(theta, 1.0, atol=1e-6)


def test_the_inverse_hessian_obeys_the_secant_equation() -> None:
    theta, bfgs = np.array([-1.2, 1.0, -0.5, 0.8]), Bfgs(4)
    for _ in range(10):
        before = theta.copy()
        bfgs.step(theta, rosenbrock(theta), rosenbrock)
        inverse, change = bfgs.state()["inverse_hessian"], rosenbrock(theta).gradient - rosenbrock(before).gradient
        np.testing.assert_allclose(inverse @ change, theta - before, atol=1e-10)
        assert np.linalg.eigvalsh(inverse).min() > 0.0


def test_never_goes_up_even_over_kinks() -> None:
    def kinked(theta: Floats) -> Point:
        return Point(float(np.abs(theta).sum() + theta[0] ** 2), np.sign(theta) + np.array([2.0 * theta[0], 0.0, 0.0]))

    theta, bfgs, values = np.array([3.0, -2.0, 1.0]), Bfgs(3), []
    for _ in range(60):
        values.append(kinked(theta).value)
        bfgs.step(theta, kinked(theta), kinked)
    assert np.all(np.diff(values) <= 0.0)
    assert values[-1] < 1e-6


@pytest.mark.parametrize("length", [1e-3, 1.0, 50.0])
def test_the_line_search_meets_the_weak_wolfe_conditions(length: float) -> None:
    theta = np.array([-1.2, 1.0])
    here = rosenbrock(theta)
    direction = -here.gradient
    found = line_search(theta, direction, length, here, rosenbrock)
    assert found is not None
    there, point = found
    slope, taken = here.gradient @ direction, (there - theta) @ direction / (direction @ direction)
    assert point.value <= here.value + DECREASE * taken * slope
    assert point.gradient @ direction >= CURVATURE * slope


def test_a_point_without_value_is_not_taken() -> None:
    def walled(theta: Floats) -> Point:
        return Point((theta[0] - 2.0) ** 2 if theta[0] < 1.0 else math.inf, 2.0 * (theta - 2.0))

    theta, bfgs = np.array([-5.0]), Bfgs(1)
    descend(bfgs, theta, walled, 200)
    assert 0.9 < theta[0] < 1.0


def test_stuck_in_a_jump_it_asks_for_nothing_until_restarted() -> None:
    calls = []

    def jump(theta: Floats) -> Point:
        calls.append(1)
        return Point(float(theta[0] if theta[0] >= 1.0 else theta[0] + 9.0), np.ones(1))

    theta, bfgs = np.ones(1), Bfgs(1)
    bfgs.step(theta, jump(theta), jump)
    assert bfgs.stuck
    assert len(calls) == 1 + TRIALS
    bfgs.step(theta, Point(1.0, np.ones(1)), jump)
    assert len(calls) == 1 + TRIALS
    assert theta[0] == 1.0
    bfgs.restart()
    assert not bfgs.stuck


def test_uphill_and_flat_have_no_lower_point() -> None:
    theta = np.zeros(2)
    assert line_search(theta, np.ones(2), 1.0, Point(0.0, np.ones(2)), rosenbrock) is None
    assert line_search(theta, np.zeros(2), 1.0, Point(0.0, np.zeros(2)), rosenbrock) is None


def test_the_two_loops_are_the_matrix_of_the_pairs() -> None:
    rng = np.random.default_rng(0)
    limited = Lbfgs(5, pairs=3)
    pairs = []
    for _ in range(5):
        step = rng.standard_normal(5)
        change = step + 0.3 * rng.standard_normal(5)
        if step @ change > 0.0:
            limited._learn(step, change, float(step @ change))
            limited._phase[0] = 1.0
            pairs.append((step, change))
    step, change = pairs[-1]
    matrix = np.eye(5) * (step @ change) / (change @ change)
    for step, change in pairs[-3:]:
        left = np.eye(5) - np.outer(step, change) / (step @ change)
        matrix = left @ matrix @ left.T + np.outer(step, step) / (step @ change)
    gradient = rng.standard_normal(5)
    np.testing.assert_allclose(limited._scaled(gradient), matrix @ gradient, rtol=1e-12)


def test_limited_memory_reaches_the_minimum_of_rosenbrock_about_as_fast_as_scipy() -> None:
    start = np.tile([-1.2, 1.0], 20)
    peer = minimize(rosen, start, jac=rosen_der, method="L-BFGS-B", options={"gtol": 1e-8, "maxcor": 10})
    theta, limited = start.copy(), Lbfgs(40, pairs=10)
    descend(limited, theta, rosenbrock, 2 * peer.nit)
    np.testing.assert_allclose(theta, 1.0, atol=1e-5)


def test_limited_memory_goes_on_from_its_state() -> None:
    theta, first, second = np.array([-1.2, 1.0, -0.5, 0.8]), Lbfgs(4, 3), Lbfgs(4, 3)
    descend(first, theta, rosenbrock, 7)
    for name, array in second.state().items():
        array[:] = first.state()[name]
    copy = theta.copy()
    descend(first, theta, rosenbrock, 3)
    descend(second, copy, rosenbrock, 3)
    assert theta.tobytes() == copy.tobytes()
