"""Spectra of many states at once, and the slopes in them pulled back to states and parameters, block by block."""

import math

from eigenode_cli.engines.compiled.algebra import all_finite, any_nonzero, clear
from eigenode_cli.engines.compiled.core import GUARDED, SPECTRA, STATUS
from eigenode_cli.engines.compiled.integrate import OK
from eigenode_cli.engines.compiled.jacobian import evaluate_block, jacobian_block, pull_back_block, push_tangents
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.spectrum import (
    pull_back_closed_forms,
    pull_back_spectrum,
    take_closed_forms,
    take_spectrum,
)
from eigenode_cli.jit import njit_inner


@njit_inner
def take_block(core, trajectory, side, block, counted, vectors):
    """Spectra of one block, NaN where a state or a Jacobian is not finite.

    Such a state leaves a record of zeros, so that nothing of it gets into the sums over the columns.

    Args:
        core, trajectory: of the solve.
        side, block: which block, along the trajectory (0) or at the references (1).
        counted: number of spectra of this side in which firings of the guard count.
        vectors: whether what the pullback needs is computed.
    """
    net, work, setup, n = core.batch, core.work, core.setup, core.net.n
    columns, number, first = work.columns, side * work.blocks + block, block * work.columns
    record, tangents = doubles(work.records, number * net.width * columns), doubles(work.tangents, 0)
    rows, outcome, count = doubles(work.rows, 0), integers(work.outcome, 0), min(columns, setup.rows - first)
    _load_states(core, trajectory, side, first, record)
    evaluate_block(net, columns, record)
    push_tangents(net, columns, record, tangents)
    jacobian_block(net, columns, tangents, rows)
    integers(work.pushed, 0)[0] = number
    for c in range(count):
        if not all_finite(n, _state(core, trajectory, side, first + c)):
            rows[c] = math.nan
    at = side * setup.rows + first
    if n == 2:
        outcome[GUARDED] += take_closed_forms(core.eigen, net.m, columns, count, rows, at, counted - first, vectors)
    else:
        outcome[GUARDED] += _take_one_by_one(core, count, rows, at, counted - first, vectors)
    entries = net.m * n
    if not all_finite(entries * columns, rows):
        integers(work.pushed, 0)[0] = -1
        for c in range(columns):  # those behind the last state as well: their sums must stay zero
            for row in range(0 if all_finite(entries, shift(rows, c), columns) else net.width):
                record[row * columns + c] = 0.0


@njit_inner
def _take_one_by_one(core, count, rows, at, counted, vectors):
    """`spectrum.take_closed_forms` of any number of states."""
    n, m, columns, a, fired = core.net.n, core.net.m, core.work.columns, doubles(core.work.a, 0), 0
    lead, entries = (n - m) * n, m * n
    clear(lead, a)
    for c in range(count):
        for i in range(n - m):
            a[i * n + m + i] = 1.0
        for i in range(entries):
            a[lead + i] = rows[i * columns + c]
        firings = take_spectrum(core.eigen, a, at + c, vectors)
        fired += firings if c < counted else 0
    return fired


@njit_inner
def _state(core, trajectory, side, t):
    """Return the state `(n,)` of spectrum t on a side."""
    if side == 0:
        return shift(trajectory, integers(core.setup.indices, 0)[t] * core.net.n)
    return doubles(core.setup.references, t * core.net.n)


@njit_inner
def _load_states(core, trajectory, side, first, record):
    """Fill the leading rows of a record with scaled states and inputs from number `first` on, zero for no state."""
    columns, n, k, scale_in = core.work.columns, core.net.n, core.net.k, doubles(core.net.scale_in, 0)
    for c in range(columns):
        inside = first + c < core.setup.rows and all_finite(n, _state(core, trajectory, side, first + c))
        for i in range(n):
            value = _state(core, trajectory, side, first + c)[i] if inside else 0.0
            record[i * columns + c] = scale_in[i] * value
        for i in range(k):
            output = integers(core.setup.indices, 0)[first + c] if inside else 0
            record[(n + i) * columns + c] = scale_in[n + i] * doubles(core.setup.driven, output * k + i)[0]


@njit_inner
def pull_back_spectra(core, terms, channels, number):
    """Pull the slopes of all channels in the spectra of one block back to the states and to the parameters."""
    net, setup, work, bars, n = core.batch, core.setup, core.work, core.bars, core.net.n
    columns, side, channel = work.columns, number // work.blocks, integers(work.channel, 0)
    first = (number - side * work.blocks) * columns
    count, pushed = min(columns, setup.rows - first), integers(work.pushed, 0)
    record, tangents = doubles(work.records, number * net.width * columns), doubles(work.tangents, 0)
    bar_x, spectra = doubles(work.bar_x, 0), integers(work.outcome, 0)[SPECTRA]
    for term in range(terms):
        row = side * setup.rows + first
        slopes = doubles(work.slopes, 2 * (term * spectra + row) * n)
        if channel[term] < 0 or not _load_cotangents(core, row, count, slopes):
            continue
        if pushed[0] != number:
            push_tangents(net, columns, record, tangents)
            pushed[0] = number
        packed, scratch = doubles(bars.packed, channel[term] * net.size), doubles(work.scratch, 0)
        pull_back_block(net, columns, record, tangents, doubles(work.rows, 0), bar_x, packed, scratch)
        if integers(work.outcome, 0)[STATUS] == OK:  # the states of a failed solve count as constants
            for c in range(count):
                output = integers(setup.indices, 0)[first + c]
                bar = doubles(bars.states, (output * channels + channel[term]) * n)
                for i in range(n):
                    bar[i] += bar_x[i * columns + c]


@njit_inner
def _load_cotangents(core, row, count, slopes):
    """Fill `work.rows` with the cotangents of the Jacobians from number `row` on; returns whether any is not zero."""
    columns, m, n = core.work.columns, core.net.m, core.net.n
    rows, bar = doubles(core.work.rows, 0), doubles(core.work.bar, 0)
    if not any_nonzero(2 * n * count, slopes):
        return False
    clear(m * n * columns, rows)
    if n == 2:
        pull_back_closed_forms(core.eigen, row, count, m, slopes, columns, rows)
        return True
    for c in range(count):
        pull_back_spectrum(core.eigen, row + c, m, shift(slopes, 2 * c * n), bar)
        for i in range(m * n):
            rows[i * columns + c] = bar[i]
    return True
