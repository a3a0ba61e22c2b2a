"""The training loop: loss Jacobian, combination, optimizer, record. It knows neither systems nor files."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.console import Display
from eigenode_cli.engines.base import Engine, Evaluation
from eigenode_cli.engines.update import Update
from eigenode_cli.interruption import check
from eigenode_cli.solve.status import SOLVED, Status
from eigenode_cli.training.ending import DIVERGED, FINISHED, RUNNING, SMALLER, STALLED, Ending, judge
from eigenode_cli.training.least_squares import LeastSquares
from eigenode_cli.training.optimizers import Optimizer, SearchOptimizer, build_update
from eigenode_cli.training.options import BEST, RETRY, TrainerOptions, note_record
from eigenode_cli.training.progress import Progress, Snapshot
from eigenode_cli.training.stages import Phase
from eigenode_cli.training.total_loss import Objective, stationary

SAVE_SECONDS = 5.0
"""Longest time that a kill can cost: what resume needs is also saved this often between the checkpoints."""
BREATH_SECONDS = 0.25
"""About the longest time that an engine trains by itself: meanwhile nobody can interrupt it."""

STABLER = "another seed, or trainer.on_unsolvable=stabilise with stb in grads, may help"
BACK = f"trainer.on_unsolvable=retry goes back to what could be solved, or {SMALLER}"
SMOOTHER = "a smaller solver.rtol makes the terms smoother, optimizer=adam needs no smoothness"
"""What the user can do."""


class Recorder(Protocol):
    """What keeps the records of a training; `runs.recorder` writes them into files."""

    def describe(
        self, progress: Progress, lr: float, evaluation: Evaluation, monitored: Mapping[str, float]
    ) -> dict[str, Any]:
        """Return one record; `monitored` is what the optimizer tells of itself, and `test_error`."""
        ...

    def record(self, row: dict[str, Any]) -> None:
        """Keep one record."""
        ...

    def checkpoint(self, step: int, network: dict[str, Any]) -> Path:
        """Keep the network's tensors of a step; returns where."""
        ...

    def save_last(self, snapshot: Snapshot, network: dict[str, Any]) -> None:
        """Keep what resuming needs."""
        ...


class Unsolvable(Exception):
    """A solve failed and `trainer.on_unsolvable=stop` asks the run to end."""


