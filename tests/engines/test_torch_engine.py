"""The reference engine: every term's gradient by central difference, forward and reverse mode at frozen steps."""

import dataclasses

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import VectorField, flat_parameters, load_flat
from eigenode_cli.model.activations import ACTIVATIONS
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.trajectory import solve
from eigenode_cli.terms import NAMES, PAPER_TERMS
from eigenode_cli.terms.user import user_term
from tests.conftest import Case, make_case, solver


def forward_mode(engine: TorchEngine, theta: Floats, direction: Floats, steps: list[float]) -> Floats:
    """Directional derivative of all named terms by dual numbers through solve, Jacobian, spectrum and terms."""

    class Whole(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.field = engine.field

        def forward(self) -> Tensor:
            values = engine._forward(engine.problem.terms, steps).values
            return torch.stack([values[term] for term in engine.problem.terms])

    shapes = {name: parameter.shape for name, parameter in engine.field.named_parameters()}
    sizes = [shape.numel() for shape in shapes.values()]
    with torch.autograd.forward_ad.dual_level():
        parts = zip(
            shapes.items(),
            torch.from_numpy(theta).split(sizes),
            torch.from_numpy(direction).split(sizes),
            strict=True,
        )
        duals = {
            f"field.{name}": torch.autograd.forward_ad.make_dual(value.reshape(shape), tangent.reshape(shape))
            for (name, shape), value, tangent in parts
        }
        values = torch.func.functional_call(Whole(), duals, ())
        return torch.autograd.forward_ad.unpack_dual(values).tangent.numpy()  # type: ignore[union-attr]


def near_a_merge(case: Case, field: VectorField, distance: float) -> Floats:
    """Weights whose eigenvalues at the initial state are real and `distance` apart."""
    theta, start = flat_parameters(field), torch.tensor(case.initial_state, dtype=torch.float64)

    def discriminant(scale: float) -> float:
        load_flat(field, weights(scale))
        with torch.no_grad():
            (a, b), (c, d) = field.jacobian(start).tolist()
        return (a - d) ** 2 + 4.0 * b * c

    def weights(scale: float) -> Floats:
        scaled = theta.copy()
        scaled[:64:2] *= scale  # the position's input weights: they move a21, and the discriminant with it
        return scaled

    low, high = next(
        (a, b)
        for a, b in zip(np.linspace(-40, 40, 81)[:-1], np.linspace(-40, 40, 81)[1:], strict=True)
        if (discriminant(a) - distance**2) * (discriminant(b) - distance**2) < 0
    )
    for _ in range(60):
        middle = 0.5 * (low + high)
        if (discriminant(low) - distance**2) * (discriminant(middle) - distance**2) <= 0:
            high = middle
        else:
            low = middle
    return weights(0.5 * (low + high))


def check_gradients(engine: TorchEngine, theta: Floats, seed: int, h: float) -> None:
    reference = engine.loss_jacobian(theta)
    steps = engine_steps(engine, theta)
    reverse = engine.loss_jacobian(theta, steps)
    np.testing.assert_array_equal(reference.values, reverse.values)
    direction = np.random.default_rng(seed).normal(size=theta.size)
    direction /= np.linalg.norm(direction)
    forward = forward_mode(engine, theta, direction, steps)
    ahead, behind = (engine.loss_jacobian(theta + s * h * direction, steps).values for s in (1.0, -1.0))
    far, back = (engine.loss_jacobian(theta + s * h * direction, steps).values for s in (2.0, -2.0))
    difference = (8.0 * (ahead - behind) - (far - back)) / (12.0 * h)  # the five-point formula
    scale = np.linalg.norm(reverse.gradients, axis=1)
    np.testing.assert_allclose(reverse.gradients @ direction, forward, rtol=1e-9, atol=1e-12)
    assert (np.abs(difference - forward) <= 1e-6 * np.maximum(scale, 1e-3)).all(), (difference, forward, scale)


def engine_steps(engine: TorchEngine, theta: Floats) -> list[float]:
    load_flat(engine.field, theta)
    with torch.no_grad():
        return solve(engine.field, engine._start(), engine._times, engine.problem.solver).steps


@pytest.mark.parametrize("jacobian", ["autodiff", "symbolic", "finite_difference"])
def test_gradients_at_random_weights(case: Case, jacobian: str) -> None:
    field = case.field(seed=3)
    engine = TorchEngine(field, case.problem(jacobian=jacobian), {})
    check_gradients(engine, flat_parameters(field), seed=1, h=1e-5)


def test_gradients_near_a_merge(case: Case) -> None:
    """At the initial state two real eigenvalues stand 1e-2 apart: the gap's slope in A is a hundredfold."""
    case = dataclasses.replace(case, horizon=3.0, points=13)  # later on the saturated field has a defective Jacobian
    field = case.field(seed=3)
    theta = near_a_merge(case, field, 1e-2)
    engine = TorchEngine(field, case.problem(), {})
    spectrum = engine.loss_jacobian(theta).spectra[0]
    assert abs(spectrum[0] - spectrum[1]) == pytest.approx(1e-2, rel=1e-3)
    assert engine.loss_jacobian(theta).guard_count == 0
    check_gradients(engine, theta, seed=2, h=1e-7)


def test_three_ways_to_the_jacobian_agree(case: Case) -> None:
    theta = flat_parameters(case.field())
    results = {
        name: TorchEngine(case.field(), case.problem(jacobian=name), {}).loss_jacobian(theta)
        for name in ("autodiff", "symbolic", "finite_difference")
    }
    exact = results["autodiff"]
    np.testing.assert_allclose(results["symbolic"].values, exact.values, rtol=1e-12)
    np.testing.assert_allclose(results["symbolic"].gradients, exact.gradients, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(results["finite_difference"].values, exact.values, rtol=1e-5)


def test_fewer_spectra_leave_the_solution_alone() -> None:
    case = make_case("oscillator")
    theta = flat_parameters(case.field())
    every = TorchEngine(case.field(), case.problem(), {}).loss_jacobian(theta)
    problem = case.problem()
    fewer = case.problem(every=4, targets=problem.targets.rows(np.arange(0, 101, 4)))
    some = TorchEngine(case.field(), fewer, {}).loss_jacobian(theta)
    assert some.spectra.shape == (26, 2)
    np.testing.assert_array_equal(some.spectra, every.spectra[::4])
    assert some.values[0] == every.values[0]


def test_evaluation_agrees_with_the_loss_jacobian(case: Case) -> None:
    field = case.field()
    engine = TorchEngine(field, case.problem(), {})
    theta = flat_parameters(field)
    jacobian, evaluation = engine.loss_jacobian(theta), engine.evaluate(theta, case.problem().data.times)
    *values, no_step = evaluation.values
    np.testing.assert_array_equal(values, jacobian.values)
    assert np.isnan(no_step)
    np.testing.assert_array_equal(evaluation.dense, jacobian.trajectory)
    assert (evaluation.n_accepted, evaluation.n_rejected) == (jacobian.n_accepted, jacobian.n_rejected)


def test_a_users_own_term_is_one_more_row() -> None:
    case = make_case("oscillator")

    def energy(trajectory: Tensor, spectra: Tensor, times: Tensor) -> Tensor:
        return (trajectory**2).mean() + spectra.real.mean() + times.sum()

    engine = TorchEngine(case.field(), case.problem(terms=("sol", "energy")), {"energy": user_term(energy)})
    theta = flat_parameters(case.field())
    result = engine.loss_jacobian(theta)
    assert result.gradients.shape == (2, 129)
    expected = (result.trajectory**2).mean() + result.spectra.real.mean() + engine.problem.data.times.sum()
    assert result.values[1] == pytest.approx(expected)
    assert engine.evaluate(theta, engine.problem.data.times).values.shape == (8,)


class Explosive(nn.Module):
    """Acceleration `a v + b v^3`: blows up in finite time for b > 0."""

    def __init__(self) -> None:
        super().__init__()
        self.coefficients = nn.Parameter(torch.tensor([0.5, 0.5], dtype=torch.float64))

    def forward(self, x: Tensor) -> Tensor:
        v = x[..., 1:]
        return -x[..., :1] + self.coefficients[0] * v + self.coefficients[1] * v**3


def test_failed_solve_keeps_the_spectral_terms() -> None:
    case = make_case("oscillator")
    engine = TorchEngine(VectorField(Explosive(), "second_order"), case.problem(), {})
    result = engine.loss_jacobian(np.array([0.5, 0.5]))
    assert result.status is not Status.OK
    assert np.isnan(result.trajectory).any()
    values = dict(zip(PAPER_TERMS, result.values, strict=True))
    assert np.isnan(values["sol"])
    assert values["stb"] > 0.0
    gradient = result.gradients[NAMES.index("stb")]
    assert np.isfinite(gradient).all()
    assert (gradient > 0.0).all()  # both coefficients have to come down
    assert np.abs(gradient).max() < 1e4  # far states, of any size, stay out of it
    assert np.isnan(result.gradients[0]).all()


def test_failed_solve_without_stabilisation_is_undefined() -> None:
    case = make_case("oscillator")
    engine = TorchEngine(VectorField(Explosive(), "second_order"), case.problem(stabilise=False), {})
    result = engine.loss_jacobian(np.array([0.5, 0.5]))
    assert np.isnan(result.values).all()
    assert np.isnan(result.gradients).all()


def test_a_term_without_a_value_has_no_gradient() -> None:
    case = make_case("vdp")
    engine = TorchEngine(case.field(), case.problem(terms=("sol", "stb")), {})
    result = engine.loss_jacobian(np.full_like(flat_parameters(case.field()), np.nan))
    assert result.status is Status.NON_FINITE
    assert np.isnan(result.values).all()
    assert np.isnan(result.gradients).all()


@pytest.mark.parametrize("name", ["softplus", "sigmoid", "silu", "elu"])
def test_dead_units_have_a_second_derivative(name: str) -> None:
    z = torch.tensor([-2000.0, -800.0, -50.0, 800.0], dtype=torch.float64, requires_grad=True)
    (first,) = torch.autograd.grad(ACTIVATIONS[name][0](z).sum(), z, create_graph=True)
    (second,) = torch.autograd.grad(first.sum(), z)
    assert second.isfinite().all()
    torch.testing.assert_close(first, ACTIVATIONS[name][1](z))


def test_max_steps_is_a_failed_solve() -> None:
    case = make_case("vdp")
    engine = TorchEngine(case.field(), case.problem(solver=solver(max_steps=5)), {})
    assert engine.loss_jacobian(flat_parameters(case.field())).status is Status.MAX_STEPS
