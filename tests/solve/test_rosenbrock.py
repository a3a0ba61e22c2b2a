"""Rosenbrock methods: order, dense output, stiff problems against Radau, named ends, exact discrete sensitivities."""

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import flat_parameters
from eigenode_cli.solve.drive import Drive
from eigenode_cli.solve.rosenbrock import attempt, start_of
from eigenode_cli.solve.rosenbrock_tableau import ROSENBROCK
from eigenode_cli.solve.settings import AdaptiveSolver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.trajectory import Trajectory, solve
from tests.engines.compiled import oracle
from tests.engines.test_residuals import field_of, problem_of

NAMES = tuple(ROSENBROCK)
ORDERS = {"rodas5p": (5.0, 4.0), "rosenbrock23": (2.0, 2.0)}


def vdp(mu: float):
    """The field, of tensors and of arrays."""

    def field(x):
        rates = [x[..., 1], mu * (1.0 - x[..., 0] ** 2) * x[..., 1] - x[..., 0]]
        return torch.stack(rates, -1) if isinstance(x, Tensor) else np.array(rates)

    return field


def robertson(x):
    a, b, c = x[..., 0], x[..., 1], x[..., 2]
    first, second = -0.04 * a + 1e4 * b * c, 3e7 * b**2
    rates = [first, -first - second, second]
    return torch.stack(rates, -1) if isinstance(x, Tensor) else np.array(rates)


def reference(field, start: list[float], times: Floats, method: str, tolerance: float) -> Floats:
    found = solve_ivp(
        lambda _t, x: field(x),
        (0.0, times[-1]),
        start,
        method=method,
        t_eval=times,
        rtol=tolerance,
        atol=1e-2 * tolerance,
    )
    return found.y.T


@torch.no_grad()
def solved(field, start: list[float], times: Floats, solver: AdaptiveSolver, steps=None, drive=None) -> Trajectory:
    return solve(field, torch.tensor(start, dtype=torch.float64), torch.from_numpy(times), solver, steps, drive)


@pytest.mark.parametrize("name", NAMES)
def test_order_at_the_end_and_between_the_steps(name: str) -> None:
    """On the nonlinear Van der Pol oscillator; 7 outputs in a step, which they do not change."""
    errors, between, start = [], [], [2.0, 0.5]
    for count in (40, 80, 160):
        times = np.linspace(0.0, 2.0, 7 * count + 1)
        expected = reference(vdp(1.0), start, times, "DOP853", 1e-13)
        found = solved(vdp(1.0), start, times, AdaptiveSolver(name), [2.0 / count] * count)
        assert (found.status, found.n_accepted) == (Status.OK, count)
        wrong = np.abs(found.states.numpy() - expected).max(axis=1)
        errors.append(wrong[-1])
        between.append(wrong.max())
    order, dense = ORDERS[name]
    reached, inside = np.log2(errors[1] / errors[2]), np.log2(between[1] / between[2])
    assert reached > order - 0.2
    assert inside > dense - 0.2


@pytest.mark.parametrize("name", NAMES)
def test_order_under_an_input(name: str) -> None:
    """The time enters through the input: `x' = -x^2 + u(t)`, u a ramp, so that df/dt counts."""
    drive = Drive(np.array([0.0, 2.0]), np.array([[0.0], [3.0]]))
    times, errors = np.array([0.0, 2.0]), []
    expected = solve_ivp(lambda t, x: -(x**2) + 1.5 * t, (0.0, 2.0), [0.5], rtol=1e-13, atol=1e-13, method="DOP853")
    for count in (20, 40):
        steps = [2.0 / count] * count
        found = solved(lambda x, u: -(x**2) + u, [0.5], times, AdaptiveSolver(name), steps, drive)
        errors.append(abs(float(found.states[-1, 0]) - expected.y[0, -1]))
    assert np.log2(errors[0] / errors[1]) > ORDERS[name][0] - 0.3


@pytest.mark.parametrize("name", NAMES)
def test_stability_function(name: str) -> None:
    """A step on `x' = lambda x` hardly grows on the imaginary axis and dies out at infinity: L-stability."""

    def growth(z: complex) -> float:
        matrix = torch.tensor([[z.real, -z.imag], [z.imag, z.real]], dtype=torch.float64)
        start = start_of(
            lambda _t, x: x @ matrix.T, torch.zeros((), dtype=torch.float64), torch.tensor([1.0, 0.0]).double()
        )
        tried = attempt(ROSENBROCK[name], lambda _t, x: x @ matrix.T, start, 1.0)
        assert tried is not None
        return float(torch.linalg.norm(tried.end.detach()))

    for size in (0.1, 0.5, 1.0, 3.0, 10.0, 100.0, 1e4):
        assert growth(1j * size) <= 1.0 + 1e-9
    assert growth(-1e7 + 0j) < 1e-5
    assert growth(-0.3 + 0.2j) == pytest.approx(np.exp(-0.3), rel=1e-2 if name == "rosenbrock23" else 1e-5)


