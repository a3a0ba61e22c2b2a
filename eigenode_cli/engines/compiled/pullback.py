"""Cotangents of the trajectory pulled back to the parameters through the recorded steps, all terms at once.

Two ways, exact derivatives of the same steps, so they agree to round-off: the discrete adjoint (backpropagation
through the steps and their dense output) and forward sensitivities (the paper's Equ. multigrad: one Jacobian of the
solution, shared by all terms). Step sizes count as constants.
"""

from typing import NamedTuple

from eigenode_cli.engines.compiled.algebra import BLOCK, add_rows, add_scaled, any_nonzero, clear, combine, copy
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.mlp import pull_back_outputs
from eigenode_cli.jit import njit_inner


class Bars(NamedTuple):
    """Addresses of the working space of both ways, for at most L channels, s stages, n states, m outputs, P parameters.

    A channel is a term whose cotangents are not all zero: the others are left out from the start, and arrays have the
    strides of the C channels that there are.

    Attributes:
        states: cotangents of the trajectory `(N, C n)`.
        packed: gradients in the order that they are gathered in (`algebra.add_outer`) `(C, P)`.
        stage_rates, stage_states: cotangents of the stages' derivatives and states `(s, C n)`.
        start: cotangent of the state at the step's start `(C n,)`; `carried` that of the derivative at its end.
        seeds: unit vectors `(m, m)`.
        rows_x: derivatives of the outputs in the state `(m, n)`.
        waiting: number of rows that wait to be gathered `(1,)`.
        rows: these rows `(BLOCK, stride)`; `factors` of each channel `(BLOCK, C)`.
        stride: P in whole cache lines.
        scratch: of the network's pullbacks `(2, widest)`.
        tangent_state, tangent_stage, tangent_output, tangent_k: forward sensitivities of a state, of a stage and of an
            output `(n, P)`, of the stages' derivatives `(s, n, P)`.
        unknown, unknown_count: indices of the initial state's trained entries; their parameters are the last ones.
    """

    states: int
    packed: int
    stage_rates: int
    stage_states: int
    start: int
    carried: int
    seeds: int
    rows_x: int
    waiting: int
    rows: int
    factors: int
    stride: int
    scratch: int
    tangent_state: int
    tangent_stage: int
    tangent_k: int
    tangent_output: int
    unknown: int
    unknown_count: int


@njit_inner
def next_row(net, bars, channels):
    """Number of a new row of zeros among those that wait, after a full block has been gathered.

    A row is the derivative of one number in the parameters. Where several channels need it, each with its factor, it
    is made once and waits until there are enough for one product of matrices.
    """
    waiting = integers(bars.waiting, 0)
    if waiting[0] == BLOCK:
        gather_rows(net, bars, channels)
    row = waiting[0]
    clear(net.size, doubles(bars.rows, row * bars.stride))
    waiting[0] = row + 1
    return row


@njit_inner
def gather_rows(net, bars, channels):
    """Add the rows that wait, times their factors, to the gradients of all channels."""
    waiting = integers(bars.waiting, 0)
    for c in range(channels):
        factors, gradient = doubles(bars.factors, c), doubles(bars.packed, c * net.size)
        add_rows(waiting[0], net.size, bars.stride, factors, channels, doubles(bars.rows, 0), gradient)
    waiting[0] = 0


@njit_inner
def _pull_back_field(net, record, bars, channels, bar_rate, bar_x):
    """Pull cotangents of `f(x)` back, those of all channels: fills `bar_x (C n,)`, adds to the gradients.

    Where the network has fewer outputs than there are channels, the derivatives of its outputs are computed once, so
    that a further channel costs a few short vector operations.
    """
    n, m = net.n, net.m
    lead = n - m
    for c in range(channels):
        bar = shift(bar_x, c * n)
        for i in range(m):
            bar[i] = 0.0
        for i in range(lead):
            bar[m + i] = bar_rate[c * n + i]
    if m < channels:
        rows_x = doubles(bars.rows_x, 0)
        clear(m * n, rows_x)
        for o in range(m):
            row = next_row(net, bars, channels)
            factors, row_x = doubles(bars.factors, row * channels), shift(rows_x, o * n)
            row_theta = doubles(bars.rows, row * bars.stride)
            pull_back_outputs(net, record, doubles(bars.seeds, o * m), row_x, row_theta, doubles(bars.scratch, 0))
            for c in range(channels):
                factors[c] = bar_rate[c * n + lead + o]
                for i in range(n):
                    bar_x[c * n + i] += factors[c] * row_x[i]
    else:
        for c in range(channels):
            gradient, seed = doubles(bars.packed, c * net.size), shift(bar_rate, c * n + lead)
            pull_back_outputs(net, record, seed, shift(bar_x, c * n), gradient, doubles(bars.scratch, 0))


