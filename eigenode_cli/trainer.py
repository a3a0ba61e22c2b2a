"""The training loop: loss Jacobian, combination, optimizer, record. It knows nothing of engines, systems or files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from eigenode_cli.combine import acting
from eigenode_cli.config.schema import TrainerConfig
from eigenode_cli.console import Display, duration
from eigenode_cli.data import Floats
from eigenode_cli.engines.base import Engine, LossJacobian
from eigenode_cli.optimizer import Optimizer
from eigenode_cli.recorder import Progress, Recorder
from eigenode_cli.solve.status import Status

SAVE_SECONDS = 5.0
"""Longest time that a kill can cost: what resume needs is also saved this often between the checkpoints."""


class Unsolvable(Exception):
    """A solve failed and `trainer.on_unsolvable=stop` asks the run to end."""


@dataclass(frozen=True)
class Pretraining:
    """What trains in the first steps, in place of everything else.

    Attributes:
        engine: of its own terms.
        scales: factor of each of these terms' gradients `(L,)`.
    """

    engine: Engine
    scales: Floats


@dataclass
class Trainer:
    """One training.

    Attributes:
        engine: evaluates the terms over the whole horizon for the record.
        stages: compute the loss Jacobian, one after another for an equal share of the steps; the last is `engine`.
        optimizer: takes the updates.
        combination: scaled gradients `(L, P)` to updates `(K, P)`.
        terms: the named terms `(L,)`.
        scales: factor of each named term's gradient `(L,)`.
        config: steps, records, checkpoints, what to do when a solve fails.
        recorder: writes records and checkpoints.
        display: shows progress.
        dense_times: times in s at which `dense_error` compares `(D,)`.
        theta: parameters `(P,)`, changed in place.
        network: the network's tensors at given parameters, for checkpoints.
        progress: where the training stands.
        pretraining: comes before the stages, for the first `config.pretrain_steps` steps; None for nothing.
    """

    engine: Engine
    stages: Sequence[Engine]
    optimizer: Optimizer
    combination: Callable[[Floats], Floats]
    terms: tuple[str, ...]
    scales: Floats
    config: TrainerConfig
    recorder: Recorder
    display: Display
    dense_times: Floats
    theta: Floats
    network: Callable[[Floats], dict[str, Any]]
    progress: Progress
    pretraining: Pretraining | None = None

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
                self.optimizer.begin(step)
                if final or step % self.config.record_every == 0:
                    last = self._record()
                if final or step % self.config.checkpoint_every == 0:
                    self.recorder.checkpoint(step, self.network(self.theta))
                if final or step % self.config.checkpoint_every == 0 or perf_counter() - saved_at > SAVE_SECONDS:
                    self._save()
                    saved_at = perf_counter()
                if final:
                    return last
                self._step()
        except KeyboardInterrupt:
            self._save()
            raise

    def _step(self) -> None:
        engine, scales = self._stage(self.progress.step)
        start = perf_counter() - engine.compile_seconds
        jacobian = engine.loss_jacobian(self.theta)
        self._note_status(jacobian)
        gradients = acting(jacobian.gradients, scales)
        if gradients.size > 0:
            for update in self.combination(gradients):
                self.optimizer.update(self.theta, update)
        self.progress.step += 1
        self.progress.guard_count += jacobian.guard_count
        self.progress.train_seconds += perf_counter() - engine.compile_seconds - start

    def _stage(self, step: int) -> tuple[Engine, Floats]:
        """What takes a training step: engine and scales, by the number of the step alone, so that resuming is safe."""
        first = self.config.pretrain_steps
        if self.pretraining is not None and step < first:
            return self.pretraining.engine, self.pretraining.scales
        return self.stages[(step - first) * len(self.stages) // (self.config.steps - first)], self.scales

    def _note_status(self, jacobian: LossJacobian) -> None:
        """Count failed solves, and say when they begin and when the field is solvable again."""
        progress, step = self.progress, self.progress.step
        if jacobian.status is Status.OK:
            if progress.unsolvable_since is not None:
                self.display.say(
                    f"step {step}: solvable again after {step - progress.unsolvable_since} steps of stabilisation"
                )
                progress.unsolvable_since = None
            return
        progress.unsolvable_steps += 1
        if self.config.on_unsolvable == "stop":
            raise Unsolvable(
                f"the solve failed ({jacobian.status.label}) at step {step}; "
                "trainer.on_unsolvable=stabilise trains on without SOL until it succeeds"
            )
        if progress.unsolvable_since is None:
            progress.unsolvable_since = step
            self.display.say(f"step {step}: the solve failed ({jacobian.status.label}); {self._remedy(jacobian)}")

    def _remedy(self, jacobian: LossJacobian) -> str:
        if self.config.on_unsolvable == "skip":
            return "trainer.on_unsolvable=skip leaves the parameters as they are"
        if not np.isfinite(jacobian.values).any():
            return "no spectral term is named in grads, so nothing can stabilise it"
        return "SOL is skipped, the spectral terms go on until it succeeds"

    def _record(self) -> dict[str, Any]:
        row = self.recorder.record(self.progress, self.optimizer.lr, self.engine.evaluate(self.theta, self.dense_times))
        done = self.progress.step
        rate = self.progress.train_seconds / done if done else None
        self.display.record(done, {name: row[name] for name in self.terms}, rate)
        return row

    def _save(self) -> None:
        self.recorder.save_last(self.progress, self.theta, self.optimizer.state())


def summary(row: dict[str, Any], progress: Progress) -> str:
    """The result of a run in one line."""
    parts = [f"sol {row['sol']:.4g}", f"dense error {row['dense_error']:.4g}", f"max real {row['max_real']:.3g} 1/s"]
    if progress.unsolvable_steps:
        parts.append(f"{progress.unsolvable_steps} unsolvable steps")
    return ", ".join(parts) + f" after {progress.step} steps in {duration(progress.train_seconds)}"
