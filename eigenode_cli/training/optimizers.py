"""Optimizers on a flat parameter vector.

They are a few lines each and are held against torch.optim by the tests; torch's own cost more than the compiled
engine's loss Jacobian (about 30 us an update at 129 parameters, five updates a step), and they could not be part of
its training loop.
"""

import math

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.config.schema import AdamBfgsConfig, AdamConfig, OptimizerConfig, SgdConfig
from eigenode_cli.jit import njit
from eigenode_cli.training.bfgs import Bfgs

Floats = NDArray[np.float64]

ADAM, SGD = range(2)


@njit
def take_update(optimizer, theta, gradient, lr, options, memory, count):
    """Change `theta (P,)` in place by one step against `gradient (P,)`.

    Args:
        optimizer: code; options: its constants.
        lr: learning rate.
        memory: moments or velocity, a row each `(., P)`; count: number of updates so far `(1,)`. Both go on.
    """
    count[0] += 1.0
    if optimizer == ADAM:
        _adam(theta, gradient, memory[0], memory[1], count[0], lr, options[0], options[1], options[2])
    else:
        _momentum(theta, gradient, memory[0], lr, options[0])


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


class Optimizer:
    """Turns one update after another into new parameters.

    `adam`: D. P. Kingma, J. Ba, Adam: a method for stochastic optimization, ICLR 2015, Algorithm 1. `sgd`: gradient
    descent with heavy-ball momentum, in the form of torch.optim.SGD.

    Args:
        config: which one, with its constants.
        parameters: P.

    Attributes:
        code, options, memory, count: as in `take_update`.
    """

    def __init__(self, config: OptimizerConfig, parameters: int) -> None:
        self._config = config
        self.count = np.zeros(1)
        if isinstance(config, AdamConfig):
            self.code, names = ADAM, ("first_moment", "second_moment")
            self.options = np.array([config.beta1, config.beta2, config.eps])
        elif isinstance(config, SgdConfig):
            self.code, names = SGD, ("velocity",)
            self.options = np.array([config.momentum])
        else:
            raise ValueError(f"optimizer={config.name}: no such optimizer")
        self.memory = np.zeros((len(names), parameters))
        self._state = dict(zip(names, self.memory, strict=True)) | {"count": self.count}

    def lr(self, step: int) -> float:
        """Learning rate of training step `step`; a step may take several updates."""
        return learning_rate(self._config, step)

    def update(self, theta: Floats, gradient: Floats, lr: float) -> None:
        """Change `theta (P,)` in place by one step of rate `lr` against `gradient (P,)`."""
        take_update(self.code, theta, gradient, lr, self.options, self.memory, self.count)

    def state(self) -> dict[str, Floats]:
        """Everything that the next update depends on, by name; the arrays themselves, not copies."""
        return self._state


class AdamBfgs(Optimizer):
    """Adam first, then BFGS: the first passes jumps and kinks of the terms, the second converges.

    The trainer hands BFGS whole functions (`Bfgs.step`). Adam's update is there at any time: it also leads out of where
    the function has no value.

    Attributes:
        switch: number of the first training step of BFGS.
        bfgs: the second part.
    """

    def __init__(self, config: AdamBfgsConfig, parameters: int) -> None:
        super().__init__(config, parameters)
        self.switch = config.adam_steps
        self.bfgs = Bfgs(parameters)
        self._state |= self.bfgs.state()

    def lr(self, step: int) -> float:
        """Learning rate of Adam; NaN at the steps of BFGS, which has none."""
        return math.nan if step >= self.switch else self.adam_lr(step)

    def adam_lr(self, step: int) -> float:
        """Learning rate of Adam at any step."""
        return super().lr(step)


def build_optimizer(config: OptimizerConfig, parameters: int) -> Optimizer:
    """The optimizer for a vector of `parameters`."""
    return AdamBfgs(config, parameters) if isinstance(config, AdamBfgsConfig) else Optimizer(config, parameters)
