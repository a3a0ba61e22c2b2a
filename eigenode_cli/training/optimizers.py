"""Optimizers on a flat parameter vector.

Their updates are compiled (`engines.first_order`), so that the compiled engine can take whole training steps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.first_order import ADAM, SGD, take_update
from eigenode_cli.engines.update import Update
from eigenode_cli.training.bfgs import Bfgs


@dataclass(frozen=True)
class Method:
    """What every first-order method has: a learning rate, constant or decaying.

    Attributes:
        lr: learning rate; with a schedule the one that it ends at: `lr + lr_extra exp(-lr_rate k)` at training step k.
        lr_extra: what is added to the learning rate at first.
        lr_rate: how fast that decays, per training step.
        lr_every: training steps between changes of the learning rate.
    """

    lr: float = 1e-3
    lr_extra: float = 0.0
    lr_rate: float = 0.0
    lr_every: int = 1

    def learning_rate(self, step: int) -> float:
        """Return the learning rate of training step `step`."""
        return self.lr + self.lr_extra * math.exp(-self.lr_rate * (step - step % self.lr_every))


@dataclass(frozen=True)
class Adam(Method):
    """D. P. Kingma, J. Ba, Adam: a method for stochastic optimization, ICLR 2015, Algorithm 1.

    https://arxiv.org/abs/1412.6980
    """

    beta1: float = 0.9
    beta2: float = 0.999
    eps: float = 1e-8


@dataclass(frozen=True)
class Sgd(Method):
    """Gradient descent with heavy-ball momentum, in the form of torch.optim.SGD."""

    momentum: float = 0.0


@dataclass(frozen=True)
class AdamBfgs(Adam):
    """Adam, then BFGS with a line search on the sum of the scaled terms.

    Attributes:
        adam_steps: leading training steps that Adam takes.
    """

    adam_steps: int = 1000


class Optimizer:
    """Turns one update after another into new parameters.

    Args:
        method: which one, with its constants.
        parameters: P.

    Attributes:
        code, options, memory, count: as in `take_update`.

    Raises:
        TypeError: there is no such method.
    """

    def __init__(self, method: Method, parameters: int) -> None:
        self._method = method
        self.count = np.zeros(1)
        if isinstance(method, Adam):
            self.code, names = ADAM, ("first_moment", "second_moment")
            self.options = np.array([method.beta1, method.beta2, method.eps])
        elif isinstance(method, Sgd):
            self.code, names = SGD, ("velocity",)
            self.options = np.array([method.momentum])
        else:
            raise TypeError(f"{type(method).__name__}: no such optimizer")
        self.memory = np.zeros((len(names), parameters))
        self._state = dict(zip(names, self.memory, strict=True)) | {"count": self.count}

    def lr(self, step: int) -> float:
        """Return the learning rate of training step `step`; a step may take several updates."""
        return self._method.learning_rate(step)

    def update(self, theta: Floats, gradient: Floats, lr: float) -> None:
        """Change `theta (P,)` in place by one step of rate `lr` against `gradient (P,)`."""
        take_update(self.code, theta, gradient, lr, self.options, self.memory, self.count)

    def state(self) -> dict[str, Floats]:
        """Return everything that the next update depends on, by name; the arrays themselves, not copies."""
        return self._state


class AdamBfgsOptimizer(Optimizer):
    """Adam first, then BFGS: the first passes jumps and kinks of the terms, the second converges.

    The trainer hands BFGS whole functions (`Bfgs.step`). Adam's update is there at any time: it also leads out of where
    the function has no value.

    Attributes:
        switch: number of the first training step of BFGS.
        bfgs: the second part.
    """

    def __init__(self, method: AdamBfgs, parameters: int) -> None:
        super().__init__(method, parameters)
        self.switch = method.adam_steps
        self.bfgs = Bfgs(parameters)
        self._state |= self.bfgs.state()

    def lr(self, step: int) -> float:
        """Learning rate of Adam; NaN at the steps of BFGS, which has none."""
        return math.nan if step >= self.switch else self.adam_lr(step)

    def adam_lr(self, step: int) -> float:
        """Learning rate of Adam at any step."""
        return super().lr(step)


def build_optimizer(method: Method, parameters: int) -> Optimizer:
    """Return the optimizer of a method for a vector of `parameters`."""
    return AdamBfgsOptimizer(method, parameters) if isinstance(method, AdamBfgs) else Optimizer(method, parameters)


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
        held=held,
        kept=np.empty(held.size),
    )
