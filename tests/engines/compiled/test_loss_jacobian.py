"""The loss Jacobian against a transcription in torch, finite differences, and its own other way through the steps."""

import numpy as np
import pytest

from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.solve.tableau import DOPRI5, RK4, TSIT5
from eigenode_cli.terms import NAMES
from tests.engines.compiled import oracle

# no layer is narrower than the state is wide, or eigenvalues of zero at the mercy of rounding would be compared
SHAPES = [
    pytest.param(n, hidden, structure, id=f"{n}-{hidden}-{structure}")
    for n, hidden, structure in [
        (2, (32,), "second_order"),
        (2, (), "second_order"),
        (2, (7,), "full"),
        (1, (4,), "full"),
        (3, (9, 4), "full"),
        (4, (9,), "second_order"),
        (4, (6, 11), "second_order"),
        (4, (), "full"),
        (10, (15, 20, 11), "full"),
        (10, (12,), "second_order"),
    ]
]


@pytest.mark.parametrize(("n", "hidden", "structure"), SHAPES)
@pytest.mark.parametrize("sensitivity", ["adjoint", "forward"])
def test_values_and_gradients_are_those_of_autograd(n, hidden, structure, sensitivity):
    shape = oracle.make_shape(n, hidden, structure=structure)
    problem, theta = oracle.make_problem(n), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, sensitivity=sensitivity)
    found = engine.loss_jacobian(theta)
    values, gradients = oracle.loss_jacobian(shape, problem, theta, TSIT5, engine.steps)
    assert found.n_accepted == engine.steps.size >= 2
    np.testing.assert_allclose(found.values, values, rtol=1e-9, atol=1e-13)
    assert np.abs(found.values).min() < np.abs(found.values).max()
    assert oracle.relative(found.gradients, gradients) < 1e-9


@pytest.mark.parametrize("activation", list(oracle.ACTIVATIONS))
@pytest.mark.parametrize("hidden", [(9,), (5, 4)])
def test_every_activation(activation, hidden):
    shape = oracle.make_shape(4, hidden, activation)
    problem, theta = oracle.make_problem(4), oracle.make_theta(shape, seed=3)
    engine = CompiledEngine(shape, problem)
    found = engine.loss_jacobian(theta)
    values, gradients = oracle.loss_jacobian(shape, problem, theta, TSIT5, engine.steps)
    np.testing.assert_allclose(found.values, values, rtol=1e-10, atol=1e-13)
    assert oracle.relative(found.gradients, gradients) < 1e-9


@pytest.mark.parametrize(
    ("solver", "tableau"),
    [(oracle.adaptive("dopri5"), DOPRI5), (oracle.fixed(0.15), RK4), (oracle.fixed(0.25), RK4)],
    ids=["dopri5", "rk4", "rk4 that divides the horizon"],
)
@pytest.mark.parametrize("sensitivity", ["adjoint", "forward"])
def test_every_solver(solver, tableau, sensitivity):
    shape = oracle.make_shape(4)
    problem, theta = oracle.make_problem(4, solver=solver), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, sensitivity=sensitivity)
    found = engine.loss_jacobian(theta)
    values, gradients = oracle.loss_jacobian(shape, problem, theta, tableau, engine.steps)
    np.testing.assert_allclose(found.values, values, rtol=1e-10, atol=1e-13)
    assert oracle.relative(found.gradients, gradients) < 1e-9


@pytest.mark.parametrize("terms", [("sol",), ("frq",), ("stf",), ("sol", "osc"), ("frq", "dmp", "stb", "osc")])
@pytest.mark.parametrize("n", [2, 4])
def test_terms_alone_are_rows_of_all(terms, n):
    """With few terms their cotangents are pulled back, with many the entries' derivatives are shared."""
    shape = oracle.make_shape(n)
    problem, theta = oracle.make_problem(n), oracle.make_theta(shape)
    every = CompiledEngine(shape, problem).loss_jacobian(theta)
    some = CompiledEngine(shape, oracle.make_problem(n, terms=terms)).loss_jacobian(theta)
    rows = [NAMES.index(term) for term in terms]
    np.testing.assert_array_equal(some.values, every.values[rows])
    assert oracle.relative(some.gradients, every.gradients[rows]) < 1e-12
    np.testing.assert_array_equal(some.trajectory, every.trajectory)
    if terms == ("sol",):
        assert np.isnan(some.spectra).all()  # nobody asked for them
    else:
        np.testing.assert_array_equal(some.spectra, every.spectra)


@pytest.mark.parametrize("n", [2, 10])
@pytest.mark.parametrize("sensitivity", ["adjoint", "forward"])
def test_central_differences_at_frozen_steps(n, sensitivity):
    shape = oracle.make_shape(n, (12,), structure="full")
    problem, theta = oracle.make_problem(n), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, sensitivity=sensitivity)
    gradients, steps = engine.loss_jacobian(theta).gradients, engine.steps
    for seed in range(4):
        direction = np.random.default_rng(seed).normal(size=theta.size)
        h = 2e-5
        near, far = (
            engine.loss_jacobian(theta + k * h * direction, steps).values
            - engine.loss_jacobian(theta - k * h * direction, steps).values
            for k in (1, 2)
        )
        # of fourth order
        np.testing.assert_allclose((8 * near - far) / (12 * h), gradients @ direction, rtol=2e-7, atol=1e-8)


@pytest.mark.parametrize("every", [2, 4, 20])
def test_spectra_at_every_kth_time(every):
    shape = oracle.make_shape(4)
    problem, theta = oracle.make_problem(4, count=13, every=every), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem)
    found = engine.loss_jacobian(theta)
    values, gradients = oracle.loss_jacobian(shape, problem, theta, TSIT5, engine.steps)
    assert found.spectra.shape == (len(range(0, 13, every)), 4)
    np.testing.assert_allclose(found.values, values, rtol=1e-10, atol=1e-13)
    assert oracle.relative(found.gradients, gradients) < 1e-9


@pytest.mark.parametrize("errors", [[0] * 7, [2] * 7], ids=["mae", "huber"])
def test_other_error_functions(errors):
    shape = oracle.make_shape(4)
    problem, theta = oracle.make_problem(4, errors=np.array(errors)), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem)
    found = engine.loss_jacobian(theta)
    values, gradients = oracle.loss_jacobian(shape, problem, theta, TSIT5, engine.steps)
    np.testing.assert_allclose(found.values, values, rtol=1e-10, atol=1e-13)
    assert oracle.relative(found.gradients, gradients) < 1e-9


def test_replayed_steps_give_the_same_result():
    shape = oracle.make_shape(2)
    engine = CompiledEngine(shape, oracle.make_problem(2))
    theta = oracle.make_theta(shape)
    free = engine.loss_jacobian(theta)
    frozen = engine.loss_jacobian(theta, engine.steps)
    np.testing.assert_array_equal(frozen.gradients, free.gradients)
    np.testing.assert_array_equal(frozen.trajectory, free.trajectory)


def test_both_ways_agree_on_many_states():
    shape = oracle.make_shape(40, (32,), structure="full")
    problem = oracle.make_problem(40, count=4)
    theta = oracle.make_theta(shape, size=0.1)
    adjoint, forward = (
        CompiledEngine(shape, problem, sensitivity=way).loss_jacobian(theta).gradients for way in ("adjoint", "forward")
    )
    assert oracle.relative(forward, adjoint) < 1e-12
