"""One training step behind the loss Jacobian: combination and optimizer, as one compiled function."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.jit import njit
from eigenode_cli.training.combine import SEQUENTIAL_REPEATING_LAST, combine
from eigenode_cli.training.optimizers import Optimizer, take_update

Floats = NDArray[np.float64]


class Rule(NamedTuple):
    """How the gradients `(L, P)` of a training step change the parameters.

    Attributes:
        combination: code of `combine`.
        scales: factor of each gradient `(L,)`.
        optimizer, options, memory, updates_done: as in `optimizer.take_update`, the last its `count`.
        updates: working space `(L + 1, P)`.
    """

    combination: int
    scales: Floats
    optimizer: int
    options: Floats
    memory: Floats
    updates_done: Floats
    updates: Floats


def build_rule(combination: int, scales: Sequence[float] | Floats, optimizer: Optimizer) -> Rule:
    """The rule of a combination, scales `(L,)` and an optimizer, whose memory it shares."""
    factors = np.array(scales, dtype=np.float64)
    return Rule(
        combination=combination,
        scales=factors,
        optimizer=optimizer.code,
        options=optimizer.options,
        memory=optimizer.memory,
        updates_done=optimizer.count,
        updates=np.empty((factors.size + 1, optimizer.memory.shape[1])),
    )


@njit
def learn(rule, theta, gradients, lr):
    """Change `theta (P,)` in place by the updates that `gradients (L, P)` make at the learning rate `lr`.

    `SEQUENTIAL_REPEATING_LAST` adds the last step, the change of theta by the last update, once more. The optimizer's
    memory does not see that.
    """
    count = combine(rule.combination, gradients, rule.scales, rule.updates)
    before = rule.updates[count]  # behind the updates, so it is free
    for row in range(count):
        before[:] = theta
        take_update(rule.optimizer, theta, rule.updates[row], lr, rule.options, rule.memory, rule.updates_done)
    if count > 0 and rule.combination == SEQUENTIAL_REPEATING_LAST:
        for i in range(theta.size):
            theta[i] += theta[i] - before[i]
