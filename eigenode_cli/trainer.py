"""The training loop: loss Jacobian, combination, optimizer, record. It knows nothing of engines, systems or files."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from eigenode_cli.combine import acting
from eigenode_cli.config.schema import TrainerConfig
from eigenode_cli.console import Display, duration
from eigenode_cli.data import Floats
from eigenode_cli.engines.base import Engine, LossJacobian
from eigenode_cli.objective import Objective
from eigenode_cli.optimizer import AdamBfgs, Optimizer
from eigenode_cli.recorder import Progress, Recorder
from eigenode_cli.solve.status import Status

SAVE_SECONDS = 5.0
"""Longest time that a kill can cost: what resume needs is also saved this often between the checkpoints."""


class Unsolvable(Exception):
    """A solve failed and `trainer.on_unsolvable=stop` asks the run to end."""


@dataclass
class Trainer:
    """One training.

    Attributes:
        engine: evaluates the terms over the whole horizon for the record.
        stages: compute the loss Jacobian, one after another: with `spectral_steps` the first one for so many, the
            others for an equal share of the rest.
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
    _objective: Objective | None = field(default=None, init=False)

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

    def _stage(self, step: int) -> Engine:
        """What computes the loss Jacobian of a training step."""
        lead = self.config.spectral_steps
        if step < lead:
            return self.stages[0]
        rest = self.stages[1:] if lead else self.stages
        return rest[(step - lead) * len(rest) // (self.config.steps - lead)]

    def _step(self) -> None:
        step = self.progress.step
        engine = self._stage(step)
        start = perf_counter() - engine.compile_seconds
        if isinstance(self.optimizer, AdamBfgs) and self.optimizer.searches(step):
            if step > 0 and engine is not self._stage(step - 1):
                self.optimizer.bfgs.restart()
            jacobian = self._descend(engine, self.optimizer)
        else:
            jacobian = engine.loss_jacobian(self.theta)
            self._note_status(jacobian)
            self._update(jacobian)
        self.progress.step += 1
        self.progress.guard_count += jacobian.guard_count
        self.progress.train_seconds += perf_counter() - engine.compile_seconds - start

    def _update(self, jacobian: LossJacobian) -> None:
        gradients = acting(jacobian.gradients, self.scales)
        if gradients.size > 0:
            for update in self.combination(gradients):
                self.optimizer.update(self.theta, update)

    def _descend(self, engine: Engine, optimizer: AdamBfgs) -> LossJacobian:
        """One iteration of BFGS, or where a solve fails an update of what is left; gives the loss Jacobian before."""
        if self._objective is None or self._objective.engine is not engine:
            self._objective = Objective(engine, self.scales)
        here = self._objective.at(self.theta)
        self._note_status(here.jacobian)
        if math.isfinite(here.value):
            optimizer.bfgs.step(self.theta, here, self._objective.at)
        else:
            optimizer.bfgs.restart()
            self._update(here.jacobian)
        return here.jacobian

    def _note_status(self, jacobian: LossJacobian) -> None:
        """Count failed solves, and say when they begin and when the field is solvable again."""
        progress, step = self.progress, self.progress.step
        if jacobian.status in (Status.OK, Status.UNSOLVED):
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
