"""Our training loop itself: it makes the weights of a case, and its steps are compared with the floor."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import numpy as np

from eigenode_cli.bench.case import Case, recipe_config, shape_of
from eigenode_cli.bench.contestants import BareSolve
from eigenode_cli.bench.measure import Ratio, compare
from eigenode_cli.combine import COMBINATIONS
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data import Floats
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.field import flat_parameters
from eigenode_cli.optimizer import build_optimizer
from eigenode_cli.recorder import Progress, Recorder
from eigenode_cli.run import DENSE, build
from eigenode_cli.terms import NAMES
from eigenode_cli.trainer import Trainer

STANDSTILL = 1e-15
"""Learning rate of steps that are only timed: the weights stay where they are."""
BLOCK = 500
"""Training steps that are timed together, with their records and one checkpoint."""
THREADED = 200
"""Training steps of each repetition that are timed on one and on two threads."""


class Silent:
    """Shows nothing; see `console.Display`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""

    def say(self, message: str) -> None:
        """See `Display.say`."""


@dataclass(frozen=True)
class Trained:
    """A case at trained weights.

    Attributes:
        case: with these weights.
        config: the recipe.
        train_seconds: what the training of all its steps took, without compilation and records.
    """

    case: Case
    config: TrainConfig
    train_seconds: float


def train_case(name: str) -> Trained:
    """Train by the recipe of a case, from its seed: the same weights at every call."""
    config = recipe_config(name)
    setup = build(config)
    case = Case(shape_of(setup.field), setup.problem, flat_parameters(setup.field))
    CompiledEngine(case.shape, case.problem).loss_jacobian(case.theta)  # compiled before the clock runs
    theta, progress = case.theta.copy(), Progress()
    with TemporaryDirectory() as folder:
        run_steps(config, case, theta, progress, Path(folder))
    return Trained(replace(case, theta=theta), config, progress.train_seconds)


def run_steps(config: TrainConfig, case: Case, theta: Floats, progress: Progress, folder: Path) -> None:
    """Train `theta (P,)` in place over all steps of a configuration, with records and checkpoints in `folder`."""
    trainer_for(config, case, theta, progress, folder, CompiledEngine(case.shape, case.problem))()


def trainer_for(
    config: TrainConfig, case: Case, theta: Floats, progress: Progress, folder: Path, engine: CompiledEngine
) -> Callable[[], None]:
    """The training of `theta (P,)` as a call that starts where `progress` stands."""
    recorder = Recorder(folder, NAMES, np.zeros(DENSE))
    trainer = Trainer(
        engine=engine,
        optimizer=build_optimizer(config.optimizer, theta.size),
        combination=COMBINATIONS[config.combine.name],
        terms=case.problem.terms,
        scales=np.array([config.scale[term] for term in case.problem.terms]),
        config=config.trainer,
        recorder=recorder,
        display=Silent(),
        dense_times=np.linspace(0.0, case.times[-1], DENSE),
        theta=theta,
        network=lambda _theta: {},
        progress=progress,
    )

    def call() -> None:
        recorder.open(None)
        try:
            trainer.run()
        finally:
            recorder.close()

    return call


def _standing(trained: Trained, steps: int, folder: Path, engine: CompiledEngine) -> Callable[[], None]:
    """So many whole training steps that leave the weights where they are."""
    optimizer = replace(trained.config.optimizer, lr=STANDSTILL)
    trainer = replace(trained.config.trainer, steps=steps, checkpoint_every=steps)
    config = replace(trained.config, optimizer=optimizer, trainer=trainer)
    theta, progress = trained.case.theta.copy(), Progress()
    run = trainer_for(config, trained.case, theta, progress, folder, engine)

    def call() -> None:
        progress.step = 0
        run()

    return call


def step_over_floor(trained: Trained) -> Ratio:
    """A whole training step, with optimizer and its share of records and checkpoints, over a bare solve."""
    bare = BareSolve(trained.case)

    def solves() -> None:
        for _ in range(BLOCK):
            bare()

    with TemporaryDirectory() as folder:
        engine = CompiledEngine(trained.case.shape, trained.case.problem)
        return compare(_standing(trained, BLOCK, Path(folder), engine), solves)


def six_over_one(case: Case) -> Ratio:
    """The loss Jacobian of all six terms over that of SOL alone, at the same weights."""
    calls = [CompiledEngine(case.shape, case.with_terms(terms).problem).loss_jacobian for terms in (NAMES, ("sol",))]
    return compare(partial(calls[0], case.theta), partial(calls[1], case.theta))


def two_threads(trained: Trained) -> Ratio:
    """Throughput of two threads over that of one: two repetitions one after another over both side by side."""
    with TemporaryDirectory() as first, TemporaryDirectory() as second, ThreadPoolExecutor(2) as pool:
        repetitions = [
            _standing(trained, THREADED, Path(folder), CompiledEngine(trained.case.shape, trained.case.problem))
            for folder in (first, second)
        ]

        def in_turn() -> None:
            for repetition in repetitions:
                repetition()

        def side_by_side() -> None:
            for future in [pool.submit(repetition) for repetition in repetitions]:
                future.result()

        return compare(in_turn, side_by_side)
