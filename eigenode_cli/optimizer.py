"""Optimizers on a flat parameter vector.

They are a few lines each and are held against torch.optim by the tests; torch's own cost more than the compiled
engine's loss Jacobian (about 30 us an update at 129 parameters, five updates a step).
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.bfgs import Bfgs
from eigenode_cli.config.schema import AdamBfgsConfig, AdamConfig, OptimizerConfig, SgdConfig
from eigenode_cli.jit import njit

Floats = NDArray[np.float64]


@njit
def _adam(theta, gradient, first, second, count, lr, beta1, beta2, eps):
    bias1, bias2 = 1.0 - beta1**count, 1.0 - beta2**count
    for i in range(theta.size):
        first[i] = beta1 * first[i] + (1.0 - beta1) * gradient[i]
        second[i] = beta2 * second[i] + (1.0 - beta2) * gradient[i] * gradient[i]
        theta[i] -= lr / bias1 * first[i] / (np.sqrt(second[i] / bias2) + eps)


@njit
def _momentum(theta, gradient, velocity, lr, momentum):
    for i in range(theta.size):
        velocity[i] = momentum * velocity[i] + gradient[i]
        theta[i] -= lr * velocity[i]


def learning_rate(config: OptimizerConfig, step: int) -> float:
    """Learning rate of training step k: `lr + lr_extra exp(-lr_rate k)`, set anew every `lr_every` steps."""
    return config.lr + config.lr_extra * math.exp(-config.lr_rate * (step - step % config.lr_every))


class Optimizer(Protocol):
    """Turns one update after another into new parameters."""

    lr: float

    def begin(self, step: int) -> None:
        """Set the learning rate of training step `step`; a step may take several updates."""
        ...

    def update(self, theta: Floats, gradient: Floats) -> None:
        """Change `theta (P,)` in place by one step against `gradient (P,)`."""
        ...

    def state(self) -> dict[str, Floats]:
        """Everything that the next update depends on, by name; the arrays themselves, not copies."""
        ...


class Adam:
    """D. P. Kingma, J. Ba, Adam: a method for stochastic optimization, ICLR 2015, Algorithm 1."""

    def __init__(self, config: AdamConfig, parameters: int) -> None:
        self._config = config
        self.lr = learning_rate(config, 0)
        self._options = (config.beta1, config.beta2, config.eps)
        self._first, self._second = np.zeros(parameters), np.zeros(parameters)
        self._count = np.zeros(1)

    def begin(self, step: int) -> None:
        """See `Optimizer.begin`."""
        self.lr = learning_rate(self._config, step)

    def update(self, theta: Floats, gradient: Floats) -> None:
        """See `Optimizer.update`."""
        self._count += 1.0
        _adam(theta, gradient, self._first, self._second, self._count[0], self.lr, *self._options)

    def state(self) -> dict[str, Floats]:
        """See `Optimizer.state`."""
        return {"first_moment": self._first, "second_moment": self._second, "count": self._count}


class Sgd:
    """Gradient descent with heavy-ball momentum, in the form of torch.optim.SGD."""

    def __init__(self, config: SgdConfig, parameters: int) -> None:
        self._config = config
        self.lr = learning_rate(config, 0)
        self._momentum = config.momentum
        self._velocity = np.zeros(parameters)

    def begin(self, step: int) -> None:
        """See `Optimizer.begin`."""
        self.lr = learning_rate(self._config, step)

    def update(self, theta: Floats, gradient: Floats) -> None:
        """See `Optimizer.update`."""
        _momentum(theta, gradient, self._velocity, self.lr, self._momentum)

    def state(self) -> dict[str, Floats]:
        """See `Optimizer.state`."""
        return {"velocity": self._velocity}


class AdamBfgs:
    """Adam first, then BFGS: the first passes jumps and kinks of the terms, the second converges.

    The trainer hands BFGS whole functions (`Bfgs.step`). `update` is Adam's at any time: it also leads out of where
    the function has no value.

    Attributes:
        lr: of Adam; NaN while BFGS, which has none, is at work.
        bfgs: the second part.
    """

    def __init__(self, config: AdamBfgsConfig, parameters: int) -> None:
        self._adam = Adam(config, parameters)
        self._switch = config.adam_steps
        self.bfgs = Bfgs(parameters)
        self.begin(0)

    def searches(self, step: int) -> bool:
        """Whether training step `step` is one of BFGS."""
        return step >= self._switch

    def begin(self, step: int) -> None:
        """See `Optimizer.begin`."""
        self._adam.begin(step)
        self.lr = math.nan if self.searches(step) else self._adam.lr

    def update(self, theta: Floats, gradient: Floats) -> None:
        """See `Optimizer.update`."""
        self._adam.update(theta, gradient)

    def state(self) -> dict[str, Floats]:
        """See `Optimizer.state`."""
        return self._adam.state() | self.bfgs.state()


def build_optimizer(config: OptimizerConfig, parameters: int) -> Optimizer:
    """The optimizer for a vector of `parameters`."""
    if isinstance(config, AdamBfgsConfig):
        return AdamBfgs(config, parameters)
    if isinstance(config, AdamConfig):
        return Adam(config, parameters)
    if isinstance(config, SgdConfig):
        return Sgd(config, parameters)
    raise ValueError(f"optimizer={config.name}: no such optimizer")
