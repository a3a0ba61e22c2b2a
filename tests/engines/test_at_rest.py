"""Terms at the equilibrium: exact derivatives, a named failure where there is none, and models that keep to it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import StatedTarget, TruthTarget
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, flat_parameters, load_flat
from eigenode_cli.solve.status import Status
from eigenode_cli.spectra.equilibrium import equilibrium, followed, spectrum_at, zero_of
from eigenode_cli.terms import AT_TARGET, NAMES
from tests.conftest import make_case
from tests.engines.test_residuals import field_of, problem_of

ENGINES = ("compiled", "torch")
STATED = {2: ((0.4, 0.3),), 3: ((0.4, 0.3),), 4: ((0.4, 0.3), (0.9, 0.1))}


def resting(n: int, structure: str, terms: tuple[str, ...] = NAMES) -> tuple[VectorField, Problem, Floats]:
    """A field that oscillates about an equilibrium away from zero, and a target there."""
    field = field_of(n, structure, True)
    with torch.no_grad():
        assert field.linear is not None
        m, matrix = field.linear.weight.shape[0], torch.zeros_like(field.linear.weight)
        if structure == "second_order":
            matrix[:, :m], matrix[:, m:] = torch.diag(-4.0 - 9.0 * torch.arange(m)), -0.7 * torch.eye(m)
        else:
            matrix[0, 1], matrix[1, 0] = 3.0, -2.0
            matrix -= 0.6 * torch.eye(n)
        field.linear.weight[:] = matrix
        for name, parameter in field.named_parameters():
            if name.endswith("bias"):
                parameter[:] = 0.3 * torch.cos(torch.arange(parameter.numel()))
    pairs = STATED[n]
    target = StatedTarget([pair[0] for pair in pairs], [pair[1] for pair in pairs], stiffness=(1.0, 1.05))
    problem = replace(problem_of(n, False, terms), resting=target.resting(np.zeros(1))[1])
    return field, problem, flat_parameters(field)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("n", "structure"), [(2, "second_order"), (3, "full"), (4, "second_order")])
def test_gradients_are_those_of_differences(n: int, structure: str, engine: str) -> None:
    field, problem, theta = resting(n, structure)
    built = build_engine(field, problem, engine=engine)
    found = built.loss_jacobian(theta)
    assert found.status is Status.OK
    rows = [NAMES.index(term) for term in AT_TARGET]
    rng, size = np.random.default_rng(0), 1e-5
    for _ in range(4):
        direction = rng.standard_normal(theta.size)
        ahead, back = (built.loss_jacobian(theta + sign * size * direction).values for sign in (1.0, -1.0))
        expected = ((ahead - back) / (2.0 * size))[rows]
        np.testing.assert_allclose(found.gradients[rows] @ direction, expected, rtol=2e-6, atol=1e-8)
    assert (np.abs(found.gradients[[NAMES.index("frq"), NAMES.index("dmp")]]).max(axis=1) > 1e-6).all()


def test_the_equilibrium_moves_with_the_parameters() -> None:
    """What `followed` differentiates is the implicit function: differences of equilibria found anew agree."""
    field, problem, theta = resting(2, "second_order")
    states, direction, size = problem.data.seen, np.random.default_rng(1).standard_normal(theta.size), 1e-6
    load_flat(field, theta)
    rest = equilibrium(field, states)
    assert rest is not None
    assert abs(rest[0]) > 1e-3
    moved = followed(field, rest)
    assert moved is not None
    np.testing.assert_allclose(moved.detach().numpy(), rest, atol=1e-12)
    slope = torch.cat([part.reshape(-1) for part in torch.autograd.grad(moved[0], tuple(field.parameters()))]).numpy()
    ends = []
    for sign in (1.0, -1.0):
        load_flat(field, theta + sign * size * direction)
        found = equilibrium(field, states)
        assert found is not None
        ends.append(found[0])
    assert slope @ direction == pytest.approx((ends[0] - ends[1]) / (2.0 * size), rel=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_other_terms_are_untouched_and_residuals_give_the_gradient(engine: str) -> None:
    field, problem, theta = resting(4, "second_order")
    ours, plain = (
        build_engine(field, problem, engine=engine),
        build_engine(field, replace(problem, resting=None), engine=engine),
    )
    found, along, residuals = ours.loss_jacobian(theta), plain.loss_jacobian(theta), ours.residual_jacobian(theta)
    for row, term in enumerate(NAMES):
        if term not in AT_TARGET:
            assert found.values[row] == pytest.approx(along.values[row], rel=1e-12)
            np.testing.assert_allclose(found.gradients[row], along.gradients[row], rtol=1e-8, atol=1e-12)
            continue
        part = residuals.rows[term]
        assert part.stop - part.start == 1
        assert residuals.residuals[part][0] ** 2 == pytest.approx(found.values[row], rel=1e-12)
        slope = 2.0 * residuals.jacobian[part][0] * residuals.residuals[part][0]
        np.testing.assert_allclose(slope, found.gradients[row], rtol=1e-9, atol=1e-14)
    assert [rows.start for rows in residuals.rows.values()] == sorted(rows.start for rows in residuals.rows.values())
    assert residuals.jacobian.shape == (residuals.residuals.size, theta.size)
    assert ours.residual_jacobian(theta, differentiated=False).jacobian.shape == (0, theta.size)
    recorded = ours.evaluate(theta, problem.data.times).values
    np.testing.assert_allclose(recorded, found.values, rtol=1e-12)


def test_terms_at_rest_alone() -> None:
    field, problem, theta = resting(2, "second_order", ("frq", "dmp"))
    found = build_engine(field, problem).loss_jacobian(theta)
    assert found.values.shape == (2,)
    whole = build_engine(field, replace(problem, terms=NAMES)).loss_jacobian(theta)
    np.testing.assert_allclose(found.values, whole.values[1:3], rtol=1e-12)
    unsolved = build_engine(field, problem.unsolved()).loss_jacobian(theta)
    assert unsolved.status is Status.UNSOLVED
    np.testing.assert_allclose(unsolved.gradients, found.gradients, rtol=1e-12)


def test_several_trajectories_share_the_equilibrium() -> None:
    field, problem, theta = resting(2, "second_order")
    both = replace(problem, others=(problem.until(0.6),))
    one, two = build_engine(field, problem).loss_jacobian(theta), build_engine(field, both).loss_jacobian(theta)
    row = NAMES.index("frq")
    assert two.values[row] == pytest.approx(one.values[row], rel=1e-12)
    np.testing.assert_allclose(two.gradients[row], one.gradients[row], rtol=1e-8)


@pytest.mark.parametrize("engine", ENGINES)
def test_no_equilibrium_is_a_named_failure(engine: str) -> None:
    """A field that accelerates everywhere: the solution is there, the terms at the equilibrium are not."""
    field, problem, theta = resting(2, "second_order")
    theta = np.zeros_like(theta)
    load_flat(field, theta)
    bias = flat_parameters(field)
    index = next(i for i, name in enumerate(_names(field)) if name == "network.layers.1.bias")
    bias[index] = 1.0
    built = build_engine(field, problem, engine=engine)
    for found in (built.loss_jacobian(bias), built.evaluate(bias, problem.data.times), built.residual_jacobian(bias)):
        assert found.status is Status.NO_EQUILIBRIUM
        assert found.status.label == "no_equilibrium"
        assert np.isnan(found.values[[NAMES.index(term) for term in AT_TARGET]]).all()
        assert np.isfinite(found.values[NAMES.index("sol")])


def _names(field: VectorField) -> list[str]:
    return [name for name, parameter in field.named_parameters() for _ in range(parameter.numel())]


def duffing(times: Floats) -> Series:
    """A hardening oscillator of 1 Hz at small amplitudes, which swings 20 % faster at this one."""
    spring = (2.0 * np.pi) ** 2

    class Duffing:
        title, states, parameters = "Duffing", make_case("vdp").system.states, ()

        def dynamics(self, x: Floats) -> Floats:
            return np.stack([x[..., 1], -spring * (x[..., 0] + 0.6 * x[..., 0] ** 3) - 0.3 * x[..., 1]], axis=-1)

        def jacobian(self, x: Floats) -> Floats:
            low = [-spring * (1.0 + 1.8 * x[..., 0] ** 2), np.full_like(x[..., 0], -0.3)]
            return np.stack([np.stack([0.0 * x[..., 0], 1.0 + 0.0 * x[..., 0]], -1), np.stack(low, -1)], -2)

    truth = en.Truth(Duffing(), (1.0, 0.0))
    noise = 0.01 * np.random.default_rng(0).standard_normal(times.size)
    states = truth.states(times)
    return Series(times, np.column_stack([states[:, 0] + noise, np.full(times.size, np.nan)]), np.full(2, np.nan))


def test_a_modal_test_holds_at_rest_not_along_a_large_swing() -> None:
    """1 Hz is stated. Stated at the equilibrium it is met there, and so is the damping; along the swing it is wrong."""
    times = np.linspace(0.0, 4.0, 81)
    data, target = duffing(times), StatedTarget([1.0], [0.3 / (4.0 * np.pi)])
    pair, missed = complex(-0.15, 2.0 * np.pi), {}
    for at in ("trajectory", "equilibrium"):
        field = en.modal_field(en.Mlp(2, (16,), 1, generator=torch.Generator().manual_seed(0)), data, target)
        method = en.LevenbergMarquardt(ridge=1e-8)
        fit = en.fit(field, data, target, ("sol", "frq", "dmp"), {"frq": 1e-2, "dmp": 1e-2}, method, at=at)
        rest = equilibrium(fit.field, np.zeros((1, 2)))
        assert rest is not None
        assert fit.metrics.iloc[-1]["sol"] < 1e-4  # the noise
        missed[at] = np.abs(spectrum_at(fit.field, rest) - pair).min()
    assert missed["equilibrium"] < 0.01 * abs(pair)
    assert missed["trajectory"] > 0.1 * abs(pair)


def test_a_truth_has_its_target_at_its_own_equilibrium() -> None:
    case = make_case("vdp")
    spectrum, targets = TruthTarget(case.truth).resting(np.linspace(0.0, 30.0, 91))
    np.testing.assert_allclose(np.sort(spectrum.real), [1.0, 1.0], atol=1e-6)  # mu = 2: a double eigenvalue at 1
    assert targets.pairs.tolist() == [0]
    assert zero_of(np.ones_like, lambda x: np.eye(2), np.zeros((3, 2))) is None
