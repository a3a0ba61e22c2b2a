"""What surrounds the numbers of the compiled engine: statuses, failures, user terms, evaluation, determinism."""

import resource
import threading
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from eigenode_cli.engines.compiled.buffers import FIRST_CAPACITY
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.tableau import TSIT5
from eigenode_cli.solve.times import fixed_steps
from eigenode_cli.terms.array_term import ArrayTerm
from tests.engines.compiled import oracle


def linear(matrix: np.ndarray) -> tuple[MlpShape, np.ndarray]:
    """The field `dx/dt = matrix x` as a network without hidden layers."""
    n = len(matrix)
    shape = MlpShape((n, n), "identity", "full", np.ones(n), np.ones(n))
    return shape, np.concatenate([matrix.ravel(), np.zeros(n)])


EXPLODING = linear(np.diag([400.0, 500.0]))


def test_states_are_those_of_scipy_at_tight_tolerance():
    shape = oracle.make_shape(4, (8,))
    theta = oracle.make_theta(shape)
    problem = oracle.make_problem(4, solver=oracle.adaptive(rtol=1e-10, atol=1e-12), horizon=3.0)
    found = CompiledEngine(shape, problem).loss_jacobian(theta)

    def rates(_t, x):
        return oracle.field(shape, torch.from_numpy(theta), torch.from_numpy(x)).numpy()

    wanted = solve_ivp(
        rates,
        (0.0, 3.0),
        problem.data.initial_state,
        method="DOP853",
        t_eval=problem.data.times,
        rtol=1e-12,
        atol=1e-12,
    )
    np.testing.assert_allclose(found.trajectory, wanted.y.T, rtol=1e-7, atol=1e-8)


def test_output_times_do_not_change_the_steps():
    shape = oracle.make_shape(2)
    theta = oracle.make_theta(shape)
    steps = []
    for count in (2, 9, 200):
        problem = oracle.make_problem(2, count=count)
        problem.data.initial_state[:] = [1.0, -0.5]
        engine = CompiledEngine(shape, problem)
        engine.loss_jacobian(theta)
        steps.append(engine.steps)
    np.testing.assert_array_equal(steps[0], steps[1])
    np.testing.assert_array_equal(steps[0], steps[2])


@pytest.mark.parametrize("stabilise", [True, False])
def test_a_field_that_overflows(stabilise):
    """`exp(500 t)` overflows at 1.42 s of 3; the spectrum is known, so the stabilising terms are."""
    shape, theta = EXPLODING
    problem = oracle.make_problem(
        2, horizon=3.0, count=31, stabilise=stabilise, solver=oracle.adaptive(max_steps=10**6)
    )
    found = CompiledEngine(shape, problem).loss_jacobian(theta)
    assert found.status is Status.NON_FINITE
    reached = np.isfinite(found.trajectory).all(axis=1)
    assert reached.any()
    assert np.all(np.diff(reached.astype(int)) <= 0)
    assert np.isnan(found.values[0])
    assert np.isnan(found.gradients[0]).all()
    if stabilise:
        # STB, squared errors: both eigenvalues at every state, margin 5
        np.testing.assert_allclose(found.values[3], (405.0**2 + 505.0**2) / 2, rtol=1e-12)
        np.testing.assert_allclose(found.gradients[3], [405.0, 0.0, 0.0, 505.0, 0.0, 0.0], rtol=1e-9, atol=1e-9)
    else:
        assert np.isnan(found.values).all()
        assert np.isnan(found.gradients).all()


