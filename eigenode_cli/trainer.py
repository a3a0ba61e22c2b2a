"""The training loop: loss Jacobian, combination, optimizer, record. It knows nothing of engines, systems or files."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from eigenode_cli.config.schema import TrainerConfig
from eigenode_cli.console import Display, duration
from eigenode_cli.data import Floats
from eigenode_cli.engines.base import Engine
from eigenode_cli.learner import Rule, build_rule, learn
from eigenode_cli.objective import Objective
from eigenode_cli.optimizer import AdamBfgs, Optimizer
from eigenode_cli.recorder import Progress, Recorder
from eigenode_cli.solve.status import SOLVED, Status

SAVE_SECONDS = 5.0
"""Longest time that a kill can cost: what resume needs is also saved this often between the checkpoints."""
BREATH_SECONDS = 0.25
"""About the longest time that an engine trains by itself: meanwhile nobody can interrupt it."""


class Unsolvable(Exception):
    """A solve failed and `trainer.on_unsolvable=stop` asks the run to end."""


@dataclass(frozen=True)
class Stage:
    """Training steps that one engine takes.

    Attributes:
        first: number of the first of them; the stage lasts to that of the next one.
        engine: computes the loss Jacobian of L terms.
        scales: factor of each of these terms' gradients `(L,)`.
    """

    first: int
    engine: Engine
    scales: Floats


@dataclass
class Trainer:
    """One training.

    Attributes:
        engine: evaluates the terms over the whole horizon for the record.
        stages: what trains, one after another; the first begins at step 0.
        optimizer: takes the updates.
        combination: how several gradients become updates, a code of `combine`.
        terms: names of those whose losses the display shows.
        config: steps, records, checkpoints, what to do when a solve fails.
        recorder: writes records and checkpoints.
        display: shows progress.
        dense_times: times in s at which `dense_error` compares `(D,)`.
        theta: parameters `(P,)`, changed in place.
        network: the network's tensors at given parameters, for checkpoints.
        progress: where the training stands.
    """

    engine: Engine
    stages: Sequence[Stage]
    optimizer: Optimizer
    combination: int
    terms: tuple[str, ...]
    config: TrainerConfig
    recorder: Recorder
    display: Display
    dense_times: Floats
    theta: Floats
    network: Callable[[Floats], dict[str, Any]]
    progress: Progress
    _rules: list[Rule] = field(init=False)
    _objective: Objective | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._rules = [build_rule(self.combination, stage.scales, self.optimizer) for stage in self.stages]

    def run(self) -> dict[str, Any]:
        """Train to the last step and return its record.

        Raises:
            Unsolvable: a solve failed under `on_unsolvable=stop`. Everything up to then is recorded.
        """
        last: dict[str, Any] = {}
        saved_at = perf_counter()
        try:
            while True:
                step, final = self.progress.step, self.progress.step == self.config.steps
                if final or step % self.config.record_every == 0:
                    last = self._record()
                if final or step % self.config.checkpoint_every == 0:
                    self.recorder.checkpoint(step, self.network(self.theta))
                if final or step % self.config.checkpoint_every == 0 or perf_counter() - saved_at > SAVE_SECONDS:
                    self._save()
                    saved_at = perf_counter()
                if final:
                    return last
                self._advance()
        except KeyboardInterrupt:
            self._save()
            raise

    def _advance(self) -> None:
        """Training steps up to the next one before which something is written or changes."""
        step, config, optimizer = self.progress.step, self.config, self.optimizer
        number = self._stage(step)
        engine, following = self.stages[number].engine, self.stages[number + 1 : number + 2]
        switch = optimizer.switch if isinstance(optimizer, AdamBfgs) else config.steps
        if isinstance(optimizer, AdamBfgs) and step >= switch:
            self._descend(number, optimizer)
            return
        events = [
            min(config.steps, switch),
            *(stage.first for stage in following),
            step - step % config.record_every + config.record_every,
            step - step % config.checkpoint_every + config.checkpoint_every,
            step + self._steps_in(BREATH_SECONDS),
        ]
        rates = np.array([optimizer.lr(k) for k in range(step, min(events))])
        start = perf_counter() - engine.compile_seconds
        taken = engine.advance(self.theta, self._rules[number], rates, config.on_unsolvable == "stop")
        self.progress.train_seconds += perf_counter() - engine.compile_seconds - start
        self.progress.guard_count += taken.guard_count
        if self.progress.unsolvable_since is None and SOLVED.issuperset(taken.statuses.tolist()):
            self.progress.step += taken.statuses.size  # nothing to say of any step: the loop below holds the GIL
            return
        for status, values in zip(taken.statuses.tolist(), taken.values, strict=True):
            self._note_status(Status(status), values)
            self.progress.step += 1

    def _descend(self, number: int, optimizer: AdamBfgs) -> None:
        """One iteration of BFGS on the sum of a stage's terms; where a solve fails, Adam's update of the rest."""
        stage, step = self.stages[number], self.progress.step
        if step > 0 and self._stage(step - 1) != number:
            optimizer.bfgs.restart()
        if self._objective is None or self._objective.engine is not stage.engine:
            self._objective = Objective(stage.engine, stage.scales)
        start = perf_counter() - stage.engine.compile_seconds
        here = self._objective.at(self.theta)
        self._note_status(here.jacobian.status, here.jacobian.values)
        if math.isfinite(here.value):
            optimizer.bfgs.step(self.theta, here, self._objective.at)
        else:
            optimizer.bfgs.restart()
            learn(self._rules[number], self.theta, here.jacobian.gradients, optimizer.adam_lr(step))
        self.progress.step += 1
        self.progress.guard_count += here.jacobian.guard_count
        self.progress.train_seconds += perf_counter() - stage.engine.compile_seconds - start

    def _stage(self, step: int) -> int:
        """Number of the stage that a step belongs to: by the step alone, so that resuming is safe."""
        return max(number for number, stage in enumerate(self.stages) if stage.first <= step)

    def _steps_in(self, seconds: float) -> int:
        """About as many steps as take so many seconds, at least one."""
        done, spent = self.progress.step, self.progress.train_seconds
        return max(1, int(seconds * done / spent)) if spent > 0.0 else 1

    def _note_status(self, status: Status, values: Floats) -> None:
        """Count failed solves, and say when they begin and when the field is solvable again."""
        progress, step = self.progress, self.progress.step
        if status in SOLVED:
            if progress.unsolvable_since is not None:
                self.display.say(
                    f"step {step}: solvable again after {step - progress.unsolvable_since} steps of stabilisation"
                )
                progress.unsolvable_since = None
            return
        progress.unsolvable_steps += 1
        if self.config.on_unsolvable == "stop":
            raise Unsolvable(
                f"the solve failed ({status.label}) at step {step}; "
                "trainer.on_unsolvable=stabilise trains on without SOL until it succeeds"
            )
        if progress.unsolvable_since is None:
            progress.unsolvable_since = step
            self.display.say(f"step {step}: the solve failed ({status.label}); {self._remedy(values)}")

    def _remedy(self, values: Floats) -> str:
        if self.config.on_unsolvable == "skip":
            return "trainer.on_unsolvable=skip leaves the parameters as they are"
        if not np.isfinite(values).any():
            return "no spectral term is named in grads, so nothing can stabilise it"
        return "SOL is skipped, the spectral terms go on until it succeeds"

    def _record(self) -> dict[str, Any]:
        row = self.recorder.record(
            self.progress, self.optimizer.lr(self.progress.step), self.engine.evaluate(self.theta, self.dense_times)
        )
        done = self.progress.step
        rate = self.progress.train_seconds / done if done else None
        self.display.record(done, {name: row[name] for name in self.terms}, rate)
        return row

    def _save(self) -> None:
        self.recorder.save_last(self.progress, self.theta, self.optimizer.state(), self.network(self.theta))


def summary(row: dict[str, Any], progress: Progress) -> str:
    """The result of a run in one line."""
    parts = [f"sol {row['sol']:.4g}", f"dense error {row['dense_error']:.4g}", f"max real {row['max_real']:.3g} 1/s"]
    if progress.unsolvable_steps:
        parts.append(f"{progress.unsolvable_steps} unsolvable steps")
    return ", ".join(parts) + f" after {progress.step} steps in {duration(progress.train_seconds)}"
