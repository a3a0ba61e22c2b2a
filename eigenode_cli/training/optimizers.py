"""Optimizers on a flat parameter vector.

Their updates are compiled (`engines.first_order`), so that the compiled engine can take whole training steps.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.combine import combine
from eigenode_cli.engines.first_order import ADAM, SGD, take_update
from eigenode_cli.engines.update import Update, learn
from eigenode_cli.training.bfgs import Bfgs, Lbfgs
from eigenode_cli.training.least_squares import EVIDENT, RIDGE, Iteration, LeastSquares
from eigenode_cli.training.methods import Adam, AdamBfgs, LevenbergMarquardt, Method, OwnMethod, Sgd
from eigenode_cli.training.schedules import Schedule
from eigenode_cli.training.total_loss import Objective

CONSTANT = Schedule()


class Optimizer:
    """Turns one update after another into new parameters.

    Args:
        method: which one, with its constants.
        parameters: P.
        schedule: of the learning rate.

    Attributes:
        code, options, memory, count: as in `take_update`.
        limit, clipped, good: as in `engines.update.Update`.

    Raises:
        TypeError: there is no such method.
    """

    label = "the optimizer"
    """Name in messages."""

    def __init__(self, method: Method | OwnMethod, parameters: int, schedule: Schedule = CONSTANT) -> None:
        self._method, self._schedule = method, schedule
        self._plateau = np.array([1.0, math.inf, 0.0])
        self.count, self.clipped, self.good = np.zeros(1), np.zeros(1), np.empty(0)
        self.limit = method.clip if isinstance(method, Method) and method.clip is not None else math.inf
        if isinstance(method, Adam):
            self.code, names = ADAM, ("first_moment", "second_moment")
            self.options = np.array([method.beta1, method.beta2, method.eps])
        elif isinstance(method, Sgd):
            self.code, names = SGD, ("velocity",)
            self.options = np.array([method.momentum])
        elif isinstance(method, OwnMethod):  # its own update takes the steps (`OwnOptimizer`)
            self.code, names, self.options = SGD, (), np.zeros(1)
        else:
            raise TypeError(f"{type(method).__name__}: no such optimizer")
        self.memory = np.zeros((len(names), parameters))
        self._state = dict(zip(names, self.memory, strict=True)) | {"count": self.count, "plateau": self._plateau}
        if self.limit < math.inf:
            self._state["clipped"] = self.clipped

    def lr(self, step: int) -> float:
        """Return the learning rate of training step `step`; a step may take several updates."""
        return float(self._plateau[0]) * self._schedule.rate(self._method.lr, step)

    def observe(self, value: float) -> None:
        """Take note of the sum of the scaled terms at a record, infinite where it is not defined."""
        self._schedule.observe(self._plateau, value)

    def update(self, theta: Floats, gradient: Floats, lr: float) -> None:
        """Change `theta (P,)` in place by one step of rate `lr` against `gradient (P,)`."""
        take_update(self.code, theta, gradient, lr, self.options, self.memory, self.count)

    def state(self) -> dict[str, Floats]:
        """Return everything that the next update depends on, by name; the arrays themselves, not copies."""
        return self._state

    @property
    def records(self) -> dict[str, float]:
        """What is recorded of it besides the learning rate, by column."""
        return {"clipped": float(self.clipped[0])} if self.limit < math.inf else {}

    def keep_good(self) -> None:
        """Keep the last parameters whose solve succeeded, to go back to them where one fails."""
        self.good = np.zeros(self.memory.shape[1] + 1)
        self._state["good"] = self.good

    @property
    def convergence(self) -> str | None:
        """Why it has converged by a rule of its own, None where it has not."""
        return None


class SearchOptimizer(Optimizer, ABC):
    """Optimizes a function as a whole, one iteration at a call; Adam's update leads out of where it has no value.

    Args:
        method: its constants.
        parameters: P.
        switch: number of the first training step that is such an iteration; Adam takes those before.
    """

    def __init__(self, method: Method | OwnMethod, parameters: int, switch: int, schedule: Schedule = CONSTANT) -> None:
        super().__init__(method, parameters, schedule)
        self.switch = switch

    @abstractmethod
    def objective(
        self, engine: Engine, scales: Floats, trained: NDArray[np.bool_] | None, last: bool
    ) -> Objective | LeastSquares:
        """Return the function of a phase; `last` tells whether it is that of the training."""

    @abstractmethod
    def restart(self) -> None:
        """Forget what was learned of the function: another one comes."""

    @abstractmethod
    def search(self, theta: Floats, objective: Any, update: Update, step: int) -> None:
        """Take one iteration from `theta (P,)`, changed in place; `update` is Adam's."""

    def lr(self, step: int) -> float:
        """Return the learning rate of Adam; NaN where it does not take the step."""
        return math.nan if step >= self.switch else self.adam_lr(step)

    def adam_lr(self, step: int) -> float:
        """Return the learning rate of Adam at any step."""
        return super().lr(step)


class AdamBfgsOptimizer(SearchOptimizer):
    """Adam first, then BFGS: the first passes jumps and kinks of the terms, the second converges.

    Attributes:
        bfgs: the second part.
    """

    label = "BFGS"

    def __init__(self, method: AdamBfgs, parameters: int, schedule: Schedule = CONSTANT) -> None:
        super().__init__(method, parameters, method.adam_steps, schedule)
        self.bfgs = Lbfgs(parameters, method.pairs) if method.pairs > 0 else Bfgs(parameters)
        self._state |= self.bfgs.state()

    def objective(self, engine: Engine, scales: Floats, trained: NDArray[np.bool_] | None, last: bool) -> Objective:
        """See `SearchOptimizer.objective`."""
        del last
        return Objective(engine, scales, trained)

    def restart(self) -> None:
        """See `SearchOptimizer.restart`."""
        self.bfgs.restart()

    def search(self, theta: Floats, objective: Objective, update: Update, step: int) -> None:
        """See `SearchOptimizer.search`."""
        here = objective.at(theta)
        if math.isfinite(here.value):
            self.bfgs.step(theta, here, objective.at)
        else:
            self.restart()
            learn(update, theta, here.jacobian.gradients, self.adam_lr(step))


