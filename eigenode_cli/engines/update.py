"""One training step behind the loss Jacobian: combination and optimizer, as one compiled function."""

import math
from typing import NamedTuple

import numpy as np

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.engines.combine import SEQUENTIAL_REPEATING_LAST, combine
from eigenode_cli.engines.first_order import take_update
from eigenode_cli.jit import njit

GROW = 1.1
"""Factor of a learning rate that was halved, with every step that succeeds, until it is whole again."""


class Update(NamedTuple):
    """How the gradients `(L, P)` of a training step change the parameters.

    Attributes:
        combination: code of `combine`.
        scales: factor of each gradient `(L,)`.
        optimizer, options, memory, updates_done: as in `first_order.take_update`, the last its `count`.
        updates: working space `(L + 1, P)`.
        limit: largest norm of an update's gradient, infinite for any; `clipped` how many were shortened to it `(1,)`.
        good: the last parameters whose solve succeeded, and the present factor of the learning rate, zero before there
            are any `(P + 1,)`; empty where nothing goes back to them.
        held: indices of the parameters that stay as they are `(H,)`; `kept` working space for them `(H,)`.
    """

    combination: int
    scales: Floats
    optimizer: int
    options: Floats
    memory: Floats
    updates_done: Floats
    updates: Floats
    limit: float
    clipped: Floats
    good: Floats
    held: Integers
    kept: Floats


@njit
def train_step(update, theta, gradients, lr, solved):
    """Change `theta (P,)` by one training step: `learn`, or half of the way back where the solve failed.

    Where the last good parameters are kept, a failed step is retried half as large from there, until the solve
    succeeds. The optimizer's first moment, which led there, starts again from zero, and the learning rate is half as
    large from then on, to grow again by a tenth with each step that succeeds.

    Args:
        update, theta, gradients, lr: as in `learn`.
        solved: whether the solve at theta succeeded.
    """
    if update.good.size > 0:
        last = update.good.size - 1
        if solved:
            update.good[:last] = theta
            update.good[last] = min(1.0, GROW * update.good[last]) if update.good[last] > 0.0 else 1.0
            lr *= update.good[last]
        elif update.good[last] > 0.0:
            update.good[last] *= 0.5
            for i in range(last):
                theta[i] = 0.5 * (theta[i] + update.good[i])
            if update.memory.shape[0] > 0:
                update.memory[0, :] = 0.0
            return
    learn(update, theta, gradients, lr)


@njit
def _clip(update, gradient):
    """Shorten a gradient `(P,)` that is longer than the limit."""
    norm = np.sqrt((gradient * gradient).sum())
    if norm > update.limit:
        gradient *= update.limit / norm
        update.clipped[0] += 1.0


@njit
def learn(update, theta, gradients, lr):
    """Change `theta (P,)` in place by the updates that `gradients (L, P)` make at the learning rate `lr`.

    `SEQUENTIAL_REPEATING_LAST` adds the last step, the change of theta by the last update, once more. The optimizer's
    memory does not see that.
    """
    count = combine(update.combination, gradients, update.scales, update.updates)
    before = update.updates[count]  # behind the updates, so it is free
    for i in range(update.held.size):
        update.kept[i] = theta[update.held[i]]
    for row in range(count):
        before[:] = theta
        if update.limit < math.inf:
            _clip(update, update.updates[row])
        take_update(
            update.optimizer, theta, update.updates[row], lr, update.options, update.memory, update.updates_done
        )
    if count > 0 and update.combination == SEQUENTIAL_REPEATING_LAST:
        for i in range(theta.size):
            theta[i] += theta[i] - before[i]
    for i in range(update.held.size):
        theta[update.held[i]] = update.kept[i]
