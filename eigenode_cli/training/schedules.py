"""Schedules: how the learning rate changes with the training steps."""

import math
from dataclasses import dataclass

from eigenode_cli.arrays import Floats


@dataclass(frozen=True)
class Schedule:
    """A constant learning rate, and what all schedules can do."""

    def rate(self, lr: float, step: int) -> float:
        """Return the learning rate of training step `step`, of an optimizer whose own is `lr`."""
        del step
        return lr

    def observe(self, memory: Floats, value: float) -> None:
        """Take note of a record.

        Args:
            memory: factor of the learning rate from here on, lowest value so far, records since it `(3,)`; changed in
                place, and kept with the optimizer's state.
            value: sum of the scaled terms at the record, infinite where it is not defined.
        """


@dataclass(frozen=True)
class Exponential(Schedule):
    """`lr + extra exp(-rate k)` at training step k.

    Attributes:
        extra: what is added to the learning rate at first.
        decay: how fast that decays, per training step.
        every: training steps between changes.
    """

    extra: float = 0.0
    decay: float = 0.0
    every: int = 1

    def rate(self, lr: float, step: int) -> float:
        """See `Schedule.rate`."""
        return lr + self.extra * math.exp(-self.decay * (step - step % self.every))


@dataclass(frozen=True)
class Cosine(Schedule):
    """Half a cosine from the learning rate down to a share of it.

    I. Loshchilov, F. Hutter, SGDR: stochastic gradient descent with warm restarts, ICLR 2017, Equ. 5, without restarts.
    https://arxiv.org/abs/1608.03983

    Attributes:
        steps: training steps that it takes; behind them the rate stays.
        final: learning rate at the end, as a share of the first.
    """

    steps: int = 5000
    final: float = 0.0

    def rate(self, lr: float, step: int) -> float:
        """See `Schedule.rate`."""
        fraction = min(step / max(1, self.steps - 1), 1.0)
        return lr * (self.final + 0.5 * (1.0 - self.final) * (1.0 + math.cos(math.pi * fraction)))


@dataclass(frozen=True)
class Plateau(Schedule):
    """Smaller whenever the sum of the scaled terms has not fallen for some records.

    Attributes:
        factor: of the learning rate at each plateau.
        patience: records without a new lowest value that make a plateau.
        smallest: smallest learning rate, as a share of the first.
    """

    factor: float = 0.5
    patience: int = 20
    smallest: float = 1e-3

    def observe(self, memory: Floats, value: float) -> None:
        """See `Schedule.observe`."""
        if value < memory[1]:
            memory[1:] = value, 0.0
            return
        memory[2] += 1.0
        if memory[2] >= self.patience:
            memory[0] = max(memory[0] * self.factor, self.smallest)
            memory[2] = 0.0
