"""The torch solvers: orders, peers, statuses, derivatives at frozen steps."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor
from torch.autograd import forward_ad

from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.tableau import TABLEAUS
from eigenode_cli.solve.torchdiffeq_solvers import ADAPTIVE, FIXED
from eigenode_cli.solve.trajectory import Trajectory, solve


def adaptive(name: str = "tsit5", rtol: float = 1e-3, atol: float = 1e-6, max_steps: int = 10_000) -> AdaptiveSolver:
    return AdaptiveSolver(name=name, rtol=rtol, atol=atol, max_steps=max_steps)


def tensor(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values, dtype=np.float64))


def van_der_pol(x: Tensor) -> Tensor:
    return torch.stack([x[1], 2.0 * (1.0 - x[0] ** 2) * x[1] - x[0]])


def logistic(x: Tensor) -> Tensor:
    """Nonlinear with the exact solution 1 / (1 + exp(-t)) from 1/2."""
    return x * (1.0 - x)


def frozen(field: object, start: list[float], end: float, count: int, name: str, times: list[float]) -> Trajectory:
    steps = [end / count] * count
    return solve(field, tensor(start), tensor(times), adaptive(name), steps)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "order"), [("tsit5", 5), ("dopri5", 5), ("bosh3", 3), ("adaptive_heun", 2)])
def test_order_of_convergence(name: str, order: int) -> None:
    end = 4.0
    exact = 1.0 / (1.0 + math.exp(-end))
    errors = [
        abs(float(frozen(logistic, [0.5], end, count, name, [0.0, end]).states[-1, 0]) - exact) for count in (32, 64)
    ]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize(("name", "order"), [("rk4", 4), ("heun3", 3), ("midpoint", 2), ("euler", 1)])
def test_order_of_fixed_steps(name: str, order: int) -> None:
    exact = 1.0 / (1.0 + math.exp(-4.0))
    errors = []
    for count in (40, 80):
        config = FixedStepSolver(name=name, step=4.0 / count)
        errors.append(abs(float(solve(logistic, tensor([0.5]), tensor([0.0, 4.0]), config).states[-1, 0]) - exact))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("name", ["tsit5", "dopri5"])
def test_dense_output_converges_with_order_4_inside_a_step(name: str) -> None:
    """The interpolant's own error over one step, from the exact start of it, is of local order 5: global order 4."""
    errors = []
    for size in (0.2, 0.1):
        times = np.linspace(0.0, size, 9)
        states = frozen(logistic, [0.5], size, 1, name, times.tolist()).states[:, 0].numpy()
        errors.append(np.abs(states - 1.0 / (1.0 + np.exp(-times)))[1:-1].max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.2)


