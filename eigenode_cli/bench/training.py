"""Our training loop itself: it makes the weights of a case, and its steps are compared with the floor."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from torch import Tensor

from eigenode_cli.arrays import Floats
from eigenode_cli.batch.outcome import DENSE
from eigenode_cli.bench.case import Case, recipe_config, torch_field
from eigenode_cli.bench.contestants import BareSolve
from eigenode_cli.bench.measure import Ratio, compare, ratio_of
from eigenode_cli.config.build import build_method, build_options, gradient_scales
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.setup import build
from eigenode_cli.console import QuietDisplay
from eigenode_cli.engines.combine import COMBINATIONS
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.model import load_flat
from eigenode_cli.runs.recorder import Recorder
from eigenode_cli.terms import NAMES, PAPER_TERMS
from eigenode_cli.training.optimizers import build_optimizer
from eigenode_cli.training.progress import Progress
from eigenode_cli.training.stages import Phase
from eigenode_cli.training.trainer import Trainer

STANDSTILL = 1e-15
"""Learning rate of steps that are only timed: the weights stay where they are."""
RUN_STEPS = 5000
"""Training steps of a run of the paper."""
BLOCK = 500
"""Training steps that are timed together, with their records and one checkpoint."""
GRADIENT_PAIRS = 11
"""Pairs of a peer's loss Jacobian and a block of training steps."""
REPETITIONS = 4
"""Runs that are timed on one and on two threads. Each lasts long enough that a core which was idle is awake again."""


@dataclass(frozen=True)
class Trained:
    """A case at trained weights.

    Attributes:
        case: with these weights.
        config: the recipe.
        train_seconds: what 5,000 of its steps took on average, without compilation and records.
    """

    case: Case
    config: TrainConfig
    train_seconds: float


def train_case(name: str) -> Trained:
    """Train by the recipe of a case, from its seed: the same weights at every call."""
    config = recipe_config(name)
    setup = build(config)
    case = Case(shape_of(setup.field), setup.problem, setup.theta.copy())
    CompiledEngine(case.shape, case.problem).loss_jacobian(case.theta)  # compiled before the clock runs
    theta, progress = case.theta.copy(), Progress()
    with TemporaryDirectory() as folder:
        run_steps(config, case, theta, progress, Path(folder))
    return Trained(replace(case, theta=theta), config, progress.train_seconds * RUN_STEPS / progress.step)


def run_steps(config: TrainConfig, case: Case, theta: Floats, progress: Progress, folder: Path) -> None:
    """Train `theta (P,)` in place over all steps of a configuration, with records and checkpoints in `folder`."""
    trainer_for(config, case, theta, progress, folder, CompiledEngine(case.shape, case.problem))()


def trainer_for(
    config: TrainConfig, case: Case, theta: Floats, progress: Progress, folder: Path, engine: CompiledEngine
) -> Callable[[], None]:
    """Return the training of `theta (P,)` as a call that starts where `progress` stands."""
    recorder, field = Recorder(folder, NAMES, np.zeros(DENSE)), torch_field(case)
    scales = gradient_scales(config)

    def network(at: Floats) -> dict[str, Tensor]:
        load_flat(field, at)
        return field.network.state_dict()

    trainer = Trainer(
        engine=engine,
        phases=[Phase(0, engine, np.array([scales[term] for term in case.problem.terms]))],
        optimizer=build_optimizer(build_method(config), theta.size),
        combination=COMBINATIONS[config.combine.name],
        terms=case.problem.terms,
        weights=np.array([scales[name] if name in case.problem.terms else 0.0 for name in NAMES]),
        options=build_options(config),
        recorder=recorder,
        display=QuietDisplay(),
        dense_times=np.linspace(0.0, case.times[-1], DENSE),
        theta=theta,
        network=network,
        progress=progress,
    )

    def call() -> None:
        recorder.open(None)
        try:
            trainer.run()
        finally:
            recorder.close()

    return call


class _Standing:
    """So many whole training steps at a call, which leave the weights where they are.

    Attributes:
        progress: counts `train_seconds` over all calls.
    """

    def __init__(self, trained: Trained, steps: int, folder: Path) -> None:
        case, config = trained.case, trained.config
        optimizer = replace(config.optimizer, lr=STANDSTILL)
        trainer = replace(config.trainer, steps=steps, checkpoint_every=steps)
        self.progress = Progress()
        self._run = trainer_for(
            replace(config, optimizer=optimizer, trainer=trainer),
            case,
            case.theta.copy(),
            self.progress,
            folder,
            CompiledEngine(case.shape, case.problem),
        )

    def __call__(self) -> None:
        self.progress.step = 0
        self._run()


def gradient_over_step(trained: Trained, gradient: Callable[[], Any]) -> Ratio:
    """Return a peer's loss Jacobian over one training step of ours as `train_seconds` counts it, at equal weights."""
    spans: list[tuple[float, float]] = []
    with TemporaryDirectory() as folder:
        standing = _Standing(trained, BLOCK, Path(folder))
        standing()
        gradient()
        for _ in range(GRADIENT_PAIRS):
            start, before = perf_counter(), standing.progress.train_seconds
            gradient()
            span = perf_counter() - start
            standing()
            spans.append((span, (standing.progress.train_seconds - before) / BLOCK))
    times = np.array(spans)
    return ratio_of(times[:, 0], times[:, 1])


def step_over_floor(trained: Trained) -> Ratio:
    """Return a whole training step, with optimizer and its share of records and checkpoints, over a bare solve."""
    bare = BareSolve(trained.case)

    def solves() -> None:
        for _ in range(BLOCK):
            bare()

    with TemporaryDirectory() as folder:
        return compare(_Standing(trained, BLOCK, Path(folder)), solves)


def six_over_one(case: Case, term: str, sensitivity: str) -> Ratio:
    """Return the loss Jacobian of all six terms over that of one, at the same weights and by the same way."""
    problems = [case.with_terms(terms).problem for terms in (PAPER_TERMS, (term,))]
    six, one = (CompiledEngine(case.shape, problem, sensitivity=sensitivity) for problem in problems)
    return compare(partial(six.loss_jacobian, case.theta), partial(one.loss_jacobian, case.theta))


def two_threads(trained: Trained) -> Ratio:
    """Throughput of two threads over that of one: repetitions one after another over the same, two at a time."""
    with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        folders = [Path(folder) / str(number) for number in range(REPETITIONS)]
        repetitions = [_Standing(trained, RUN_STEPS, place) for place in folders]

        def in_turn() -> None:
            for repetition in repetitions:
                repetition()

        def side_by_side() -> None:
            for future in [pool.submit(repetition) for repetition in repetitions]:
                future.result()

        return compare(in_turn, side_by_side)
