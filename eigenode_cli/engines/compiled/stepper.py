"""One step of a method, and its derivatives: explicit Runge-Kutta, Rosenbrock, or both by turns.

A stepper is these functions: `attempt` takes a trial step and records it, `accept` moves to its end, `interpolate`
gives the outputs in it; `pull_back_step` takes cotangents through a recorded step, and `start_push`, `push_step`,
`push_output` and `end_push` take sensitivities. The solve, the adjoint and the forward ways know nothing else of the
method. In all methods stages k are such that `x(t) = x + h sum_j weights_j k_j` inside a step.
"""

import math

import numpy as np

from eigenode_cli.engines.compiled.algebra import all_finite, combine, copy
from eigenode_cli.engines.compiled.bars import push_field, start_sensitivities
from eigenode_cli.engines.compiled.explicit import attempt_explicit, fastest_explicit, pull_back_explicit, push_explicit
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.method import EXPLICIT, is_implicit
from eigenode_cli.engines.compiled.rosenbrock import (
    attempt_rosenbrock,
    fastest_rosenbrock,
    pull_back_rosenbrock,
    push_rosenbrock,
)
from eigenode_cli.jit import njit_inner


@njit_inner
def attempt(net, drive, method, steps, t, h, step):
    """One trial step of size `h` from time `t`: fills stages, their records, and `steps.trial`.

    Returns the error in units of the tolerance, infinite if the trial is not finite.
    """
    n, last = net.n, method.explicit.stages - 1
    x, trial, error, k = doubles(steps.x, 0), doubles(steps.trial, 0), doubles(steps.error, 0), doubles(steps.k, 0)
    if is_implicit(steps, step):
        last = method.implicit.stages - 1
        if not attempt_rosenbrock(net, drive, method, steps, t, h, step):
            return math.inf
    else:
        attempt_explicit(net, drive, method, steps, t, h, step)
    # the last stage need not enter the estimate, and the error relative to an infinite state is finite
    if not (all_finite(n, error) and all_finite(n, trial) and all_finite(n, shift(k, last * n))):
        return math.inf
    total = 0.0
    for i in range(n):
        part = error[i] / (method.atol + method.rtol * max(abs(x[i]), abs(trial[i])))
        total += part * part
    return np.sqrt(total / n)


@njit_inner
def order_of(method, implicit):
    """Order of the method for the step-size control."""
    return method.implicit.order if implicit else method.explicit.order


@njit_inner
def fastest(net, method, steps, h, step):
    """Estimate the largest modulus of the spectrum in 1/s on the step that was tried last."""
    if is_implicit(steps, step):
        return fastest_rosenbrock(net, steps)
    return fastest_explicit(net, method, steps, h)


@njit_inner
def interpolate(n, method, steps, t, after, h, step, output, count, times, states):
    """Fill `states` at all output times from number `output` on that lie in the step from `t` to `after`.

    The weights that the pullback needs go to `steps`. Returns the number of the first output behind the step.
    """
    stages, dense = method.explicit.stages, doubles(method.explicit.dense, 0)
    if is_implicit(steps, step):
        stages, dense = method.implicit.stages, doubles(method.implicit.dense, 0)
    while output < count and times[output] <= after:
        fraction = (times[output] - t) / h
        weights = doubles(steps.output_weights, output * method.stages)
        for j in range(method.stages):
            weights[j] = 0.0
        for j in range(stages):
            d = shift(dense, j * 4)
            weights[j] = fraction * (d[0] + fraction * (d[1] + fraction * (d[2] + fraction * d[3])))
        combine(n, stages, doubles(steps.x, 0), h, weights, doubles(steps.k, 0), shift(states, output * n))
        integers(steps.output_step, 0)[output] = step
        output += 1
    return output


@njit_inner
def accept(n, method, steps):
    """Move to the end of the step that was tried: its state, and the derivative there where the next one starts so."""
    k = doubles(steps.k, 0)
    copy(n, doubles(steps.trial, 0), doubles(steps.x, 0))
    if method.kind == EXPLICIT:
        copy(n, shift(k, (method.stages - 1) * n), k)


@njit_inner
def pull_back_step(net, method, steps, bars, channels, step):
    """Pull the cotangents of all channels back from the end of a recorded step to its start.

    `bars.start` and `bars.stage_rates` hold what the outputs in the step put there, `bars.carried` the cotangent of the
    derivative at its end, and the place of stage 0 in `bars.stage_states`, which no stage reads, that of its state.
    """
    if is_implicit(steps, step):
        pull_back_rosenbrock(net, method, steps, bars, channels, step)
    else:
        pull_back_explicit(net, method, steps, bars, channels, step)


@njit_inner
def start_push(net, steps, bars):
    """Fill the sensitivities of the initial state, and of the derivative there."""
    state = doubles(bars.tangent_state, 0)
    start_sensitivities(net, bars, state)
    push_field(net, doubles(steps.record, 0), bars, state, doubles(bars.tangent_k, 0))


@njit_inner
def push_step(net, method, steps, bars, step):
    """Carry the sensitivities from the start of a recorded step through its stages to its end."""
    if is_implicit(steps, step):
        push_rosenbrock(net, method, steps, bars, step)
    else:
        push_explicit(net, method, steps, bars, step)


@njit_inner
def push_output(net, method, steps, bars, h, output):
    """Fill `bars.tangent_output (n, P)` with the sensitivity of an output in the step that was pushed."""
    state, k, here = doubles(bars.tangent_state, 0), doubles(bars.tangent_k, 0), doubles(bars.tangent_output, 0)
    weights = doubles(steps.output_weights, output * method.stages)
    combine(net.n * net.size, method.stages, state, h, weights, k, here)


@njit_inner
def end_push(net, method, bars):
    """Move to the end of the step that was pushed."""
    length, k = net.n * net.size, doubles(bars.tangent_k, 0)
    copy(length, doubles(bars.tangent_stage, 0), doubles(bars.tangent_state, 0))
    if method.kind == EXPLICIT:
        copy(length, shift(k, (method.stages - 1) * length), k)
