"""The derivatives of the vector field at recorded states, backwards and forwards, and their working space."""

from typing import NamedTuple

from eigenode_cli.engines.compiled.algebra import BLOCK, add_rows, clear, copy
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
        directions: vectors that Jacobians are multiplied with `(L, m, n + k)`; `curves` of `curvature.fill_curves`.
        tangent_state, tangent_stage, tangent_output, tangent_k: forward sensitivities of a state, of a stage and of an
            output `(n, P)`, of the stages' derivatives `(s, n, P)`.
        unknown, unknown_count: indices of the initial state's trained entries; their parameters stand at `initial`.
        record, rate, bar_rate: of one evaluation of the field at an output: its record, its derivative `(n,)`, and
            cotangents `(C n,)`; tangent_shown: sensitivity of what is measured at an output.
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
    directions: int
    curves: int
    tangent_state: int
    tangent_stage: int
    tangent_k: int
    tangent_output: int
    unknown: int
    unknown_count: int
    initial: int
    record: int
    rate: int
    bar_rate: int
    tangent_shown: int


@njit_inner
def next_row(net, bars, channels):
    """Return the number of a new row of zeros among those that wait, after a full block has been gathered.

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
def pull_back_field(net, record, bars, channels, bar_rate, bar_x):
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
def start_sensitivities(net, bars, state):
    """Fill `state (n, P)` with the derivatives of the initial state: ones where an entry of it is a parameter."""
    clear(net.n * net.size, state)
    for i in range(bars.unknown_count):
        state[integers(bars.unknown, 0)[i] * net.size + bars.initial + i] = 1.0


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