@dataclass
class Trainer:
    """One training.

    Attributes:
        engine: evaluates the terms over the whole horizon for the record.
        phases: what trains, one after another; the first begins at step 0.
        optimizer: takes the updates.
        combination: how several gradients become updates, a code of `combine`.
        terms: names of those whose losses the display shows.
        weights: factor of each recorded term in the sum that schedules, stopping and the best weights go by, zero for
            one that does not count `(6 + user's,)`.
        options: steps, records, checkpoints, what to do when a solve fails.
        recorder: writes records and checkpoints.
        display: shows progress.
        dense_times: times in s at which `dense_error` compares `(D,)`.
        theta: parameters `(P,)`, changed in place.
        network: the network's tensors at given parameters, for checkpoints.
        progress: where the training stands.
        zero_sol: SOL of a model that stays at zero, NaN where SOL does not train: what a diverged one is compared with.
        best: parameters of the best record so far `(P,)`, None before there is one.
        tested: error at given parameters over what is held out, None where nothing is.
        wall: seconds since the start of the run.
        ending: how it ended, once it has.
    """

    engine: Engine
    phases: Sequence[Phase]
    optimizer: Optimizer
    combination: int
    terms: tuple[str, ...]
    weights: Floats
    options: TrainerOptions
    recorder: Recorder
    display: Display
    dense_times: Floats
    theta: Floats
    network: Callable[[Floats], dict[str, Any]]
    progress: Progress
    zero_sol: float = math.nan
    tested: Callable[[Floats], float] | None = None
    wall: Callable[[], float] = perf_counter
    ending: Ending = field(default=Ending(RUNNING), init=False)
    best: Floats | None = field(default=None, init=False)
    _updates: list[Update] = field(init=False)
    _objective: Objective | LeastSquares | None = field(default=None, init=False)
    _committed: Snapshot = field(init=False)
    _solvable: Snapshot | None = field(default=None, init=False)
    """The last committed state whose solve did not fail."""
    _still: tuple[int, bool] | None = field(default=None, init=False)
    """Part of the training in which nothing changes any more, from step `_still_since` on."""
    _still_since: int = field(default=0, init=False)
    _pace: tuple[int, float] = field(default=(-1, 0.0), init=False)
    """Stage of the last steps that an engine took by itself, and seconds of one."""
    _guards: int = field(default=0, init=False)
    """How often the guard fired in the last step."""

    def __post_init__(self) -> None:
        self._updates = [
            build_update(self.combination, phase.scales, self.optimizer, phase.trained) for phase in self.phases
        ]

    def go_on(self, saved: Snapshot) -> None:
        """Take up a training where a snapshot stands; one that was stopped goes on."""
        saved.restore(self.theta, self.optimizer.state())
        self.progress, self.best = saved.progress, saved.best
        if self.progress.ended is not None and self.progress.ended[0] == FINISHED:
            self.progress.ended = None

    def run(self) -> dict[str, Any]:
        """Train to the end and return its record; `ending` says how that was.

        An interruption, wherever it comes, saves the state between two steps that was reached last.

        Raises:
            Unsolvable: a solve failed under `on_unsolvable=stop`. Everything up to then is recorded.
        """
        last: dict[str, Any] = {}
        saved_at = perf_counter()
        self._commit()
        try:
            while True:
                check()
                step = self.progress.step
                final = self.progress.ended is not None or step == self.options.steps
                if final or step % self.options.record_every == 0:
                    last = self._record()
                    final = final or self.progress.ended is not None
                if final or step % self.options.checkpoint_every == 0:
                    self.recorder.checkpoint(step, self.network(self.theta))
                if final or step % self.options.checkpoint_every == 0 or perf_counter() - saved_at > SAVE_SECONDS:
                    self._save()
                    saved_at = perf_counter()
                if final:
                    kept = self._keep(last)
                    self.ending = self._judge(kept)
                    return kept
                self._advance()
        except KeyboardInterrupt:
            self._roll_back()
            self._save()
            raise

    def _advance(self) -> None:
        """Training steps up to the next event at most; where one changes nothing, all up to the event are as good."""
        start, event = self.progress.step, self._event_after(self.progress.step)
        part = self._part(start)
        if self._still != part:
            self._take_steps(start, event)
            if not np.isfinite(self.theta).all():
                self._skip_to(self._event_after(self.progress.step - 1))
                self._end(DIVERGED, f"the parameters are not finite any more; {SMALLER}")
                return
            reached = self._snapshot()
            if not reached.repeats(self._committed):
                self._committed = reached
                return
            self._still, self._still_since = part, start
        self._skip_to(event)
        if self._event_after(start - 1) == start and self._part(self.options.steps - 1) == part:
            self._settle(part[0])
        self._commit()

    def _take_steps(self, start: int, event: int) -> None:
        """Training steps from `start` on, not beyond `event`; they change the working state, not the committed one."""
        number, searching = self._part(start)
        if searching and isinstance(self.optimizer, SearchOptimizer):
            first = self._search(number, self.optimizer)
        else:
            first = self._learn(number, start, event)
        if first in SOLVED:
            self._solvable = self._committed

    def _learn(self, number: int, start: int, event: int) -> Status:
        """Take the steps that the engine takes by itself; returns how the first solve ended."""
        engine, options = self.phases[number].engine, self.options
        known, pace = self._pace
        steps = max(1, int(BREATH_SECONDS / pace)) if known == number and pace > 0.0 else 1
        rates = np.array([self.optimizer.lr(k) for k in range(start, min(event, start + steps))])
        clock = perf_counter() - engine.compile_seconds
        taken = engine.advance(self.theta, self._updates[number], rates, options.on_unsolvable == "stop")
        spent, count = perf_counter() - engine.compile_seconds - clock, taken.statuses.size
        self._pace = (number, spent / count)
        self.progress.train_seconds += spent
        self._count_guards(taken.guard_count, count)
        first = Status(int(taken.statuses[0]))
        if self.progress.unsolvable_since is None and SOLVED.issuperset(taken.statuses.tolist()):
            self.progress.step += count  # nothing to say of any step: the loop below holds the GIL
            return first
        for status, values in zip(taken.statuses.tolist(), taken.values, strict=True):
            self._note_status(Status(status), values)
            self.progress.step += 1
        return first

    def _search(self, number: int, optimizer: SearchOptimizer) -> Status:
        """One iteration on the whole function of a phase; returns how the solve where it started ended."""
        phase, step = self.phases[number], self.progress.step
        if step > 0 and self._phase(step - 1) != number:
            optimizer.restart()
        if self._objective is None or self._objective.engine is not phase.engine:
            last = number == len(self.phases) - 1
            self._objective = optimizer.objective(phase.engine, phase.scales, phase.trained, last)
        start = perf_counter() - phase.engine.compile_seconds
        here = self._objective.at(self.theta)
        self._note_status(here.status, here.values)
        optimizer.search(self.theta, self._objective, self._updates[number], step)
        self.progress.step += 1
        self._count_guards(here.guard_count, 1)
        self.progress.train_seconds += perf_counter() - phase.engine.compile_seconds - start
        return here.status

    def _count_guards(self, fired: int, steps: int) -> None:
        self.progress.guard_count += fired
        self._guards = fired // steps

    def _skip_to(self, step: int) -> None:
        """Count the steps up to `step`, which would all be as the last one was."""
        progress, skipped = self.progress, step - self.progress.step
        progress.step = step
        progress.guard_count += skipped * self._guards
        progress.unsolvable_steps += skipped * (progress.unsolvable_since is not None)

    def _settle(self, number: int) -> None:
        """Nothing will change any more: the terms are as low as they get here, or the training is stuck."""
        if self.progress.converged_at is not None:
            return
        phase, since = self.phases[number], self._still_since
        here = Objective(phase.engine, phase.scales, phase.trained).at(self.theta)
        status, size = here.jacobian.status, max(here.value, self._size(phase))
        if status not in SOLVED:
            advice = BACK if self.progress.first_sol is not None else STABLER
            self._end(STALLED, f"from step {since} on the solve fails ({status.label}) and no gradient acts; {advice}")
        elif not np.isfinite(here.gradient).all():
            self._end(DIVERGED, f"from step {since} on no gradient is finite; {SMALLER}")
        elif self.optimizer.convergence is not None or stationary(here.gradient, self.theta, size):
            self.progress.converged_at = since
            self.display.say(f"step {since}: converged, {self.optimizer.convergence or 'nothing changes from here on'}")
        else:
            stuck = f"from step {since} on {self.optimizer.label} finds no lower point, though there is a slope"
            self._end(STALLED, f"{stuck}; {SMOOTHER}")

    def _size(self, phase: Phase) -> float:
        """Scaled SOL of a model that stays at zero, which is how large the data are; 0 where SOL does not train."""
        return 0.0 if math.isnan(self.zero_sol) else float(phase.scales[0]) * self.zero_sol

    def _end(self, status: str, reason: str) -> None:
        """End the training before its last step; the last weights that could be solved become a checkpoint."""
        kept = self._solvable
        if self.progress.unsolvable_since is not None and kept is not None:
            path = self.recorder.checkpoint(kept.progress.step, self.network(kept.theta))
            reason = f"{reason}; the last weights that could be solved are in checkpoints/{path.name}"
        self.progress.ended = (status, reason)
        self._commit()

    def _judge(self, last: dict[str, Any]) -> Ending:
        if self.progress.ended is not None:
            return Ending(*self.progress.ended)
        solve = None if last["status"] == Status.OK.label else str(last["status"])
        return judge(self.progress.first_sol, last["sol"], solve, self.zero_sol)

    def _commit(self) -> None:
        """Take the working state as the one that an interruption goes back to."""
        self._committed = self._snapshot()

    def _snapshot(self) -> Snapshot:
        self.progress.wall_seconds = self.wall()
        return Snapshot.take(self.progress, self.theta, self.optimizer.state(), self.best)

    def _roll_back(self) -> None:
        """Undo whatever an interrupted step has changed."""
        self._committed.restore(self.theta, self.optimizer.state())
        self.progress, self.best, self._objective = self._committed.progress, self._committed.best, None

    def _part(self, step: int) -> tuple[int, bool]:
        """Return number of the phase that a step belongs to, and whether it is an iteration on the whole function."""
        return self._phase(step), step >= self._switch

    @property
    def _switch(self) -> int:
        """Number of the first iteration on the whole function; beyond the last step where there is none."""
        return self.optimizer.switch if isinstance(self.optimizer, SearchOptimizer) else self.options.steps

    def _event_after(self, step: int) -> int:
        """Return the next step before which something is written or changes; the first is one."""
        options = self.options
        periods = (options.record_every, options.checkpoint_every)
        ahead = [options.steps, self._switch, *(phase.first for phase in self.phases)]
        return min(event for event in (*ahead, *(step - step % k + k for k in periods)) if event > step)

    def _phase(self, step: int) -> int:
        """Return number of the phase that a step belongs to: by the step alone, so that resuming is safe."""
        return max(number for number, phase in enumerate(self.phases) if phase.first <= step)

    def _note_status(self, status: Status, values: Floats) -> None:
        """Count failed solves, and say when they begin and when the field is solvable again."""
        progress, step = self.progress, self.progress.step
        if status in SOLVED:
            if progress.unsolvable_since is not None:
                self.display.say(f"step {step}: solvable again after {step - progress.unsolvable_since} steps")
                progress.unsolvable_since = None
            return
        progress.unsolvable_steps += 1
        if self.options.on_unsolvable == "stop":
            raise Unsolvable(
                f"the solve failed ({status.label}) at step {step}; "
                "trainer.on_unsolvable=stabilise trains on without SOL until it succeeds"
            )
        if progress.unsolvable_since is None:
            progress.unsolvable_since = step
            self.display.say(f"step {step}: the solve failed ({status.label}); {self._remedy(values)}")

    def _remedy(self, values: Floats) -> str:
        if self.options.on_unsolvable == "skip":
            return "trainer.on_unsolvable=skip leaves the parameters as they are"
        if self.options.on_unsolvable == RETRY and self.progress.first_sol is not None:
            return "half of the step is tried, from the last parameters that could be solved"
        if not np.isfinite(values).any():
            return "no spectral term is named in grads, so nothing can stabilise it"
        return "SOL is skipped, the spectral terms go on until it succeeds"

    def _record(self) -> dict[str, Any]:
        evaluation = self.engine.evaluate(self.theta, self.dense_times)
        total = self._total(evaluation)
        if math.isfinite(total) and note_record(self.progress, total):
            self.best = self.theta.copy()
        self.optimizer.observe(total)
        row = self._row(evaluation)
        self.recorder.record(row)
        done = self.progress.step
        if done == 0 and row["status"] == Status.OK.label:
            self.progress.first_sol = row["sol"]
        rate = self.progress.train_seconds / done if done else None
        self.display.record(done, {name: row[name] for name in self.terms}, rate)
        reason = self.options.stopping.reason(self.progress, row["sol"])
        if reason is not None and self.progress.ended is None and done < self.options.steps:
            self.progress.ended = (FINISHED, reason)
            self.display.say(f"step {done}: stopped, {reason}")
            self._commit()
        return row

    def _row(self, evaluation: Evaluation) -> dict[str, Any]:
        rate = self.optimizer.lr(self.progress.step)
        tested = math.nan if self.tested is None else self.tested(self.theta)
        monitored = {**self.optimizer.records, "test_error": tested}
        return self.recorder.describe(self.progress, rate, evaluation, monitored)

    def _total(self, evaluation: Evaluation) -> float:
        """Sum of the scaled terms at a record, infinite where it is not defined."""
        counted = self.weights > 0.0
        total = float(self.weights[counted] @ evaluation.values[counted])
        return total if evaluation.status is Status.OK and math.isfinite(total) else math.inf

    def _keep(self, last: dict[str, Any]) -> dict[str, Any]:
        """Put the weights that are asked for into `theta`; returns their record."""
        best, good = self.best, self.optimizer.good
        if last["status"] != Status.OK.label and good.any() and self.options.keep != BEST:
            self.theta[:] = good[:-1]
            self.recorder.checkpoint(self.progress.step, self.network(self.theta))
            self.display.say("kept: the last weights that could be solved")
            return self._row(self.engine.evaluate(self.theta, self.dense_times))
        if self.options.keep != BEST or best is None or self.progress.best_step == self.progress.step:
            return last
        self.theta[:] = best
        self.recorder.checkpoint(self.progress.best_step or 0, self.network(self.theta))
        self.display.say(f"kept: the weights of step {self.progress.best_step}")
        row = self._row(self.engine.evaluate(self.theta, self.dense_times))
        return row | {"step": self.progress.best_step}

    def _save(self) -> None:
        self.recorder.save_last(self._committed, self.network(self._committed.theta))
