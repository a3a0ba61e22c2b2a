"""Updates of first-order optimizers on a flat parameter vector, as compiled functions.

They are a few lines each and are held against torch.optim by the tests. torch's own cost more than the compiled
engine's loss Jacobian (about 30 us an update at 129 parameters, five updates a step), and they could not be part of
its training loop.
"""

import numpy as np

from eigenode_cli.jit import njit

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
