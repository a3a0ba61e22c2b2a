"""The solve: orders of convergence, dense output, first step, statuses that the torch engine agrees with."""

import numpy as np
import pytest
import torch
from torchdiffeq._impl.misc import _rms_norm, _select_initial_step

from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import flat_parameters
from eigenode_cli.solve.status import Status
from tests.conftest import make_case
from tests.engines.compiled import oracle


@pytest.mark.parametrize("method", ["tsit5", "dopri5"])
def test_order_at_the_end_of_the_steps(method):
    shape = oracle.make_shape(2, (6,), structure="full")
    theta = oracle.make_theta(shape, seed=2, size=1.0)
    problem = oracle.make_problem(2, horizon=2.0, solver=oracle.adaptive(method), terms=("sol",))
    tight = oracle.replace(problem, solver=oracle.adaptive(rtol=1e-13, atol=1e-14))
    exact = CompiledEngine(shape, tight).loss_jacobian(theta).trajectory[-1]
    engine = CompiledEngine(shape, problem)
    errors = [
        np.abs(engine.loss_jacobian(theta, np.full(count, 2.0 / count)).trajectory[-1] - exact).max()
        for count in (20, 40)
    ]
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 5, atol=0.2)


def test_order_of_the_fixed_step_method():
    shape = oracle.make_shape(2, (6,), structure="full")
    theta = oracle.make_theta(shape, seed=2, size=1.0)

    def end(solver):
        problem = oracle.make_problem(2, horizon=2.0, solver=solver, terms=("sol",))
        return CompiledEngine(shape, problem).loss_jacobian(theta).trajectory[-1]

    exact = end(oracle.adaptive(rtol=1e-13, atol=1e-14))
    errors = [np.abs(end(oracle.fixed(step)) - exact).max() for step in (0.1, 0.05)]
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4, atol=0.2)


@pytest.mark.parametrize("method", ["tsit5", "dopri5"])
def test_dense_output_is_of_fourth_order(method):
    """Local error of fifth order: at a fixed fraction of one step."""
    shape = oracle.make_shape(2, (6,), structure="full")
    theta = oracle.make_theta(shape, seed=2, size=1.0)
    errors = []
    for h in (0.2, 0.1):
        problem = oracle.make_problem(2, count=3, solver=oracle.adaptive(method), terms=("sol",))
        data = oracle.replace(problem.data, times=np.array([0.0, 0.4 * h, h]))
        problem = oracle.replace(problem, data=data)
        tight = oracle.replace(problem, solver=oracle.adaptive(rtol=1e-13, atol=1e-15))
        exact = CompiledEngine(shape, tight).loss_jacobian(theta).trajectory[1]
        found = CompiledEngine(shape, problem).loss_jacobian(theta, np.array([h])).trajectory[1]
        errors.append(np.abs(found - exact).max())
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 5, atol=0.4)


@pytest.mark.parametrize("size", [1e-9, 0.1, 3.0])
def test_first_step_is_that_of_torchdiffeq(size):
    shape = oracle.make_shape(4)
    theta = oracle.make_theta(shape, size=size)
    problem = oracle.make_problem(4, horizon=1000.0)
    engine = CompiledEngine(shape, problem)
    engine.loss_jacobian(theta)
    start = torch.from_numpy(problem.data.initial_state)
    wanted = _select_initial_step(
        lambda _t, x: oracle.field(shape, torch.from_numpy(theta), x),
        torch.tensor(0.0, dtype=torch.float64),
        start,
        4,
        1e-3,
        1e-6,
        _rms_norm,
    )
    np.testing.assert_allclose(engine.steps[0], float(wanted), rtol=1e-12)


def test_first_step_from_rest():
    """Where the field vanishes nothing says how long a step may be."""
    shape = MlpShape((2, 2), "identity", "full", np.ones(2), np.ones(2))
    problem = oracle.make_problem(2)
    engine = CompiledEngine(shape, problem)
    found = engine.loss_jacobian(np.zeros(6))
    assert engine.steps[0] == 1e-6
    np.testing.assert_array_equal(found.trajectory, np.tile(problem.data.initial_state, (9, 1)))


@pytest.mark.parametrize("name", ["oscillator", "sparse_oscillator", "vdp"])
@pytest.mark.parametrize("seed", [0, 1])
def test_both_engines_agree_with_free_steps(name, seed):
    case = make_case(name)
    field = case.field(seed)
    problem, theta = case.problem(), flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    peer = TorchEngine(field, problem, {}).loss_jacobian(theta)
    assert (compiled.status, compiled.n_accepted, compiled.n_rejected, compiled.guard_count) == (
        peer.status,
        peer.n_accepted,
        peer.n_rejected,
        peer.guard_count,
    )
    np.testing.assert_allclose(compiled.values, peer.values, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(compiled.trajectory, peer.trajectory, rtol=1e-8, atol=1e-9)
    assert oracle.relative(compiled.gradients, peer.gradients) < 1e-8


@pytest.mark.parametrize("max_steps", [3, 10_000])
def test_both_engines_agree_on_failures(max_steps):
    case = make_case("vdp")
    field = case.field(0, activation="relu", init="uniform01")
    problem = case.problem(solver=oracle.adaptive(max_steps=max_steps))
    theta = 4.0 * flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    peer = TorchEngine(field, problem, {}).loss_jacobian(theta)
    assert compiled.status is peer.status
    assert compiled.status is not Status.OK
    np.testing.assert_array_equal(np.isnan(compiled.trajectory), np.isnan(peer.trajectory))
    np.testing.assert_array_equal(np.isnan(compiled.values), np.isnan(peer.values))
    np.testing.assert_allclose(compiled.values, peer.values, rtol=1e-9)
    assert oracle.relative(compiled.gradients[1:], peer.gradients[1:]) < 1e-8
