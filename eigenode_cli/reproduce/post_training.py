"""What is measured of a trained model besides its own records.

The time of several gradients, the test from another state, the error at a tight tolerance.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.batch.outcome import DENSE
from eigenode_cli.config.build import build_target
from eigenode_cli.config.setup import Setup, build, engine_of
from eigenode_cli.data.simulate import Truth, simulate
from eigenode_cli.data.source import simulated_source
from eigenode_cli.engines.base import unheard
from eigenode_cli.reproduce.measures import COST_FILE, TEST_FILE, TIGHT_FILE
from eigenode_cli.reproduce.planned_runs import Unit
from eigenode_cli.runs.atomic import write_json
from eigenode_cli.runs.recorder import load_last
from eigenode_cli.solve.settings import AdaptiveSolver
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import NAMES
from eigenode_cli.training.options import BEST

ROUNDS = 15
"""Times that a measurement is repeated; the fastest counts, the others were disturbed."""
SECONDS = 0.02
"""Least duration of what is timed at once."""
TIGHT = {"rtol": 1e-7, "atol": 1e-9}
"""Tolerances at which the learned field's own solution shows: one that was fitted together with the errors of a loose
solver is wrong here."""


def _trained(unit: Unit) -> tuple[Setup, Floats]:
    """Return the parts of a finished unit and the parameters that it keeps."""
    setup = build(unit.config, unheard)
    saved = load_last(unit.folder)
    if saved is None:
        raise ValueError(f"{unit.folder}: no parameters were saved")
    kept = saved.best if unit.config.trainer.keep == BEST else None
    return setup, saved.theta if kept is None else kept


def fastest(*calls: Callable[[], Any]) -> list[float]:
    """Least time in s of one call of each, measured in turns."""
    repeats = []
    for call in calls:
        call()  # compiles or loads what it needs
        start = perf_counter()
        call()
        repeats.append(max(1, int(SECONDS / max(perf_counter() - start, 1e-9))))
    best = [float("inf")] * len(calls)
    for _ in range(ROUNDS):
        for i, (call, count) in enumerate(zip(calls, repeats, strict=True)):
            start = perf_counter()
            for _ in range(count):
                call()
            best[i] = min(best[i], (perf_counter() - start) / count)
    return best


def measure_gradient_cost(unit: Unit) -> None:
    """Write the time of the unit's loss Jacobian beside that of the gradient of SOL alone, in s."""
    if (unit.folder / COST_FILE).is_file():
        return
    several, theta = _trained(unit)
    one = build(replace(unit.config, grads="sol"), unheard)
    times = fastest(lambda: one.engine.loss_jacobian(theta), lambda: several.engine.loss_jacobian(theta))
    content = {"sol_seconds": times[0], "all_seconds": times[1], "ratio": times[1] / times[0]}
    write_json(unit.folder / COST_FILE, content)


def measure_test(unit: Unit) -> None:
    """Write SOL from the state at the last data point over one more horizon, and times and steps of the model.

    The field is the trained one, with the scales that its own data gave it; only data and targets are others.
    """
    if (unit.folder / TEST_FILE).is_file():
        return
    setup, theta = _trained(unit)
    times = setup.problem.data.times
    later = Truth(setup.truth.system, tuple(setup.truth.states(times)[-1].tolist()))
    seen = np.asarray(setup.problem.data.mask.any(axis=0)).tolist()
    observed = [state.name for state, one in zip(setup.source.states, seen, strict=True) if one]
    source = simulated_source(later, simulate(later, times, observed))
    data = source.dataset.series[0]
    targets = build_target(unit.config.target, source).rows(times).rows(setup.problem.spectral_index)
    changes = {"data": data, "targets": targets, "resting": None, "states": None, "stabilise": False}
    problem = replace(setup.problem, terms=("sol",), **changes)
    evaluation = engine_of(unit.config, setup.field, problem).evaluate(theta, data.times)
    trained = setup.engine.evaluate(theta, times)
    start = times[:1]
    simulation, gradient = fastest(
        lambda: setup.engine.evaluate(theta, start), lambda: setup.engine.loss_jacobian(theta)
    )
    content = {
        "test_sol": float(evaluation.values[NAMES.index("sol")]) if evaluation.status is Status.OK else np.nan,
        "simulation_seconds": simulation,
        "gradient_seconds": gradient,
        "accepted": trained.n_accepted,
        "rejected": trained.n_rejected,
    }
    write_json(unit.folder / TEST_FILE, content)


def measure_tight(unit: Unit) -> None:
    """Write the dense error of the trained field when its solver has tight tolerances."""
    if (unit.folder / TIGHT_FILE).is_file():
        return
    setup, theta = _trained(unit)
    solver = setup.problem.solver
    if isinstance(solver, AdaptiveSolver):
        solver = replace(solver, **TIGHT)
    engine = engine_of(unit.config, setup.field, replace(setup.problem, solver=solver))
    times = np.linspace(0.0, setup.source.horizon, DENSE)
    error = np.abs(engine.evaluate(theta, times).dense[:, 0] - setup.truth.states(times)[:, 0])
    write_json(unit.folder / TIGHT_FILE, {"dense_error": float(np.mean(error))})