def test_stabilising_terms_are_those_of_the_states_that_count():
    """Against autograd, at the states within reach and at the data states, all of them constants."""
    shape = oracle.make_shape(2, (6,), "relu", "full")
    theta = oracle.make_theta(shape, seed=4, size=3.0)
    problem = oracle.make_problem(2, horizon=40.0, count=200, solver=oracle.adaptive(max_steps=60))
    found = CompiledEngine(shape, problem).loss_jacobian(theta)
    assert found.status is Status.MAX_STEPS
    reached = found.trajectory[np.isfinite(found.trajectory).all(axis=1)]
    rows = problem.stabilising_rows(reached)
    assert 0 < rows.size < len(reached) < 200
    leaf = torch.from_numpy(theta.copy()).requires_grad_()
    states = torch.from_numpy(np.concatenate([reached[rows], problem.states]))
    spectra = torch.linalg.eigvals(oracle.jacobians(shape, leaf, states))
    targets = problem.targets.rows(np.concatenate([rows, np.arange(200)]))
    values = oracle.spectral_values(spectra, oracle.NAMES[1:], targets, problem.margin, problem.errors, 0.3)
    np.testing.assert_allclose(found.values[1:], values.detach().numpy(), rtol=1e-10)
    for value, gradient in zip(values, found.gradients[1:], strict=True):
        wanted = torch.autograd.grad(value, leaf, retain_graph=True)[0].numpy()
        assert oracle.relative(gradient, wanted) < 1e-8


def test_max_steps():
    shape = oracle.make_shape(2)
    engine = CompiledEngine(shape, oracle.make_problem(2, solver=oracle.adaptive(max_steps=3, rtol=1e-8)))
    found = engine.loss_jacobian(oracle.make_theta(shape))
    assert found.status is Status.MAX_STEPS
    assert found.n_accepted + found.n_rejected == 3
    assert np.isfinite(found.trajectory[0]).all()
    assert np.isnan(found.trajectory[-1]).all()
    assert np.isnan(found.spectra[-1]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_field_that_is_not_finite_at_the_start(bad):
    shape = oracle.make_shape(2)
    theta = oracle.make_theta(shape)
    theta[-1] = bad
    found = CompiledEngine(shape, oracle.make_problem(2)).loss_jacobian(theta)
    assert found.status is Status.NON_FINITE
    assert (found.n_accepted, found.n_rejected) == (0, 0)
    assert np.isnan(found.values[0])


def test_underflow():
    """Tolerances that no step can meet."""
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, solver=oracle.adaptive(rtol=0.0, atol=1e-300))
    found = CompiledEngine(shape, problem).loss_jacobian(oracle.make_theta(shape))
    assert found.status is Status.UNDERFLOW


def test_a_fixed_step_that_explodes():
    shape, theta = EXPLODING
    problem = oracle.make_problem(2, horizon=3.0, solver=oracle.fixed(0.01))
    found = CompiledEngine(shape, problem).loss_jacobian(theta)
    assert found.status is Status.NON_FINITE
    assert found.n_rejected == 0


@pytest.mark.parametrize("sensitivity", ["adjoint", "forward"])
@pytest.mark.parametrize(
    "matrix",
    [
        [[0.0, 0.0], [0.0, 0.0]],
        [[1.0, 0.0], [0.0, 1.0]],
        [[-0.5, 1.0], [0.0, -0.5]],
        [[0.0, 0.0], [3.0, 0.0]],
        [[-0.3, 1.0, 0.0], [0.0, -0.3, 1.0], [0.0, 0.0, -0.3]],
    ],
    ids=["zero", "identity", "jordan", "lower jordan", "jordan of 3"],
)
def test_guard_bounds_gradients_where_eigenvalues_meet(matrix, sensitivity):
    a = np.array(matrix)
    shape, theta = linear(a)
    problem = oracle.make_problem(len(a), max_condition=100.0)
    found = CompiledEngine(shape, problem, sensitivity=sensitivity).loss_jacobian(theta)
    defective = not np.allclose(a, a[0, 0] * np.eye(len(a)))
    assert (found.guard_count > 0) == defective
    assert found.status is Status.OK
    # no sensitivity of an eigenvalue exceeds 100; slopes of squared errors are below 2 * 20 here, STF's are not bounded
    assert np.abs(found.gradients[:5]).max() < 100 * 40
    assert np.isfinite(found.gradients).all()


def test_no_sensitivity_no_guard():
    shape, theta = linear(np.array([[0.0, 0.0], [3.0, 0.0]]))
    assert CompiledEngine(shape, oracle.make_problem(2, terms=("sol",))).loss_jacobian(theta).guard_count == 0