@njit_inner
def _last_output(count, size, states):
    """Index of the last of `count` outputs whose cotangent `(size,)` is not zero; 0 for none but the initial state."""
    for o in range(count - 1, 0, -1):
        if any_nonzero(size, shift(states, o * size)):
            return o
    return 0


@njit_inner
def _gather_outputs(net, method, steps, bars, channels, step, output):
    """Fill `bars.start` and `bars.stage_rates` with the cotangents that the outputs inside one step put there.

    Returns the index of the last output before the step, given that of the last that is not behind it.
    """
    q = channels * net.n
    start, rates = doubles(bars.start, 0), doubles(bars.stage_rates, 0)
    clear(q, start)
    clear(method.stages * q, rates)
    h = doubles(steps.size, 0)[step]
    while integers(steps.output_step, 0)[output] == step:
        bar, weights = doubles(bars.states, output * q), doubles(steps.output_weights, output * method.stages)
        add_scaled(q, 1.0, bar, start)
        for j in range(method.stages):
            add_scaled(q, h * weights[j], bar, shift(rates, j * q))
        output -= 1
    return output


@njit_inner
def adjoint(net, method, steps, bars, channels, outputs):
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by the discrete adjoint.

    Stage j of a step from x: `X_j = x + h sum_(l<j) a_jl k_l`, `k_j = f(X_j)`; the last one is the state at the end
    and the first one of the next step. Backwards, with bars for cotangents: `bar k_j = (outputs, next step) + h
    sum_(l>j) a_lj bar X_l`, `bar X_j = (df/dx)^T bar k_j`, `bar x = (outputs) + sum_j bar X_j`.
    """
    q, stages = channels * net.n, method.stages
    output = _last_output(outputs, q, doubles(bars.states, 0))
    if output == 0:
        _add_first_outputs(net, steps, bars, channels, outputs)
        return
    rates, states = doubles(bars.stage_rates, 0), doubles(bars.stage_states, 0)
    start, carried = doubles(bars.start, 0), doubles(bars.carried, 0)
    end = states  # the place of stage 0, which no stage reads
    clear(q, carried)
    clear(q, end)
    for step in range(integers(steps.output_step, 0)[output], -1, -1):
        output = _gather_outputs(net, method, steps, bars, channels, step, output)
        h = doubles(steps.size, 0)[step]
        add_scaled(q, 1.0, carried, shift(rates, (stages - 1) * q))
        for j in range(stages - 1, 0, -1):
            rate, state, behind = shift(rates, j * q), shift(states, j * q), stages - 1 - j
            weights = doubles(method.transposed, j * stages + j + 1)
            combine(q, behind, rate, h, weights, shift(state, q), rate)
            record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
            _pull_back_field(net, record, bars, channels, rate, state)
            if j == stages - 1:
                add_scaled(q, 1.0, end, state)
            add_scaled(q, 1.0, state, start)
        combine(q, stages - 1, rates, h, doubles(method.transposed, 1), shift(states, q), carried)
        copy(q, start, end)
    _add_initial_state(net, bars, channels, start)
    _pull_back_field(net, doubles(steps.record, 0), bars, channels, carried, end)
    _add_initial_state(net, bars, channels, end)
    _add_first_outputs(net, steps, bars, channels, outputs)


@njit_inner
def _add_first_outputs(net, steps, bars, channels, outputs):
    """Add the cotangents of the outputs that show the initial state itself."""
    output = 0
    while output < outputs and integers(steps.output_step, 0)[output] < 0:
        _add_initial_state(net, bars, channels, doubles(bars.states, output * channels * net.n))
        output += 1


@njit_inner
def _add_initial_state(net, bars, channels, bar_x):
    """Add cotangents of the initial state `(C n,)` to the gradients of its trained entries."""
    unknown, count = integers(bars.unknown, 0), bars.unknown_count
    for c in range(channels):
        gradient = doubles(bars.packed, (c + 1) * net.size - count)
        for i in range(count):
            gradient[i] += bar_x[c * net.n + unknown[i]]


@njit_inner
def forward_sensitivities(net, method, steps, bars, channels, outputs):
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by forward sensitivities along the steps.

    The solution Jacobian `(n, P)` is carried from step to step and contracted with the cotangents of the outputs in
    each, so that it is never stored.
    """
    stages, length = method.stages, net.n * net.size
    final = _last_output(outputs, channels * net.n, doubles(bars.states, 0))
    _add_first_outputs(net, steps, bars, channels, outputs)
    if final == 0:
        return
    state, stage, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_stage, 0), doubles(bars.tangent_k, 0)
    output_step, output = integers(steps.output_step, 0), 0
    start_sensitivities(net, bars, state)
    push_field(net, doubles(steps.record, 0), bars, state, k)
    for step in range(output_step[final] + 1):
        h, before = doubles(steps.size, 0)[step], output
        while output < final and output_step[output + 1] <= step:
            output += 1
        for j in range(1, stages):
            combine(length, j, state, h, doubles(method.a, j * stages), k, stage)
            record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
            push_field(net, record, bars, stage, shift(k, j * length))
        inside = output - before
        if inside * (stages + channels) < channels * (stages + 1):
            for number in range(before + 1, output + 1):
                _contract_output(net, method, steps, bars, channels, h, number)
        else:
            _contract_stages(net, method, steps, bars, channels, step, output)
        copy(length, stage, state)
        copy(length, shift(k, (stages - 1) * length), k)


