"""Cotangents of the trajectory pulled back to the parameters through the recorded steps, all terms at once.

Two ways, exact derivatives of the same steps, so they agree to round-off: the discrete adjoint (backpropagation
through the steps and their dense output) and forward sensitivities (the paper's Equ. multigrad: one Jacobian of the
solution, shared by all terms). Step sizes count as constants.
"""

from typing import NamedTuple

from eigenode_cli.engines.compiled.algebra import add_scaled, clear, combine, copy
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.mlp import pull_back_outputs
from eigenode_cli.jit import njit_inner


class Bars(NamedTuple):
    """Addresses of the working space of both ways, for L terms, s stages, n states, m outputs and P parameters.

    Attributes:
        terms: L.
        states: cotangents of the trajectory `(N, L n)`.
        packed: gradients in the order that they are gathered in (`algebra.add_outer`) `(L, P)`.
        stage_rates, stage_states: cotangents of the stages' derivatives and states `(s, L n)`.
        start: cotangent of the state at the step's start `(L n,)`; `carried` that of the derivative at its end.
        seeds: unit vectors `(m, m)`.
        rows_x, rows_theta: derivatives of the outputs in the state and in the parameters, `(m, n)` and `(m, P)`.
        scratch: of the network's pullbacks.
        tangent_state, tangent_stage, tangent_k: forward sensitivities of a state and of a stage `(n, P)`, of the
            stages' derivatives `(s, n, P)`.
    """

    terms: int
    states: int
    packed: int
    stage_rates: int
    stage_states: int
    start: int
    carried: int
    seeds: int
    rows_x: int
    rows_theta: int
    scratch: int
    tangent_state: int
    tangent_stage: int
    tangent_k: int


@njit_inner
def _output_rows(net, record, bars):
    """Fill `bars.rows_x` and `bars.rows_theta` with the derivatives of every output at a recorded state."""
    clear(net.m * net.n, doubles(bars.rows_x, 0))
    clear(net.m * net.size, doubles(bars.rows_theta, 0))
    for o in range(net.m):
        seed, row_x = doubles(bars.seeds, o * net.m), doubles(bars.rows_x, o * net.n)
        row_theta = doubles(bars.rows_theta, o * net.size)
        pull_back_outputs(net, record, seed, row_x, row_theta, doubles(bars.scratch, 0))


@njit_inner
def combine_rows(count, size, factors, rows, total):
    """`total += sum_e factors_e rows_e` with `rows (count, size)`; a factor of zero leaves its row unread."""
    for e in range(count):
        if factors[e] != 0.0:
            add_scaled(size, factors[e], shift(rows, e * size), total)


@njit_inner
def _pull_back_field(net, record, bars, bar_rate, bar_x):
    """Pull cotangents of `f(x)` back, those of all terms: fills `bar_x (L n,)`, adds to `bars.packed`.

    Where the network has fewer outputs than there are terms, the derivatives of its outputs are computed once and
    combined for each term, so that a further term costs a few short vector operations.
    """
    n, m = net.n, net.m
    lead = n - m
    shared = m < bars.terms
    if shared:
        _output_rows(net, record, bars)
    for term in range(bars.terms):
        bar, seed = shift(bar_x, term * n), shift(bar_rate, term * n + lead)
        gradient = doubles(bars.packed, term * net.size)
        clear(n, bar)
        for i in range(lead):
            bar[m + i] = bar_rate[term * n + i]
        if shared:
            combine_rows(m, n, seed, doubles(bars.rows_x, 0), bar)
            combine_rows(m, net.size, seed, doubles(bars.rows_theta, 0), gradient)
        else:
            pull_back_outputs(net, record, seed, bar, gradient, doubles(bars.scratch, 0))


@njit_inner
def _last_output(count, size, states):
    """Index of the last of `count` outputs whose cotangent `(size,)` is not zero; 0 for none but the initial state."""
    for o in range(count - 1, 0, -1):
        for i in range(size):
            if states[o * size + i] != 0.0:
                return o
    return 0


