"""One training step behind the loss Jacobian: combination and optimizer, as one compiled function."""

from typing import NamedTuple

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.engines.combine import SEQUENTIAL_REPEATING_LAST, combine
from eigenode_cli.engines.first_order import take_update
from eigenode_cli.jit import njit


class Update(NamedTuple):
    """How the gradients `(L, P)` of a training step change the parameters.

    Attributes:
        combination: code of `combine`.
        scales: factor of each gradient `(L,)`.
        optimizer, options, memory, updates_done: as in `first_order.take_update`, the last its `count`.
        updates: working space `(L + 1, P)`.
        held: indices of the parameters that stay as they are `(H,)`; `kept` working space for them `(H,)`.
    """

    combination: int
    scales: Floats
    optimizer: int
    options: Floats
    memory: Floats
    updates_done: Floats
    updates: Floats
    held: Integers
    kept: Floats


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
        take_update(
            update.optimizer, theta, update.updates[row], lr, update.options, update.memory, update.updates_done
        )
    if count > 0 and update.combination == SEQUENTIAL_REPEATING_LAST:
        for i in range(theta.size):
            theta[i] += theta[i] - before[i]
    for i in range(update.held.size):
        theta[update.held[i]] = update.kept[i]