class LeastSquaresOptimizer(SearchOptimizer):
    """Levenberg-Marquardt from the first step on.

    Args:
        method: its constants.
        parameters: P.
        network: how many of them, the leading ones, are the network's.
    """

    label = "Levenberg-Marquardt"

    def __init__(
        self, method: LevenbergMarquardt, parameters: int, network: int, schedule: Schedule = CONSTANT
    ) -> None:
        super().__init__(method, parameters, 0, schedule)
        self._constants = method
        self._penalised = np.arange(parameters) < network
        self.iteration = Iteration(method.damping, method.tolerance, method.ridge)
        self._state |= {"iteration": self.iteration.memory}

    @property
    def convergence(self) -> str | None:
        """See `Optimizer.convergence`."""
        if not self.iteration.converged:
            return None
        return f"a step lowers the sum of squares by less than {self._constants.tolerance:g} of it"

    @property
    def records(self) -> dict[str, float]:
        """See `Optimizer.records`."""
        return self.iteration.records

    def objective(self, engine: Engine, scales: Floats, trained: NDArray[np.bool_] | None, last: bool) -> LeastSquares:
        """See `SearchOptimizer.objective`."""
        evidence = last and self._constants.evidence
        return LeastSquares(engine, scales, trained, self._constants.huber, self._penalised, evidence)

    def restart(self) -> None:
        """See `SearchOptimizer.restart`."""
        self.iteration.restart()

    def search(self, theta: Floats, objective: LeastSquares, update: Update, step: int) -> None:
        """See `SearchOptimizer.search`."""
        memory = self.iteration.memory
        if objective.evidence and not memory[EVIDENT]:
            memory[RIDGE], memory[EVIDENT] = self._constants.evidence_ridge, 1.0
        objective.ridge = self.iteration.ridge
        here = objective.at(theta)
        if math.isfinite(here.value):
            if objective.evidence and not self.iteration.ended:
                memory[RIDGE] = objective.evidence_ridge(theta)
            self.iteration.step(theta, here, objective.value)
        else:
            self.restart()
            learn(update, theta, objective.engine.loss_jacobian(theta).gradients, self.adam_lr(step))


class OwnOptimizer(SearchOptimizer):
    """A method of the user's own, which takes the updates of the combination one after another."""

    label = "the optimizer"

    def __init__(self, method: OwnMethod, parameters: int, schedule: Schedule = CONSTANT) -> None:
        super().__init__(method, parameters, 0, schedule)
        self._own = method
        self._arrays = method.memory(parameters)
        self._state |= {f"own.{name}": array for name, array in self._arrays.items()}

    def lr(self, step: int) -> float:
        """See `Optimizer.lr`."""
        return self.adam_lr(step)

    def objective(self, engine: Engine, scales: Floats, trained: NDArray[np.bool_] | None, last: bool) -> Objective:
        """See `SearchOptimizer.objective`."""
        del last
        return Objective(engine, scales, trained)

    def restart(self) -> None:
        """See `SearchOptimizer.restart`: a first-order method goes on."""

    def search(self, theta: Floats, objective: Objective, update: Update, step: int) -> None:
        """See `SearchOptimizer.search`."""
        count = combine(update.combination, objective.at(theta).jacobian.gradients, update.scales, update.updates)
        held = theta[update.held]
        for row in range(count):
            self._own.update(theta, update.updates[row], self.lr(step), self._arrays)
        theta[update.held] = held


def build_optimizer(
    method: Method | OwnMethod,
    parameters: int,
    network: int | None = None,
    schedule: Schedule = CONSTANT,
    retries: bool = False,
) -> Optimizer:
    """Return the optimizer of a method.

    Args:
        method: with its constants.
        parameters: P.
        network: how many of them, the leading ones, are the network's; None for all.
        schedule: of the learning rate.
        retries: whether a failed step is retried half as large from the last parameters that could be solved.
    """
    if isinstance(method, AdamBfgs):
        found: Optimizer = AdamBfgsOptimizer(method, parameters, schedule)
    elif isinstance(method, LevenbergMarquardt):
        found = LeastSquaresOptimizer(method, parameters, parameters if network is None else network, schedule)
    elif isinstance(method, OwnMethod):
        found = OwnOptimizer(method, parameters, schedule)
    else:
        found = Optimizer(method, parameters, schedule)
    if retries:
        found.keep_good()
    return found


def build_update(
    combination: int,
    scales: Sequence[float] | Floats,
    optimizer: Optimizer,
    trained: NDArray[np.bool_] | None = None,
) -> Update:
    """Return the update of a combination, scales `(L,)` and an optimizer, whose memory it shares.

    `trained (P,)` says which parameters change, None for all.
    """
    factors = np.array(scales, dtype=np.float64)
    held = np.empty(0, dtype=np.int64) if trained is None else np.flatnonzero(~trained)
    return Update(
        combination=combination,
        scales=factors,
        optimizer=optimizer.code,
        options=optimizer.options,
        memory=optimizer.memory,
        updates_done=optimizer.count,
        updates=np.empty((factors.size + 1, optimizer.memory.shape[1])),
        limit=optimizer.limit,
        clipped=optimizer.clipped,
        good=optimizer.good,
        held=held,
        kept=np.empty(held.size),
    )
