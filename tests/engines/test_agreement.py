"""Two engines, one meaning: values and gradients agree at frozen steps, and at tight tolerance."""

import numpy as np
import pytest
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import build_field
from eigenode_cli.config.schema import MlpConfig
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import targets_of_spectra
from eigenode_cli.engines.base import LossJacobian
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.solve.status import Status
from eigenode_cli.terms.peers import derivative_matching, jacobian_norm
from eigenode_cli.terms.user import UserTerm, on_arrays, user_term
from tests.conftest import Case, make_case, solver
from tests.measured import series

TIGHT = solver(rtol=1e-11, atol=1e-12, max_steps=100_000)


def trained(field: VectorField, problem: Problem, steps: int = 300) -> Floats:
    """Weights after some training, so that eigenvalues stand where training brings them."""
    engine = CompiledEngine(shape_of(field), problem)
    theta = flat_parameters(field)
    for _ in range(steps):
        gradient = np.nan_to_num(engine.loss_jacobian(theta).gradients).sum(axis=0)
        theta -= 5e-3 * gradient / (np.linalg.norm(gradient) + 1e-12) * np.sqrt(theta.size) * 0.2
    return theta


def assert_same(ours: LossJacobian, reference: LossJacobian, relative: float) -> None:
    assert ours.status == reference.status
    np.testing.assert_allclose(ours.values, reference.values, rtol=relative, atol=1e-13)
    scale = np.linalg.norm(reference.gradients, axis=1, keepdims=True)
    assert (np.abs(ours.gradients - reference.gradients) <= relative * np.maximum(scale, 1e-8)).all()
    near_zero = 0.01 * np.abs(reference.trajectory).max(axis=0)  # of each state: there a relative error says nothing
    bound = relative * (np.abs(reference.trajectory) + near_zero)
    assert (np.abs(ours.trajectory - reference.trajectory) <= bound).all()
    order = [np.lexsort((s.imag, s.real)) for s in ours.spectra.round(9)]
    theirs = [np.lexsort((s.imag, s.real)) for s in reference.spectra.round(9)]
    for a, b, i, j in zip(ours.spectra, reference.spectra, order, theirs, strict=True):
        np.testing.assert_allclose(a[i], b[j], rtol=1e-7, atol=1e-8)


def compare_frozen(field: VectorField, problem: Problem, theta: Floats) -> None:
    compiled = CompiledEngine(shape_of(field), problem)
    adaptive = compiled.loss_jacobian(theta)
    steps = compiled.steps
    reference = TorchEngine(field, problem, {}).loss_jacobian(theta, steps.tolist())
    assert_same(compiled.loss_jacobian(theta, steps), reference, 1e-9)
    assert adaptive.n_accepted == steps.size


@pytest.mark.parametrize("hidden", [[32], [16, 8], [8, 7, 6]], ids=str)
@pytest.mark.parametrize("weights", ["random", "trained"])
def test_all_terms_at_frozen_steps(case: Case, hidden: list[int], weights: str) -> None:
    field, problem = case.field(seed=4, hidden=hidden), case.problem()
    theta = trained(field, problem) if weights == "trained" else flat_parameters(field)
    compare_frozen(field, problem, theta)


def many_states(n: int, hidden: list[int]) -> tuple[VectorField, Problem]:
    """A field of n states with the trajectory of another random field as data, and targets with pairs and reals."""
    case = make_case("oscillator")
    generator = np.random.default_rng(n)
    times = np.linspace(0.0, 2.0, 21)
    start = generator.normal(size=n)
    states = start * np.cos(np.outer(times, 1.0 + generator.random(n)))
    data = series(times, states)
    spectra = np.linalg.eigvals(generator.normal(size=(21, n, n)))
    problem = case.problem(data=data, states=states, targets=targets_of_spectra(spectra))
    config = MlpConfig(
        name="mlp",
        target="eigenode_cli.model:Mlp",
        structure="second_order",
        hidden=hidden,
        activation="tanh",
        init="kaiming",
        input_scaling="max_abs",
        output_scaling="none",
        linear="none",
        output_gain=1.0,
        scaling_from="data",
    )
    return build_field(config, states, states, seed=n), problem


@pytest.mark.parametrize("n", [4, 10])
@pytest.mark.parametrize("hidden", [[12], [14, 11], [12, 10, 11]], ids=str)
@pytest.mark.parametrize("weights", ["random", "trained"])
def test_more_states_at_frozen_steps(n: int, hidden: list[int], weights: str) -> None:
    field, problem = many_states(n, hidden)
    theta = trained(field, problem, 50) if weights == "trained" else flat_parameters(field)
    compare_frozen(field, problem, theta)


