"""Several trajectories in one loss Jacobian: means over all residuals, each trajectory with its own initial state."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.several import SeveralEngine
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.user import UserTerm
from tests.engines.test_residuals import field_of, problem_of

ENGINES = ("compiled", "torch")


def together() -> tuple[VectorField, Problem, Floats]:
    """Two trajectories of different lengths, the second with an unknown initial value."""
    field, first = field_of(2, "second_order", True), problem_of(2, False)
    second = problem_of(2, True).until(0.7)
    problem = replace(first, others=(second,))
    return field, problem, np.concatenate([flat_parameters(field), np.full(second.data.unknown.size, 0.4)])


def single(field: VectorField, problem: Problem, engine: str, theta: Floats) -> list[tuple[Engine, Floats]]:
    size = flat_parameters(field).size
    return [
        (build_engine(field, one, engine=engine), theta[: size + one.data.unknown.size]) for one in problem.trajectories
    ]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_term_is_the_mean_over_all_residuals(engine: str) -> None:
    field, problem, theta = together()
    both = build_engine(field, problem, engine=engine)
    assert isinstance(both, SeveralEngine)
    found = both.residual_jacobian(theta)
    for term, rows in found.rows.items():
        parts = [one.residual_jacobian(own) for one, own in single(field, problem, engine, theta)]
        expected = np.concatenate([part.residuals[part.rows[term]] for part in parts])
        np.testing.assert_allclose(found.residuals[rows], expected, rtol=1e-12)
    jacobian = both.loss_jacobian(theta)
    for row, term in enumerate(NAMES):
        part = found.rows[term]
        count = part.stop - part.start
        np.testing.assert_allclose(jacobian.values[row], (found.residuals[part] ** 2).sum() / count, rtol=1e-8)
        slope = 2.0 * found.jacobian[part].T @ found.residuals[part] / count
        np.testing.assert_allclose(jacobian.gradients[row], slope, rtol=1e-7, atol=1e-9 * np.abs(slope).max())
    recorded = both.evaluate(theta, np.array([0.0])).values
    defined = np.isfinite(recorded)
    np.testing.assert_allclose(recorded[defined], jacobian.values[defined], rtol=1e-12)
    assert (jacobian.values[~defined] == 0.0).all()  # a term that has nothing to compare


def test_both_engines_agree() -> None:
    field, problem, theta = together()
    one, other = (build_engine(field, problem, engine=name).loss_jacobian(theta) for name in ENGINES)
    scale = np.abs(other.gradients).max(axis=1, keepdims=True) + 1e-12
    np.testing.assert_allclose(one.gradients / scale, other.gradients / scale, atol=1e-5)  # steps are not frozen


def test_gradient_is_that_of_central_differences() -> None:
    field, problem, theta = together()
    tight = en.AdaptiveSolver(rtol=1e-11, atol=1e-12)
    both = build_engine(field, problem.changed(solver=tight))
    gradient = both.loss_jacobian(theta).gradients
    for column in (0, 5, theta.size - 1):
        shift = np.zeros(theta.size)
        shift[column] = 1e-6
        change = both.loss_jacobian(theta + shift).values - both.loss_jacobian(theta - shift).values
        np.testing.assert_allclose(gradient[:, column], change / 2e-6, rtol=1e-5, atol=1e-7)


def test_one_solve_that_fails_leaves_sol_undefined() -> None:
    field, problem, theta = together()
    short = en.AdaptiveSolver(max_steps=1)
    second = replace(problem.others[0], solver=short)
    found = build_engine(field, replace(problem, others=(second,))).loss_jacobian(theta)
    assert found.status is Status.MAX_STEPS
    assert np.isnan(found.values[0])


def test_a_fit_of_two_trajectories_serves_both() -> None:
    system = en.VanDerPol()
    times = np.linspace(0.0, 6.0, 31)
    starts = ((2.0, 0.0), (0.3, 0.0))
    series = [en.simulate(en.Truth(system, start), times, ["nu"]).series[0] for start in starts]
    data = en.Dataset(series, ["nu", "nudot"])
    found = en.fit(seeded(), data, en.StatedTarget())
    assert found.ending.status == "finished"
    for start in starts:
        error = np.abs(found.simulate(times, start)[:, 0] - en.Truth(system, start).states(times)[:, 0])
        assert error.max() < 0.05


def test_a_series_alone_and_in_a_dataset_train_the_same() -> None:
    data = en.simulate(en.Truth(en.Oscillator(), (1.0, 0.0)), np.linspace(0.0, 3.0, 16), ["s"])
    assert isinstance(data.series[0], Series)
    fits = [en.fit(seeded(), one, en.StatedTarget(), steps=10, stages=[en.Stage()]) for one in (data, data.series[0])]
    assert fits[0].theta.tobytes() == fits[1].theta.tobytes()


def seeded() -> VectorField:
    return en.VectorField(en.Mlp(2, [8], 1, generator=torch.Generator().manual_seed(0)))


def test_threads_change_no_bit() -> None:
    """Each of two threads takes a share of the trajectories; one thread gives the same bytes."""
    field, problem, theta = together()
    third = problem_of(2, False).until(0.5)
    problem = replace(problem, others=(*problem.others, third))
    engine = build_engine(field, problem)
    assert isinstance(engine, SeveralEngine)
    found = {}
    for threads in (1, 2, 3):
        engine.threads = threads
        jacobian, residuals = engine.loss_jacobian(theta), engine.residual_jacobian(theta)
        values = engine.evaluate(theta, np.array([0.0])).values
        found[threads] = [part.tobytes() for part in (jacobian.gradients, residuals.jacobian, values)]
    assert found[1] == found[2] == found[3]


def test_own_terms_stay_in_one_thread() -> None:
    """They run in torch on a field that all trajectories share."""
    field, problem, _ = together()
    term = UserTerm(lambda trajectory: (trajectory**2).mean(), ("trajectory",))
    engine = build_engine(field, problem, {"calm": term})
    assert isinstance(engine, SeveralEngine)
    assert engine.threads == 1
