"""A training in memory, for scripts and notebooks: no folder, no printing, no settings of the process."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import nn

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.console import QuietDisplay
from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct
from eigenode_cli.data.targets import Target
from eigenode_cli.engines.base import Engine, Evaluation
from eigenode_cli.engines.combine import COMBINATIONS
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, block_slices, flat_parameters, load_flat, scale_output, with_own_parameters
from eigenode_cli.model.modes import modal_matrix, stated_pairs
from eigenode_cli.solve.settings import AdaptiveSolver, Solver
from eigenode_cli.terms import NAMES, PAPER_TERMS, canonical
from eigenode_cli.terms.errors import MSE
from eigenode_cli.training.ending import Ending
from eigenode_cli.training.least_squares import relative_scales
from eigenode_cli.training.methods import LevenbergMarquardt, Method, OwnMethod
from eigenode_cli.training.optimizers import build_optimizer
from eigenode_cli.training.options import TrainerOptions
from eigenode_cli.training.progress import Progress, Snapshot
from eigenode_cli.training.schedules import Schedule
from eigenode_cli.training.stages import Stage, build_phases
from eigenode_cli.training.trainer import Trainer

SMOOTH = AdaptiveSolver(rtol=1e-6, atol=1e-7)
"""Solver whose noise lies below what least squares compares."""
GROWING = (Stage(steps=190, horizons=tuple(k / 20 for k in range(1, 20))), Stage())
"""Stages of `protocol=robust`: the horizon grows by twentieths."""


@dataclass(frozen=True)
class Fit:
    """A trained model.

    Attributes:
        field: the vector field with the trained parameters.
        theta: all trained parameters `(P,)`.
        problem: what it was trained on.
        metrics: one row a record: step, all six terms, largest real part in 1/s.
        ending: status of the training, and why where it is not `finished`.
    """

    field: VectorField
    theta: Floats
    problem: Problem
    metrics: pd.DataFrame
    ending: Ending
    _engine: Engine

    def simulate(self, times: Floats, initial_state: Floats | None = None) -> Floats:
        """Return the model's states `(D, n)` at `times (D,)` in s, from its own initial state or another one.

        NaN where the solve did not arrive.
        """
        if initial_state is None:
            return self._engine.evaluate(self.theta, times).dense
        start = np.asarray(initial_state, dtype=np.float64)
        series = Series(self.problem.data.times[:1], start[None], start)
        problem = Problem(series, self.problem.targets.rows(np.array([0])), terms=NAMES[:1], solver=self.problem.solver)
        return build_engine(self.field, problem).evaluate(flat_parameters(self.field), times).dense

    def spectra(self) -> Complexes:
        """Return the eigenvalues in 1/s at the data times along the model's trajectory `(T, n)`."""
        return self._engine.evaluate(self.theta, self.problem.data.times[:1]).spectra