@pytest.mark.parametrize(
    "config",
    [
        AdaptiveSolver(name="dopri5", rtol=1e-4, atol=1e-6, max_steps=10_000),
        FixedStepSolver(name="rk4", step=0.03),
    ],
    ids=["dopri5", "rk4"],
)
def test_other_solvers(case: Case, config: Solver) -> None:
    field, problem = case.field(seed=2), case.problem(solver=config)
    theta = flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    assert_same(compiled, TorchEngine(field, problem, {}).loss_jacobian(theta), 1e-8)


def test_adaptive_at_tight_tolerance(case: Case) -> None:
    field, problem = case.field(seed=5), case.problem(solver=TIGHT)
    theta = flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    assert_same(compiled, TorchEngine(field, problem, {}).loss_jacobian(theta), 1e-7)


def test_both_take_the_same_steps(case: Case) -> None:
    """One controller, one initial step, one error norm: not only the results agree."""
    field, problem = case.field(seed=6), case.problem()
    theta = flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    reference = TorchEngine(field, problem, {}).loss_jacobian(theta)
    assert (compiled.n_accepted, compiled.n_rejected) == (reference.n_accepted, reference.n_rejected)
    assert_same(compiled, reference, 1e-8)


def test_failed_solve_stabilises_alike() -> None:
    """A linear field that overflows: both keep the spectral terms, on the same states, held constant."""
    case = make_case("oscillator")
    field = case.field(seed=1, activation="identity")
    theta = flat_parameters(field) * 30.0
    problem = case.problem(solver=solver(max_steps=60))
    compiled = CompiledEngine(shape_of(field), problem).loss_jacobian(theta)
    reference = TorchEngine(field, problem, {}).loss_jacobian(theta)
    assert compiled.status == reference.status != 0
    np.testing.assert_allclose(compiled.values, reference.values, rtol=1e-9)
    np.testing.assert_allclose(compiled.gradients[1:], reference.gradients[1:], rtol=1e-8, atol=1e-10)
    assert np.isnan(compiled.values[0])
    assert np.isfinite(compiled.values[1:]).all()


def test_solution_alone_takes_no_spectra(case: Case) -> None:
    field, problem = case.field(seed=8), case.problem(terms=("sol",))
    theta = flat_parameters(field)
    compiled = CompiledEngine(shape_of(field), problem)
    ours = compiled.loss_jacobian(theta)
    reference = TorchEngine(field, problem, {}).loss_jacobian(theta, compiled.steps.tolist())
    assert_same(ours, reference, 1e-9)
    assert np.isnan(ours.spectra).all()
    assert ours.guard_count == reference.guard_count == 0
    everything = CompiledEngine(shape_of(field), case.problem()).loss_jacobian(theta)
    assert ours.values[0] == everything.values[0]
    np.testing.assert_allclose(ours.gradients[0], everything.gradients[0], rtol=1e-12)


def test_users_own_terms() -> None:
    case = make_case("vdp")

    def own(trajectory: torch.Tensor, spectra: torch.Tensor, times: torch.Tensor) -> torch.Tensor:
        return (trajectory**2).mean() + (spectra.abs() ** 2).mean() + times.mean()

    field, problem = case.field(seed=3), case.problem(terms=("sol", "frq", "own"))
    theta = flat_parameters(field)
    compiled, torch_engine = engines(field, problem, {"own": user_term(own)})
    ours = compiled.loss_jacobian(theta)
    reference = torch_engine.loss_jacobian(theta, compiled.steps.tolist())
    np.testing.assert_allclose(ours.values, reference.values, rtol=1e-9)
    np.testing.assert_allclose(ours.gradients, reference.gradients, rtol=1e-7, atol=1e-9)


def engines(field: VectorField, problem: Problem, terms: dict[str, UserTerm]) -> tuple[CompiledEngine, TorchEngine]:
    """Both engines for the same user's terms."""
    data = problem.data
    own = {name: on_arrays(term, data.times, data.seen, field) for name, term in terms.items()}
    return CompiledEngine(shape_of(field), problem, own), TorchEngine(field, problem, terms)


PEERS = {"jac": user_term(jacobian_norm), "match": user_term(derivative_matching)}


@pytest.mark.parametrize("system", ["oscillator", "vdp"])
@pytest.mark.parametrize("structure", ["second_order", "full"])
def test_terms_that_see_the_field(system: str, structure: str) -> None:
    case = make_case(system)
    data = case.problem().data
    whole = series(data.times, case.truth.states(data.times))
    field = case.field(seed=7, structure=structure)
    problem = case.problem(terms=("sol", "dmp", "jac", "match"), data=data if structure == "second_order" else whole)
    theta = flat_parameters(field)
    compiled, torch_engine = engines(field, problem, PEERS)
    ours = compiled.loss_jacobian(theta)
    reference = torch_engine.loss_jacobian(theta, compiled.steps.tolist())
    assert_same(ours, reference, 1e-9)
    times = np.linspace(0.0, 1.0, 5)
    ours_recorded, reference_recorded = compiled.evaluate(theta, times), torch_engine.evaluate(theta, times)
    np.testing.assert_allclose(ours_recorded.values, reference_recorded.values, rtol=1e-6)  # steps of its own


