"""One step of a method, and its derivatives: explicit Runge-Kutta.

A stepper is these functions: `attempt` takes a trial step and records it, `accept` moves to its end, `interpolate`
gives the outputs in it; `pull_back_step` takes cotangents through a recorded step, and `start_push`, `push_step`,
`push_output` and `end_push` take sensitivities. The solve, the adjoint and the forward ways know nothing else of the
method, so that another kind of method is another file with these functions.
"""

import math
from typing import NamedTuple

import numpy as np

from eigenode_cli.engines.compiled.algebra import add_scaled, all_finite, clear, combine, copy
from eigenode_cli.engines.compiled.bars import pull_back_field, push_field, start_sensitivities
from eigenode_cli.engines.compiled.drive import set_drive
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.mlp import evaluate_field
from eigenode_cli.jit import njit_inner


class Method(NamedTuple):
    """A tableau and the controller's settings, as the kernels read them; arrays by their addresses.

    Attributes:
        stages, order: number of stages s, and order of the solution.
        a, transposed: stage coefficients `(s, s)` and their transpose.
        nodes: times of the stages `(s,)`, as fractions of the step.
        error, dense: weights `(s,)` and `(s, 4)`, as in `solve.tableau.Tableau`.
        rtol, atol, max_steps: of the controller; not read where steps are given.
    """

    stages: int
    order: int
    a: int
    transposed: int
    nodes: int
    error: int
    dense: int
    rtol: float
    atol: float
    max_steps: int


class Steps(NamedTuple):
    """Addresses of a record of the accepted steps and of the outputs in each.

    Attributes:
        capacity: steps that there is room for.
        size: of each step in s `(capacity,)`.
        record: what every evaluation left `(1 + (s - 1) capacity, width)`: stage j of step i is number i (s - 1) + j.
        width: size of one record, or 0 to keep none: then there is room for one, which every evaluation overwrites.
        output_step: index of the step that each output lies in `(N,)`, -1 for the initial state.
        output_weights: `x(t) = x_i + h_i sum_j output_weights[o, j] k_j`, `(N, s)`.
        k: derivatives at the stages of one step `(s, n)`.
        x, trial, error: states of one step `(n,)`.
    """

    capacity: int
    size: int
    record: int
    width: int
    output_step: int
    output_weights: int
    k: int
    x: int
    trial: int
    error: int


@njit_inner
def attempt(net, drive, method, steps, t, h, step):
    """One trial step of size `h` from time `t`: fills stages 1 ... s-1, their records, and `steps.trial`.

    Returns the error in units of the tolerance, infinite if the trial is not finite.
    """
    n, stages = net.n, method.stages
    x, trial, error, k = doubles(steps.x, 0), doubles(steps.trial, 0), doubles(steps.error, 0), doubles(steps.k, 0)
    for j in range(1, stages):
        combine(n, j, x, h, doubles(method.a, j * stages), k, trial)
        record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
        set_drive(drive, t + doubles(method.nodes, j)[0] * h)
        evaluate_field(net, trial, record, shift(k, j * n))
    clear(n, error)
    combine(n, stages, error, h, doubles(method.error, 0), k, error)
    # the last stage need not enter the estimate, and the error relative to an infinite state is finite
    if not (all_finite(n, error) and all_finite(n, trial) and all_finite(n, shift(k, (stages - 1) * n))):
        return math.inf
    total = 0.0
    for i in range(n):
        part = error[i] / (method.atol + method.rtol * max(abs(x[i]), abs(trial[i])))
        total += part * part
    return np.sqrt(total / n)


@njit_inner
def interpolate(n, method, steps, t, after, h, step, output, count, times, states):
    """Fill `states` at all output times from number `output` on that lie in the step from `t` to `after`.

    The weights that the pullback needs go to `steps`. Returns the number of the first output behind the step.
    """
    stages = method.stages
    while output < count and times[output] <= after:
        fraction = (times[output] - t) / h
        weights = doubles(steps.output_weights, output * stages)
        for j in range(stages):
            d = doubles(method.dense, j * 4)
            weights[j] = fraction * (d[0] + fraction * (d[1] + fraction * (d[2] + fraction * d[3])))
        combine(n, stages, doubles(steps.x, 0), h, weights, doubles(steps.k, 0), shift(states, output * n))
        integers(steps.output_step, 0)[output] = step
        output += 1
    return output


@njit_inner
def accept(n, method, steps):
    """Move to the end of the step that was tried: its state and derivative are those of the next one's start."""
    k = doubles(steps.k, 0)
    copy(n, doubles(steps.trial, 0), doubles(steps.x, 0))
    copy(n, shift(k, (method.stages - 1) * n), k)


@njit_inner
def pull_back_step(net, method, steps, bars, channels, step):
    """Pull the cotangents of all channels back from the end of a recorded step to its start.

    Stage j of a step from x: `X_j = x + h sum_(l<j) a_jl k_l`, `k_j = f(X_j)`; the last one is the state at the end
    and the first one of the next step. Backwards, with bars for cotangents: `bar k_j = (outputs, next step) + h
    sum_(l>j) a_lj bar X_l`, `bar X_j = (df/dx)^T bar k_j`, `bar x = (outputs) + sum_j bar X_j`.

    `bars.start` and `bars.stage_rates` hold what the outputs in the step put there, `bars.carried` the cotangent of the
    derivative at its end, and the place of stage 0 in `bars.stage_states`, which no stage reads, that of its state.
    """
    q, stages, h = channels * net.n, method.stages, doubles(steps.size, 0)[step]
    rates, states = doubles(bars.stage_rates, 0), doubles(bars.stage_states, 0)
    start, carried, end = doubles(bars.start, 0), doubles(bars.carried, 0), states
    add_scaled(q, 1.0, carried, shift(rates, (stages - 1) * q))
    for j in range(stages - 1, 0, -1):
        rate, state, behind = shift(rates, j * q), shift(states, j * q), stages - 1 - j
        weights = doubles(method.transposed, j * stages + j + 1)
        combine(q, behind, rate, h, weights, shift(state, q), rate)
        record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
        pull_back_field(net, record, bars, channels, rate, state)
        if j == stages - 1:
            add_scaled(q, 1.0, end, state)
        add_scaled(q, 1.0, state, start)
    combine(q, stages - 1, rates, h, doubles(method.transposed, 1), shift(states, q), carried)
    copy(q, start, end)


@njit_inner
def start_push(net, steps, bars):
    """Fill the sensitivities of the initial state, and of the derivative there."""
    state = doubles(bars.tangent_state, 0)
    start_sensitivities(net, bars, state)
    push_field(net, doubles(steps.record, 0), bars, state, doubles(bars.tangent_k, 0))


@njit_inner
def push_step(net, method, steps, bars, step):
    """Carry the sensitivities from the start of a recorded step through its stages."""
    stages, length, h = method.stages, net.n * net.size, doubles(steps.size, 0)[step]
    state, stage, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_stage, 0), doubles(bars.tangent_k, 0)
    for j in range(1, stages):
        combine(length, j, state, h, doubles(method.a, j * stages), k, stage)
        record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
        push_field(net, record, bars, stage, shift(k, j * length))


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
    copy(length, shift(k, (method.stages - 1) * length), k)