@njit_inner
def start_sensitivities(net, bars, state):
    """Fill `state (n, P)` with the derivatives of the initial state: ones where an entry of it is a parameter."""
    clear(net.n * net.size, state)
    for i in range(bars.unknown_count):
        state[integers(bars.unknown, 0)[i] * net.size + net.size - bars.unknown_count + i] = 1.0


@njit_inner
def _contract_output(net, method, steps, bars, channels, h, output):
    """Add the sensitivity of one output of a step, interpolated, times its cotangents: cheap for many channels."""
    n, stages, length = net.n, method.stages, net.n * net.size
    state, k, here = doubles(bars.tangent_state, 0), doubles(bars.tangent_k, 0), doubles(bars.tangent_output, 0)
    combine(length, stages, state, h, doubles(steps.output_weights, output * stages), k, here)
    for c in range(channels):
        bar = doubles(bars.states, (output * channels + c) * n)
        add_rows(n, net.size, net.size, bar, 1, here, doubles(bars.packed, c * net.size))


@njit_inner
def _contract_stages(net, method, steps, bars, channels, step, output):
    """The same for all outputs of a step, the last of them number `output`, through its stages."""
    n, stages, q = net.n, method.stages, channels * net.n
    _gather_outputs(net, method, steps, bars, channels, step, output)
    state, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_k, 0)
    for c in range(channels):
        gradient = doubles(bars.packed, c * net.size)
        add_rows(n, net.size, net.size, doubles(bars.start, c * n), 1, state, gradient)
        for i in range(n):
            factors = doubles(bars.stage_rates, c * n + i)
            add_rows(stages, net.size, n * net.size, factors, q, shift(k, i * net.size), gradient)


@njit_inner
def push_field(net, record, bars, stage, rate):
    """Fill `rate (n, P)` with the sensitivity of `f(x)` at a recorded state for the sensitivity `stage (n, P)` of x."""
    n, m, size = net.n, net.m, net.size
    lead = n - m
    copy(lead * size, shift(stage, m * size), rate)
    row_x = doubles(bars.rows_x, 0)
    for o in range(m):
        row = shift(rate, (lead + o) * size)
        clear(n, row_x)
        clear(size, row)
        pull_back_outputs(net, record, doubles(bars.seeds, o * m), row_x, row, doubles(bars.scratch, 0))
        add_rows(n, size, size, row_x, 1, stage, row)