def test_bosh3_between_its_steps_is_of_its_order() -> None:
    errors, end = [], 4.0
    for count in (32, 64):
        times = np.linspace(0.0, end, 8 * count + 1)
        states = frozen(logistic, [0.5], end, count, "bosh3", times.tolist()).states[:, 0].numpy()
        errors.append(np.abs(states - 1.0 / (1.0 + np.exp(-times))).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize("name", ["tsit5", "dopri5", "bosh3", "dopri8"])
def test_agrees_with_scipy_at_tight_tolerance(name: str) -> None:
    times = np.linspace(0.0, 5.0, 23)
    tolerance = 1e-8 if name == "bosh3" else 1e-10
    states = solve(van_der_pol, tensor([2.0, 0.0]), tensor(times), adaptive(name, tolerance, tolerance)).states.numpy()
    peer = solve_ivp(
        lambda _t, x: [x[1], 2.0 * (1.0 - x[0] ** 2) * x[1] - x[0]],
        (0.0, 5.0),
        [2.0, 0.0],
        method="DOP853",
        t_eval=times,
        rtol=1e-13,
        atol=1e-13,
    ).y.T
    compared = slice(None) if name in TABLEAUS else slice(-1, None)  # the others interpolate with a lower order
    assert np.abs(states - peer)[compared].max() < 100.0 * tolerance


def test_error_falls_with_the_tolerance() -> None:
    times = tensor([0.0, 8.0])
    reference = solve(van_der_pol, tensor([2.0, 0.0]), times, adaptive(rtol=1e-12, atol=1e-12)).states[-1]
    errors = [
        float((solve(van_der_pol, tensor([2.0, 0.0]), times, adaptive(rtol=r, atol=r)).states[-1] - reference).norm())
        for r in (1e-3, 1e-5, 1e-7, 1e-9)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-7


def test_output_times_do_not_change_the_steps() -> None:
    few = solve(van_der_pol, tensor([2.0, 0.0]), tensor([0.0, 6.0]), adaptive())
    many = solve(van_der_pol, tensor([2.0, 0.0]), tensor(np.linspace(0.0, 6.0, 301)), adaptive())
    assert few.steps == many.steps
    assert few.n_rejected == many.n_rejected
    assert torch.equal(few.states[-1], many.states[-1])
    assert sum(few.steps) == pytest.approx(6.0, abs=1e-12)


def blow_up(x: Tensor) -> Tensor:
    return 1.0 + x**2  # tan(t): infinite at pi / 2


def test_blow_up_is_an_underflow_with_what_was_reached() -> None:
    times = np.linspace(0.0, 10.0, 101)
    result = solve(blow_up, tensor([0.0]), tensor(times), adaptive())
    assert result.status in (Status.UNDERFLOW, Status.NON_FINITE)
    reached = result.states.shape[0]
    assert times[reached - 1] < math.pi / 2 <= times[reached] + 0.1
    padded = result.padded(times.size)
    assert np.isfinite(padded[:reached]).all()
    assert np.isnan(padded[reached:]).all()
    np.testing.assert_allclose(padded[: reached - 1, 0], np.tan(times[: reached - 1]), rtol=0.05, atol=1e-3)


def test_max_steps() -> None:
    result = solve(van_der_pol, tensor([2.0, 0.0]), tensor([0.0, 30.0]), adaptive(max_steps=20))
    assert result.status is Status.MAX_STEPS
    assert result.n_accepted + result.n_rejected == 20


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("config", [adaptive(), FixedStepSolver(name="rk4", step=0.1)], ids=["adaptive", "fixed"])
def test_non_finite_from_the_start(value: float, config: AdaptiveSolver | FixedStepSolver) -> None:
    result = solve(lambda x: x * value, tensor([1.0, 2.0]), tensor([0.0, 1.0]), config)
    assert result.status is Status.NON_FINITE
    assert result.states.shape == (1, 2)


@pytest.mark.parametrize("name", ADAPTIVE)
def test_non_finite_on_the_way(name: str) -> None:
    def wall(x: Tensor) -> Tensor:
        return torch.where(x < 1.0, torch.ones_like(x), torch.full_like(x, math.nan))

    result = solve(wall, tensor([0.0]), tensor([0.0, 0.5, 2.0]), adaptive(name))
    assert result.status is Status.NON_FINITE
    assert float(result.states[-1, 0]) == pytest.approx(0.5)


@pytest.mark.parametrize("step", [0.1, 0.3, 1.0 / 3.0])
def test_fixed_steps_end_at_the_horizon_without_a_sliver(step: float) -> None:
    result = solve(logistic, tensor([0.5]), tensor([0.0, 1.0]), FixedStepSolver(name="rk4", step=step))
    assert result.n_accepted == math.ceil(1.0 / step - 1e-9)
    assert sum(result.steps) == pytest.approx(1.0)
    assert min(result.steps) > 0.05


METHODS = [adaptive(), FixedStepSolver(name="rk4", step=0.05)]


@pytest.mark.parametrize("config", METHODS, ids=["adaptive", "fixed"])
def test_times_that_repeat_show_the_same_state_again(config: AdaptiveSolver | FixedStepSolver) -> None:
    start = tensor([2.0, 0.0])
    once = solve(van_der_pol, start, tensor([0.0, 0.5, 1.0]), config).states
    twice = solve(van_der_pol, start, tensor([0.0, 0.0, 0.5, 0.5, 1.0, 1.0]), config)
    assert twice.status is Status.OK
    assert torch.equal(twice.states, once[[0, 0, 1, 1, 2, 2]])
    nowhere = solve(van_der_pol, start, tensor([3.0, 3.0]), config)
    assert torch.equal(nowhere.states, start.expand(2, 2))
    assert nowhere.n_accepted == 0


@pytest.mark.parametrize("config", METHODS, ids=["adaptive", "fixed"])
def test_whole_numbers_are_times(config: AdaptiveSolver | FixedStepSolver) -> None:
    whole = solve(van_der_pol, tensor([2.0, 0.0]), torch.tensor([0, 1, 2]), config)
    assert whole.status is Status.OK
    assert torch.equal(whole.states, solve(van_der_pol, tensor([2.0, 0.0]), tensor([0.0, 1.0, 2.0]), config).states)


@pytest.mark.parametrize("config", METHODS, ids=["adaptive", "fixed"])
@pytest.mark.parametrize(
    ("times", "answer"),
    [
        ([0.0, 2.0, 1.0], r"times\[2\] = 1.0 s follows 2.0 s; times must ascend"),
        ([1.0, 0.0], r"times\[1\] = 0.0 s follows 1.0 s"),
        ([0.0, math.nan, 1.0], r"times\[1\] is nan; times must be finite"),
        ([0.0, math.inf], r"times\[1\] is inf"),
        ([], r"shape \(0,\)"),
        ([[0.0, 1.0]], r"shape \(1, 2\)"),
    ],
)
def test_wrong_times_are_named(times: list[float], answer: str, config: AdaptiveSolver | FixedStepSolver) -> None:
    with pytest.raises(ValueError, match=answer):
        solve(van_der_pol, tensor([2.0, 0.0]), tensor(times), config)


@pytest.mark.parametrize("horizon", [1e-10, 1e-13])
def test_a_horizon_far_below_the_fixed_step_is_one_step(horizon: float) -> None:
    result = solve(van_der_pol, tensor([2.0, 1.0]), tensor([0.0, horizon]), FixedStepSolver(name="rk4", step=0.5))
    assert result.steps == [horizon]
    np.testing.assert_allclose(result.states[-1].numpy() - [2.0, 1.0], [horizon, -8.0 * horizon], rtol=1e-2, atol=1e-15)


@pytest.mark.parametrize("name", [*ADAPTIVE, *FIXED])
def test_derivative_at_frozen_steps(name: str) -> None:
    """Central difference = forward mode = reverse mode for the end state in the initial state."""
    start, times = tensor([2.0, 0.1]), tensor([0.0, 0.3, 1.0])
    config = FixedStepSolver(name=name, step=0.05) if name in FIXED else adaptive(name)
    steps = None if name in FIXED else solve(van_der_pol, start, times, config).steps

    def end(x: Tensor) -> Tensor:
        return solve(van_der_pol, x, times, config, steps).states[1:].reshape(-1)

    reverse = torch.autograd.functional.jacobian(end, start)
    direction = tensor([0.6, -0.8])
    with forward_ad.dual_level():
        forward = forward_ad.unpack_dual(end(forward_ad.make_dual(start, direction))).tangent
    h = 1e-6
    difference = (end(start + h * direction) - end(start - h * direction)) / (2.0 * h)
    torch.testing.assert_close(reverse @ direction, forward, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(difference, forward, rtol=1e-7, atol=1e-8)