@njit_inner
def _gather_outputs(net, method, steps, bars, step, output):
    """Fill `bars.start` and `bars.stage_rates` with the cotangents that the outputs inside one step put there.

    Returns the index of the last output before the step, given that of the last that is not behind it.
    """
    q = bars.terms * net.n
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
def adjoint(net, method, steps, bars, outputs):
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by the discrete adjoint.

    Stage j of a step from x: `X_j = x + h sum_(l<j) a_jl k_l`, `k_j = f(X_j)`; the last one is the state at the end
    and the first one of the next step. Backwards, with bars for cotangents: `bar k_j = (outputs, next step) + h
    sum_(l>j) a_lj bar X_l`, `bar X_j = (df/dx)^T bar k_j`, `bar x = (outputs) + sum_j bar X_j`.
    """
    q, stages = bars.terms * net.n, method.stages
    output = _last_output(outputs, q, doubles(bars.states, 0))
    if output == 0:
        return
    rates, states = doubles(bars.stage_rates, 0), doubles(bars.stage_states, 0)
    start, carried = doubles(bars.start, 0), doubles(bars.carried, 0)
    end = states  # the place of stage 0, which no stage reads
    clear(q, carried)
    clear(q, end)
    for step in range(integers(steps.output_step, 0)[output], -1, -1):
        output = _gather_outputs(net, method, steps, bars, step, output)
        h = doubles(steps.size, 0)[step]
        add_scaled(q, 1.0, carried, shift(rates, (stages - 1) * q))
        for j in range(stages - 1, 0, -1):
            rate, state, behind = shift(rates, j * q), shift(states, j * q), stages - 1 - j
            weights = doubles(method.transposed, j * stages + j + 1)
            combine(q, behind, rate, h, weights, shift(state, q), rate)
            record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
            _pull_back_field(net, record, bars, rate, state)
            if j == stages - 1:
                add_scaled(q, 1.0, end, state)
            add_scaled(q, 1.0, state, start)
        combine(q, stages - 1, rates, h, doubles(method.transposed, 1), shift(states, q), carried)
        copy(q, start, end)
    _pull_back_field(net, doubles(steps.record, 0), bars, carried, end)


@njit_inner
def forward_sensitivities(net, method, steps, bars, outputs):
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by forward sensitivities along the steps.

    The solution Jacobian `(n, P)` is carried from step to step and contracted with the cotangents of the outputs in
    each, through the stages, so that it is never interpolated or stored.
    """
    n, stages, length = net.n, method.stages, net.n * net.size
    final = _last_output(outputs, bars.terms * n, doubles(bars.states, 0))
    if final == 0:
        return
    state, stage, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_stage, 0), doubles(bars.tangent_k, 0)
    output_step, output = integers(steps.output_step, 0), 0
    clear(length, state)
    _push_field(net, doubles(steps.record, 0), bars, state, k)
    for step in range(output_step[final] + 1):
        while output < final and output_step[output + 1] <= step:
            output += 1
        _gather_outputs(net, method, steps, bars, step, output)
        for j in range(1, stages):
            h = doubles(steps.size, 0)[step]
            combine(length, j, state, h, doubles(method.a, j * stages), k, stage)
            record = doubles(steps.record, (step * (stages - 1) + j) * steps.width)
            _push_field(net, record, bars, stage, shift(k, j * length))
        q = bars.terms * n
        for term in range(bars.terms):
            gradient = doubles(bars.packed, term * net.size)
            combine_rows(n, net.size, doubles(bars.start, term * n), state, gradient)
            for j in range(stages):
                factors = doubles(bars.stage_rates, j * q + term * n)
                combine_rows(n, net.size, factors, shift(k, j * length), gradient)
        copy(length, stage, state)
        copy(length, shift(k, (stages - 1) * length), k)


@njit_inner
def _push_field(net, record, bars, stage, rate):
    """Fill `rate (n, P)` with the sensitivity of `f(x)` at a recorded state for the sensitivity `stage (n, P)` of x."""
    n, m, size = net.n, net.m, net.size
    lead = n - m
    _output_rows(net, record, bars)
    copy(lead * size, shift(stage, m * size), rate)
    for o in range(m):
        row = shift(rate, (lead + o) * size)
        copy(size, doubles(bars.rows_theta, o * size), row)
        combine_rows(n, size, doubles(bars.rows_x, o * n), stage, row)