def test_central_differences_of_terms_that_see_the_field() -> None:
    case = make_case("oscillator")
    field = case.field(seed=2)
    compiled, _ = engines(field, case.problem(terms=("jac", "match")), PEERS)
    theta = flat_parameters(field)
    gradients, steps = compiled.loss_jacobian(theta).gradients, compiled.steps
    for seed in range(4):
        direction = np.random.default_rng(seed).normal(size=theta.size)
        near, far = (
            compiled.loss_jacobian(theta + k * 2e-5 * direction, steps).values
            - compiled.loss_jacobian(theta - k * 2e-5 * direction, steps).values
            for k in (1, 2)
        )
        np.testing.assert_allclose((8 * near - far) / (12 * 2e-5), gradients @ direction, rtol=1e-6, atol=1e-8)


def test_a_term_without_the_solution_outlives_a_failed_solve_alike() -> None:
    case = make_case("oscillator")
    field = case.field(seed=1, activation="identity")
    theta = flat_parameters(field) * 30.0
    problem = case.problem(solver=solver(max_steps=60), terms=("sol", "stb", "jac", "match"))
    compiled, torch_engine = engines(field, problem, PEERS)
    ours, reference = compiled.loss_jacobian(theta), torch_engine.loss_jacobian(theta)
    assert ours.status == reference.status != 0
    np.testing.assert_allclose(ours.values, reference.values, rtol=1e-9)
    np.testing.assert_allclose(ours.gradients[[1, 3]], reference.gradients[[1, 3]], rtol=1e-8, atol=1e-10)
    assert np.isnan(ours.values).tolist() == [True, False, True, False]
    assert np.isnan(ours.gradients).all(axis=1).tolist() == [True, False, True, False]


def at_times(times: object, config: Solver) -> tuple[LossJacobian, LossJacobian]:
    """Loss Jacobians of both engines where the data have other times."""
    case = make_case("oscillator")
    data = case.problem().data
    count = np.size(times)
    whole = case.problem()
    shown = Series(times, data.values[:count], data.initial_state)  # type: ignore[arg-type]
    states = whole.states[:count]  # type: ignore[index]
    targets = whole.targets.rows(np.arange(count))
    problem = case.problem(data=shown, states=states, targets=targets, solver=config)
    field = case.field(seed=3)
    theta = flat_parameters(field)
    return (
        CompiledEngine(shape_of(field), problem).loss_jacobian(theta),
        TorchEngine(field, problem, {}).loss_jacobian(theta),
    )


METHODS = [solver(), FixedStepSolver(name="rk4", step=0.03)]


@pytest.mark.parametrize("config", METHODS, ids=["adaptive", "fixed"])
@pytest.mark.parametrize("times", [[0.0, 0.0, 0.1, 0.1, 0.2], [0, 1, 2], [0.0, 3e-12]], ids=["twice", "whole", "short"])
def test_unusual_times(times: list[float], config: Solver) -> None:
    """Times that repeat, whole numbers, and a horizon of less than a billionth of the step."""
    ours, reference = at_times(np.array(times), config)
    assert ours.status is Status.OK
    assert np.isfinite(ours.trajectory).all()
    assert_same(ours, reference, 1e-8)


@pytest.mark.parametrize("engine", ["compiled", "torch"])
def test_evaluation_starts_with_the_data(engine: str) -> None:
    case = make_case("oscillator")
    field, problem = case.field(), case.problem()
    theta = flat_parameters(field)
    tested = CompiledEngine(shape_of(field), problem) if engine == "compiled" else TorchEngine(field, problem, {})
    dense = tested.evaluate(theta, np.array([0, 0, 1, 2])).dense
    np.testing.assert_array_equal(dense[[0, 1]], [problem.data.initial_state] * 2)
    np.testing.assert_array_equal(tested.evaluate(theta, np.array([1.0, 2.0])).dense, dense[2:])
    for times in ([0.0, 2.0, 1.0], [0.0, np.nan], [-1.0, 1.0]):
        with pytest.raises(ValueError, match="times"):
            tested.evaluate(theta, np.array(times))


def test_data_have_times_that_ascend() -> None:
    for times in ([0.0, 2.0, 1.0], [0.0, np.nan, 1.0]):
        with pytest.raises(ValueError, match=r"times\["):
            series(np.array(times), np.zeros((3, 2)))
