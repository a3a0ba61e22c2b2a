"""Many training steps in one kernel call against the same steps one by one."""

import numpy as np
import pytest

from eigenode_cli.engines.base import single_step
from eigenode_cli.engines.combine import SEQUENTIAL
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update
from eigenode_cli.solve.status import Status
from eigenode_cli.training.methods import Adam
from eigenode_cli.training.optimizers import Optimizer, build_update
from tests.engines.compiled import oracle

RATES = np.linspace(1e-2, 1e-3, 12)
ADAM = Adam(lr=1e-2)


def update_for(problem: Problem, parameters: int) -> Update:
    return build_update(SEQUENTIAL, np.linspace(1.0, 0.1, len(problem.terms)), Optimizer(ADAM, parameters))


def one_by_one(engine: CompiledEngine, theta: np.ndarray, update: Update, rates: np.ndarray, halt: bool) -> np.ndarray:
    """Values of every step."""
    return np.concatenate(
        [single_step(engine, theta, update, rates[k : k + 1], halt).values for k in range(rates.size)]
    )


@pytest.mark.parametrize("n", [2, 4])
def test_the_same_bytes_as_steps_one_by_one(n: int) -> None:
    shape, problem = oracle.make_shape(n), oracle.make_problem(n)
    together, apart = oracle.make_theta(shape), oracle.make_theta(shape)
    taken = CompiledEngine(shape, problem).advance(together, update_for(problem, together.size), RATES, False)
    values = one_by_one(CompiledEngine(shape, problem), apart, update_for(problem, apart.size), RATES, False)
    assert together.tobytes() == apart.tobytes() != oracle.make_theta(shape).tobytes()
    assert taken.values.tobytes() == values.tobytes()
    assert (taken.statuses == Status.OK).all()


def test_it_makes_room_in_between() -> None:
    """More steps than the room that is there at first."""
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, solver=oracle.adaptive(rtol=1e-11, atol=1e-12, max_steps=100_000), horizon=20.0)
    together, apart = oracle.make_theta(shape), oracle.make_theta(shape)
    engine = CompiledEngine(shape, problem)
    engine.advance(together, update_for(problem, together.size), RATES[:3], False)
    one_by_one(CompiledEngine(shape, problem), apart, update_for(problem, apart.size), RATES[:3], False)
    assert engine.steps.size > 256
    assert together.tobytes() == apart.tobytes()


def test_it_halts_behind_a_failed_solve_and_leaves_the_parameters() -> None:
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, solver=oracle.adaptive(max_steps=2, rtol=1e-9))
    theta = oracle.make_theta(shape)
    taken = CompiledEngine(shape, problem).advance(theta, update_for(problem, theta.size), RATES, True)
    assert taken.statuses.tolist() == [Status.MAX_STEPS]
    assert taken.values.shape == (1, len(oracle.NAMES))
    assert theta.tobytes() == oracle.make_theta(shape).tobytes()


def test_without_halt_failed_solves_stabilise() -> None:
    shape = oracle.make_shape(2)
    problem = oracle.make_problem(2, solver=oracle.adaptive(max_steps=2, rtol=1e-9))
    together, apart = oracle.make_theta(shape), oracle.make_theta(shape)
    taken = CompiledEngine(shape, problem).advance(together, update_for(problem, together.size), RATES, False)
    one_by_one(CompiledEngine(shape, problem), apart, update_for(problem, apart.size), RATES, False)
    assert (taken.statuses == Status.MAX_STEPS).all()
    assert taken.statuses.size == RATES.size
    assert together.tobytes() == apart.tobytes() != oracle.make_theta(shape).tobytes()