def own_function(theta, trajectory, spectra):
    """`sum x^3 + sum Re^2 Im^2 + sum Re + sum sin theta`, with its slopes."""
    re, im = spectra.real, spectra.imag
    value = (trajectory**3).sum() + (re**2 * im**2 + re).sum() + np.sin(theta).sum()
    return float(value), 3 * trajectory**2, 2 * re * im**2 + 1.0 + 2j * re**2 * im, np.cos(theta)


OWN_TERM = ArrayTerm(own_function)


@pytest.mark.parametrize("sensitivity", ["adjoint", "forward"])
@pytest.mark.parametrize("terms", [("sol", "frq", "mine"), ("mine",)])
def test_user_terms(terms, sensitivity):
    shape = oracle.make_shape(4)
    problem, theta = oracle.make_problem(4, terms=terms), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, {"mine": OWN_TERM}, sensitivity)
    found = engine.loss_jacobian(theta)
    leaf = torch.from_numpy(theta.copy()).requires_grad_()
    states = oracle.rollout(shape, leaf, TSIT5, engine.steps, problem.data.initial_state, problem.data.times)
    spectra = torch.linalg.eigvals(oracle.jacobians(shape, leaf, states))
    value = (states**3).sum() + (spectra.real**2 * spectra.imag**2 + spectra.real).sum() + leaf.sin().sum()
    (gradient,) = torch.autograd.grad(value, leaf)
    np.testing.assert_allclose(found.values[-1], value.item(), rtol=1e-10)
    assert oracle.relative(found.gradients[-1], gradient.numpy()) < 1e-9
    if len(terms) == 3:
        plain = CompiledEngine(shape, oracle.make_problem(4, terms=terms[:2])).loss_jacobian(theta)
        np.testing.assert_array_equal(found.values[:2], plain.values)
        assert oracle.relative(found.gradients[:2], plain.gradients) < 1e-12


def test_user_terms_of_a_failed_solve_are_undefined():
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, terms=("frq", "mine"), solver=oracle.adaptive(max_steps=2, rtol=1e-9))

    def never(_theta, _trajectory, _spectra):
        raise AssertionError("called for a failed solve")

    found = CompiledEngine(shape, problem, {"mine": ArrayTerm(never)}).loss_jacobian(oracle.make_theta(shape))
    assert np.isnan(found.values[1])
    assert np.isnan(found.gradients[1]).all()
    assert np.isfinite(found.values[0])
    assert np.isfinite(found.gradients[0]).all()


@pytest.mark.parametrize("stabilise", [True, False])
def test_a_user_term_that_needs_no_solve_trains_on_when_it_fails(stabilise):
    shape = oracle.make_shape(2)
    failing = oracle.adaptive(max_steps=2, rtol=1e-9)
    problem = oracle.make_problem(2, terms=("frq", "mine"), solver=failing, stabilise=stabilise)

    def size(theta, trajectory, spectra):
        return float((theta**2).sum()), 0.0 * np.nan_to_num(trajectory), 0.0 * np.nan_to_num(spectra), 2.0 * theta

    theta = oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, {"mine": ArrayTerm(size, needs_solve=False)})
    found = engine.loss_jacobian(theta)
    assert found.status is not Status.OK
    if stabilise:
        assert found.values[1] == engine.evaluate(theta, np.array([0.5])).values[-1] == (theta**2).sum()
        np.testing.assert_array_equal(found.gradients[1], 2.0 * theta)
        plain = CompiledEngine(shape, oracle.make_problem(2, terms=("frq",), solver=failing)).loss_jacobian(theta)
        np.testing.assert_array_equal(found.gradients[0], plain.gradients[0])
    else:
        assert np.isnan(found.values).all()
        assert np.isnan(found.gradients).all()