class _Memory:
    """Keeps records in memory."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def describe(
        self, progress: Progress, lr: float, evaluation: Evaluation, monitored: Mapping[str, float]
    ) -> dict[str, Any]:
        """See `training.trainer.Recorder.describe`."""
        row = {
            "step": progress.step,
            "lr": lr,
            **dict(zip(PAPER_TERMS, evaluation.values.tolist(), strict=False)),
            "max_real": evaluation.max_real,
            "status": evaluation.status.label,
            **monitored,
        }
        return row | {"dense_error": float("nan")}

    def record(self, row: dict[str, Any]) -> None:
        """See `training.trainer.Recorder.record`."""
        self.rows.append({name: value for name, value in row.items() if name not in ("dense_error", "test_error")})

    def checkpoint(self, step: int, network: dict[str, Any]) -> Path:
        """See `training.trainer.Recorder.checkpoint`; there is none."""
        del network
        return Path(f"step-{step:06d}")

    def save_last(self, snapshot: Snapshot, network: dict[str, Any]) -> None:
        """See `training.trainer.Recorder.save_last`; nothing is kept."""


def fit(
    field: VectorField,
    data: Dataset | Series,
    target: Target,
    terms: Sequence[str] = ("sol",),
    scales: Mapping[str, float] | None = None,
    method: Method | OwnMethod | None = None,
    schedule: Schedule | None = None,
    stages: Sequence[Stage] = GROWING,
    steps: int = 250,
    solver: Solver = SMOOTH,
    record_every: int = 25,
    engine: str = "auto",
    at: str = "trajectory",
) -> Fit:
    """Train a vector field in place and return what came out.

    Args:
        field: with its initial parameters.
        data: the measurements; all trajectories train together, each from its own initial state.
        target: what the spectral terms compare with.
        terms: names of those that train, some of sol, frq, dmp, stb, osc, stf.
        scales: factor of each term by name, 1 where none is given; with least squares relative to the term's unit.
        method, schedule: of the optimizer; Levenberg-Marquardt, and a constant rate, by default.
        stages: of the training.
        steps, record_every: training steps in all, and between rows of the metrics; solver: of the vector field.
        engine: compiled | torch | auto; at: where the target holds, trajectory | equilibrium.

    Raises:
        ValueError: a term, a stage or an engine does not exist or does not fit.
    """
    every = _trajectories(data)
    method = LevenbergMarquardt(ridge=1e-8, evidence=True) if method is None else method
    estimates = [reconstruct(series, field.structure) for series in every]
    problem = _problem(every, estimates, target, terms, solver, at)
    factors: dict[str, float] = dict.fromkeys(NAMES, 1.0) | dict(scales or {})
    if isinstance(method, LevenbergMarquardt):
        factors = relative_scales(factors, problem)
    theta = with_own_parameters(flat_parameters(field), every, estimates)
    memory, whole = _Memory(), build_engine(field, problem, engine=engine)
    rebuilt = partial(build_engine, field, engine=engine)
    blocks = block_slices(field, every)
    trainer = Trainer(
        engine=whole,
        phases=build_phases(stages, steps, problem, factors, whole, rebuilt, blocks),
        optimizer=build_optimizer(method, theta.size, blocks["network"].stop, schedule or Schedule()),
        combination=COMBINATIONS["sequential"],
        terms=problem.terms,
        weights=np.array([factors[name] if name in problem.terms else 0.0 for name in NAMES]),
        options=TrainerOptions(steps, record_every, checkpoint_every=steps),
        recorder=memory,
        display=QuietDisplay(),
        dense_times=every[0].times,
        theta=theta,
        network=lambda _theta: {},
        progress=Progress(),
    )
    trainer.run()
    load_flat(field, theta)
    return Fit(field, theta, problem, pd.DataFrame(memory.rows), trainer.ending, whole)


def _trajectories(data: Dataset | Series) -> tuple[Series, ...]:
    return (data,) if isinstance(data, Series) else data.series


def _problem(
    every: Sequence[Series],
    estimates: Sequence[Estimate],
    target: Target,
    terms: Sequence[str],
    solver: Solver,
    at: str,
) -> Problem:
    """Return the problem of a fit, whose terms are squares."""
    if unknown := [term for term in terms if term not in NAMES]:
        raise ValueError(f"{', '.join(unknown)}: choose from {', '.join(NAMES)}")
    if at not in ("trajectory", "equilibrium"):
        raise ValueError(f"at={at}: choose from trajectory, equilibrium")
    problems = []
    for series, estimate in zip(every, estimates, strict=True):
        states = estimate.states if estimate.complete else None
        problems.append(
            Problem(
                data=series,
                targets=target.rows(series.times),
                resting=target.resting(series.times)[1] if at == "equilibrium" else None,
                terms=canonical(terms),
                states=states,
                errors=np.full(len(NAMES), MSE),
                solver=solver,
                stabilise=states is not None,
            )
        )
    return replace(problems[0], others=tuple(problems[1:]))


def modal_field(
    network: nn.Module,
    data: Dataset | Series,
    target: Target,
    structure: str = "second_order",
    output_gain: float = 0.1,
) -> VectorField:
    """Return a field whose linear part starts with the modes that the target states all along, beside a network.

    Args:
        network: maps states to outputs; its last layer is multiplied by `output_gain`.
        data: shapes of several modes come from these measurements, of a dataset from its first trajectory.
        target: states the modes.
        structure: of the vector field.
        output_gain: factor of the network's initial output.
    """
    series = _trajectories(data)[0]
    matrix = modal_matrix(stated_pairs(target.rows(series.times)), reconstruct(series, structure), structure)
    scale_output(network, output_gain)
    return VectorField(network, structure, torch.from_numpy(matrix))