def test_the_error_falls_with_the_tolerance_on_stiff_problems() -> None:
    """Van der Pol with mu = 1000, and Robertson's reaction over eleven decades, against Radau at 1e-10."""
    times = np.linspace(0.0, 2000.0, 11)
    cases = (
        (vdp(1000.0), [2.0, 0.0], times, 2.0, 1e-2),
        (robertson, [1.0, 0.0, 0.0], np.concatenate([[0.0], 10.0 ** np.arange(-2.0, 10.0)]), 1.0, 1e-4),
    )
    for field, start, outputs, size, small in cases:
        expected = reference(field, start, outputs, "Radau", 1e-10)
        errors = []
        for tolerance in (1e-3, 1e-5, 1e-7):
            found = solved(field, start, outputs, AdaptiveSolver("rodas5p", tolerance, small * tolerance))
            assert found.status is Status.OK
            assert found.n_accepted + found.n_rejected < 3000
            errors.append(np.abs(found.states.numpy() - expected)[:, 0].max() / size)
        assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]
        assert errors[2] < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_a_failure_has_a_name(name: str) -> None:
    config, times = AdaptiveSolver(name, max_steps=2000), np.array([0.0, 2.0])
    assert solved(lambda x: x**2, [1.0], times, config).status in (Status.UNDERFLOW, Status.NON_FINITE)
    assert solved(lambda x: x * float("nan"), [1.0], times, config).status is Status.NON_FINITE
    midway = solved(lambda x: torch.where(x > 1.5, torch.nan, 1.0 + 0.0 * x), [1.0], times, config)
    assert midway.status is Status.NON_FINITE
    assert (
        solved(vdp(1000.0), [2.0, 0.0], times, AdaptiveSolver(name, 1e-9, 1e-9, max_steps=5)).status is Status.MAX_STEPS
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("n", "structure"), [(2, "second_order"), (4, "full"), (10, "second_order")])
def test_sensitivities_are_those_of_differences(n: int, structure: str, name: str) -> None:
    """Five-point differences at given steps, reverse mode and forward mode, through the Jacobian in each step."""
    field = field_of(n, structure, True)
    parameters = dict(field.named_parameters())
    start, times = torch.linspace(-0.5, 0.5, n, dtype=torch.float64), torch.linspace(0.0, 1.0, 4, dtype=torch.float64)
    steps, config = [0.25] * 4, AdaptiveSolver(name)
    theta = flat_parameters(field)

    def value(vector: Tensor) -> Tensor:
        at, own = 0, {}
        for key, parameter in parameters.items():
            own[key] = vector[at : at + parameter.numel()].reshape(parameter.shape)
            at += parameter.numel()
        moved = start + vector[:n]
        found = solve(lambda x: torch.func.functional_call(field, own, (x,)), moved, times, config, steps)
        return (found.states**2).sum()

    point = torch.from_numpy(theta).requires_grad_()
    (reverse,) = torch.autograd.grad(value(point), point)
    direction = torch.randn(theta.size, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    with torch.autograd.forward_ad.dual_level():
        dual = torch.autograd.forward_ad.make_dual(torch.from_numpy(theta), direction)
        forward = float(torch.autograd.forward_ad.unpack_dual(value(dual)).tangent.detach())
    size = 1e-3
    ahead = [float(value(torch.from_numpy(theta) + k * size * direction).detach()) for k in (-2, -1, 1, 2)]
    difference = (ahead[0] - 8.0 * ahead[1] + 8.0 * ahead[2] - ahead[3]) / (12.0 * size)
    assert float(reverse @ direction) == pytest.approx(difference, rel=1e-6)
    assert forward == pytest.approx(float(reverse @ direction), rel=1e-10)


def test_all_terms_train_along_it() -> None:
    """The loss Jacobian is that of differences at the same steps; values are those of an explicit method."""
    field, problem = field_of(2, "second_order", True), problem_of(2, False)
    theta = flat_parameters(field)
    direction = np.random.default_rng(0).standard_normal(theta.size)
    engine = TorchEngine(field, problem.changed(solver=AdaptiveSolver("rodas5p")), {})
    steps = [float(problem.data.times[-1]) / 20.0] * 20
    found = engine.loss_jacobian(theta, steps)
    assert found.status is Status.OK
    explicit = TorchEngine(field, problem.changed(solver=oracle.adaptive(rtol=1e-8, atol=1e-10)), {})
    np.testing.assert_allclose(found.values, explicit.loss_jacobian(theta).values, rtol=1e-4, atol=1e-6)
    size = 1e-5
    ahead, back = (engine.loss_jacobian(theta + sign * size * direction, steps).values for sign in (1.0, -1.0))
    np.testing.assert_allclose(found.gradients @ direction, (ahead - back) / (2.0 * size), rtol=1e-6, atol=1e-7)