def test_evaluate():
    shape = oracle.make_shape(4)
    problem, theta = oracle.make_problem(4, terms=("dmp",)), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem, {"mine": OWN_TERM})
    dense = np.linspace(0.0, 2.0, 50)
    found = engine.evaluate(theta, dense)
    wanted = CompiledEngine(shape, oracle.make_problem(4)).loss_jacobian(theta)
    compared = ~np.isnan(
        found.values[: len(oracle.NAMES)]
    )  # a term with nothing to compare is recorded empty, and trains as 0
    np.testing.assert_array_equal(found.values[: len(oracle.NAMES)][compared], wanted.values[compared])
    np.testing.assert_array_equal(wanted.values[~compared], 0.0)
    assert compared.any()
    assert found.values[len(oracle.NAMES)] == own_function(theta, wanted.trajectory, wanted.spectra)[0]
    np.testing.assert_array_equal(found.trajectory, wanted.trajectory)
    np.testing.assert_array_equal(found.spectra, wanted.spectra)
    assert (found.n_accepted, found.n_rejected) == (wanted.n_accepted, wanted.n_rejected)
    np.testing.assert_array_equal(found.dense[0], problem.data.initial_state)
    data = engine.evaluate(theta, problem.data.times).dense
    np.testing.assert_array_equal(data, found.trajectory)


@pytest.mark.parametrize("steps", [500, 0])
def test_the_initial_state_is_known_however_the_solve_ends(steps):
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, solver=oracle.adaptive(max_steps=steps))
    found = CompiledEngine(shape, problem).evaluate(oracle.make_theta(shape), np.array([0.0, 0.0, 0.5])).dense
    np.testing.assert_array_equal(found[:2], [problem.data.initial_state] * 2)
    assert np.isfinite(found[2]).all() == (steps > 0)
    alone = CompiledEngine(shape, problem).evaluate(oracle.make_theta(shape), np.array([0.0])).dense
    np.testing.assert_array_equal(alone, [problem.data.initial_state])


def test_a_jacobian_that_overflows_behind_the_last_state_is_not_seen():
    """A block has whole cache lines of states; those behind the last one lie at the origin."""
    shape = MlpShape((1, 1, 1, 1), "relu", "full", np.ones(1), np.ones(1))
    problem = oracle.make_problem(1, terms=("stb",), solved=False)
    problem = replace(problem, states=1.0 + problem.states**2)
    found = CompiledEngine(shape, problem).loss_jacobian(np.array([-1e160, 1e10, 1e160, 0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(found.gradients, 0.0)


@pytest.mark.parametrize("solver", [oracle.adaptive(rtol=1e-9, atol=1e-12), oracle.fixed(1e-3)], ids=["tsit5", "rk4"])
def test_more_steps_than_there_was_room_for(solver):
    shape = oracle.make_shape(2)
    theta = oracle.make_theta(shape)
    problem = oracle.make_problem(2, horizon=100.0, solver=solver)
    engine = CompiledEngine(shape, problem)
    found = engine.loss_jacobian(theta)
    assert found.n_accepted > FIRST_CAPACITY
    again = engine.loss_jacobian(theta)
    np.testing.assert_array_equal(found.gradients, again.gradients)
    beyond = engine.evaluate(theta, np.linspace(0.0, 200.0, 9)).dense
    np.testing.assert_allclose(beyond[4], found.trajectory[-1], rtol=1e-6, atol=1e-8)


def test_fixed_steps_have_no_sliver():
    np.testing.assert_allclose(fixed_steps(0.1, 0.0, 0.3), [0.1, 0.1, 0.1])
    np.testing.assert_allclose(fixed_steps(0.1, 1.0, 1.25), [0.1, 0.1, 0.05])
    assert fixed_steps(0.1, 0.0, 0.0).size == 0


def test_a_single_data_time():
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, count=2)
    problem = oracle.replace(
        problem, data=problem.data.leading(1), states=problem.states[:1], targets=problem.targets.rows(np.array([0]))
    )
    found = CompiledEngine(shape, problem).loss_jacobian(oracle.make_theta(shape))
    assert found.status is Status.OK
    assert found.values[0] == 0.0
    assert np.isfinite(found.gradients).all()


def test_same_bits_twice_and_from_two_threads():
    shape = oracle.make_shape(4)
    problem = oracle.make_problem(4)
    thetas = [oracle.make_theta(shape, seed) for seed in (1, 2)]
    alone = [CompiledEngine(shape, problem).loss_jacobian(theta).gradients for theta in thetas]
    together: list[list[np.ndarray]] = [[], []]

    def work(number: int) -> None:
        engine = CompiledEngine(shape, problem)
        together[number] = [engine.loss_jacobian(thetas[number]).gradients for _ in range(200)]

    threads = [threading.Thread(target=work, args=(number,)) for number in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in (0, 1):
        assert len(together[number]) == 200
        for gradients in together[number]:
            np.testing.assert_array_equal(gradients, alone[number])


def test_results_are_not_overwritten_by_the_next_call():
    shape = oracle.make_shape(2)
    engine = CompiledEngine(shape, oracle.make_problem(2))
    first = engine.loss_jacobian(oracle.make_theta(shape, 1))
    copies = first.values.copy(), first.gradients.copy(), first.trajectory.copy(), first.spectra.copy()
    engine.loss_jacobian(oracle.make_theta(shape, 2))
    for now, before in zip((first.values, first.gradients, first.trajectory, first.spectra), copies, strict=True):
        np.testing.assert_array_equal(now, before)


def test_memory_does_not_grow():
    shape = oracle.make_shape(4)
    engine = CompiledEngine(shape, oracle.make_problem(4))
    theta = oracle.make_theta(shape)

    def call(times: int) -> None:
        for _ in range(times):
            engine.loss_jacobian(theta)

    def traced() -> int:
        """Bytes that Python holds of what was allocated in our files: other threads of the process allocate too."""
        ours = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, "*/eigenode_cli/*")])
        return sum(trace.size for trace in ours.traces)

    tracemalloc.start()
    try:
        call(1000)
        before, resident = traced(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        call(3000)
        # what Python allocates and, in KiB, what kernels do: results of 4 kB, retained at each call, would be 12 MB;
        # Numba's own small objects come to 180 kB and stay there
        assert traced() - before < 200_000
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident < 2000
    finally:
        tracemalloc.stop()


def test_compile_time_is_reported():
    shape = oracle.make_shape(2)
    engine = CompiledEngine(shape, oracle.make_problem(2))
    assert engine.compile_seconds == 0.0
    engine.loss_jacobian(oracle.make_theta(shape))
    first = engine.compile_seconds
    assert first > 0.0
    engine.loss_jacobian(oracle.make_theta(shape))
    assert engine.compile_seconds == first


def test_mistakes_are_named():
    shape, problem = oracle.make_shape(2), oracle.make_problem(2)
    with pytest.raises(ValueError, match="mine"):
        CompiledEngine(shape, oracle.make_problem(2, terms=("sol", "mine")))
    with pytest.raises(ValueError, match="auto, adjoint, forward"):
        CompiledEngine(shape, problem, sensitivity="backward")
    with pytest.raises(ValueError, match="4 states"):
        CompiledEngine(shape, oracle.make_problem(4))
    with pytest.raises(ValueError, match="knows tsit5, dopri5, "):
        CompiledEngine(shape, oracle.make_problem(2, solver=oracle.adaptive("euler")))
    with pytest.raises(ValueError, match="FixedStepSolver"):
        CompiledEngine(shape, oracle.make_problem(2, solver=oracle.FixedStepSolver(name="tsit5", step=0.1)))
    engine = CompiledEngine(shape, problem)
    with pytest.raises(ValueError, match="21 parameters"):
        engine.loss_jacobian(np.zeros(3))
    with pytest.raises(ValueError, match="horizon of 1"):
        engine.loss_jacobian(np.zeros(21), np.array([0.5, 0.4]))
    with pytest.raises(ValueError, match="positive"):
        engine.loss_jacobian(np.zeros(21), np.array([1.5, -0.5]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sizes": (2,)}, "input and an output"),
        ({"activation": "step"}, "choose from tanh"),
        ({"structure": "third_order"}, "choose from second_order, full"),
        ({"structure": "full"}, "2 states and 1 outputs"),
        ({"input_scale": np.ones(3)}, r"\(2,\)"),
    ],
)
def test_shapes_that_do_not_fit(change, message):
    with pytest.raises(ValueError, match=message):
        oracle.replace(oracle.make_shape(2), **change)
