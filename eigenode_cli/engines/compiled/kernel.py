"""The loss Jacobian as two kernels and their fusion: solve, spectra and terms forward; pullback to the parameters.

    theta -> field with mirrored weights -> recorded steps, trajectory -> A and its spectrum at the data times
          -> values and slopes of the terms -> cotangents of spectra, states, steps -> gradients

The user's own terms are evaluated between the two. Nothing is allocated but what a term allocates.
"""

import math
from typing import NamedTuple

from numba import carray  # pyright: ignore[reportPrivateImportUsage]  # documented under this name

from eigenode_cli.engines.compiled.algebra import add_scaled, clear
from eigenode_cli.engines.compiled.integrate import OK, UNSOLVED, Method, integrate
from eigenode_cli.engines.compiled.jacobian import jacobian, pull_back_jacobian, push_tangents
from eigenode_cli.engines.compiled.memory import booleans, complexes, doubles, integers, shift, start_of
from eigenode_cli.engines.compiled.mlp import Net, evaluate_field, mirror_weights, unpack_gradient
from eigenode_cli.engines.compiled.pullback import Bars, adjoint, combine_rows, forward_sensitivities
from eigenode_cli.engines.compiled.spectrum import Eigen, pull_back_spectrum, take_spectrum
from eigenode_cli.jit import njit, njit_inner
from eigenode_cli.terms.sol import sol
from eigenode_cli.terms.spectral import SOL, spectral_terms

ENTRIES = ("loss_jacobian", "forward", "pull_back", "solve")
"""The functions here that are called from Python, that which calls the others first."""

STATUS, ACCEPTED, REJECTED, REACHED, SPECTRA, GUARDED = range(6)
"""Entries of `Core.outcome`: how the solve ended, steps, outputs that were reached, spectra that the terms are taken
over, firings of the guard."""


class Setup(NamedTuple):
    """The problem as the kernels read it, for N data times, T spectra, K pairs; arrays by their addresses.

    Attributes:
        outputs, rows, pair_count: N, T, K.
        times: data times `(N,)`.
        start: initial state `(n,)`.
        data, mask: observations `(N, n)`.
        indices: data times at which spectra are taken `(T,)`.
        references: data states there `(T, n)`, at which a failed solve takes the spectral terms as well.
        limit: moduli of the states up to which it takes them at the states that it reached `(n,)`.
        frequency, damping, pairs, stiffness: targets, one row for each of the T spectra and then again `(2 T, ...)`.
        margin, errors, delta: of the terms.
        stabilise: whether a failed solve gives spectral terms.
        solved: whether there is a solve at all.
    """

    outputs: int
    rows: int
    pair_count: int
    times: int
    start: int
    data: int
    mask: int
    indices: int
    references: int
    limit: int
    frequency: int
    damping: int
    pairs: int
    stiffness: int
    margin: float
    errors: int
    delta: float
    stabilise: bool
    solved: bool


class Work(NamedTuple):
    """Addresses of the working space between the forward kernel and the pullback, for L terms.

    Attributes:
        records: of the evaluations at which spectra are taken `(2 T, curved.width)`, those at `references` last.
        tangents: of one of them.
        rate, a: a state derivative `(n,)`, a Jacobian `(n, n)`.
        slopes: of the terms in the eigenvalues `(L, T, n)`, or `(L, 2 T, n)` after a failed solve.
        solution_slope: of SOL in the trajectory `(N, n)`; `user_slopes` of the user's terms `(U, N, n)`.
        partner, match: of the terms `(n,)`.
        bar_a: cotangent of a Jacobian for each term `(L, m, n)`; `active` 1 where it is not zero `(L,)`.
        units: unit cotangents `(m n, m, n)`; `rows_x (m n, n)` and `rows_theta (m n, P)` their pullbacks.
        bar_x: cotangent of a state `(n,)`.
        outcome: see above `(6,)`.
    """

    records: int
    tangents: int
    rate: int
    a: int
    slopes: int
    solution_slope: int
    user_slopes: int
    partner: int
    match: int
    bar_a: int
    active: int
    units: int
    rows_x: int
    rows_theta: int
    bar_x: int
    outcome: int


class Core(NamedTuple):
    """Everything that stays the same from call to call; `net` records first derivatives, `curved` second ones too."""

    net: Net
    curved: Net
    method: Method
    eigen: Eigen
    bars: Bars
    setup: Setup
    work: Work


@njit
def forward(core, steps, given, codes, vectors, values, states, spectra):
    """Solve, take spectra, evaluate the named terms.

    Args:
        core: problem, field and working space; the parameters stand at `core.net.theta`.
        steps: filled with the accepted steps.
        given: steps to be taken as they are `(S,)`, of size 0 for adaptive ones.
        codes: of the named terms `(L,)`: of `terms.spectral`; -1 - u for number u of the user's.
        vectors: whether what the pullback needs of the spectra is computed.
        values: filled with the terms `(L,)`, NaN where undefined or the user's.
        states: filled with the trajectory `(N, n)`.
        spectra: filled with the eigenvalues along it `(T, n)`, NaN if no term but SOL is named.

    Returns:
        Status, or `integrate.FULL`.
    """
    setup, outcome = core.setup, integers(core.work.outcome, 0)
    mirror_weights(core.net)
    times, start, trajectory = doubles(setup.times, 0), doubles(setup.start, 0), start_of(states)
    status, accepted, rejected, reached = UNSOLVED, 0, 0, 0
    if setup.solved:
        status, accepted, rejected, reached = integrate(
            core.net, core.method, steps, given.size, start_of(given), start, setup.outputs, times, trajectory
        )
    else:
        states[:, :] = math.nan
    outcome[STATUS], outcome[ACCEPTED], outcome[REJECTED], outcome[REACHED] = status, accepted, rejected, reached
    outcome[SPECTRA], outcome[GUARDED] = 0, 0
    if _spectra_are_wanted(codes):
        _take_spectra(core, status, reached, trajectory, vectors, spectra)
    else:
        spectra[:, :] = complex(math.nan, math.nan)
    _evaluate_terms(core, codes, values, states)
    return status


@njit_inner
def _spectra_are_wanted(codes):
    for code in codes:  # noqa: SIM110  # Numba knows no any() of a generator
        if code != SOL:
            return True
    return False


@njit_inner
def _take_spectra(core, status, reached, trajectory, vectors, spectra):
    """Spectra along the trajectory, and at the data states too where a failed solve stabilises."""
    setup, outcome, n = core.setup, integers(core.work.outcome, 0), core.net.n
    outcome[SPECTRA], counted = setup.rows, setup.rows
    if status != OK and setup.stabilise:
        counted = _stabilising_rows(core, reached, trajectory)
    for t in range(setup.rows):
        fired = _spectrum_at(core, shift(trajectory, integers(setup.indices, 0)[t] * n), t, vectors)
        outcome[GUARDED] += fired if t < counted else 0
    found = complexes(core.eigen.spectra, 0)
    for t in range(setup.rows):
        for i in range(n):
            spectra[t, i] = found[t * n + i]
    if status != OK and setup.stabilise:
        for i in range(counted * n, setup.rows * n):  # the terms skip a spectrum of NaN
            found[i] = complex(math.nan, math.nan)
        outcome[SPECTRA] = 2 * setup.rows
        for t in range(setup.rows):
            state = doubles(setup.references, t * n)
            outcome[GUARDED] += _spectrum_at(core, state, setup.rows + t, vectors)


@njit_inner
def _stabilising_rows(core, reached, trajectory):
    """How many spectra along a failed trajectory count: `Problem.stabilising_rows`."""
    setup, n = core.setup, core.net.n
    indices, limit = integers(setup.indices, 0), doubles(setup.limit, 0)
    for t in range(setup.rows):
        if indices[t] >= reached:
            return t
        for i in range(n):
            if not abs(trajectory[indices[t] * n + i]) <= limit[i]:
                return t
    return setup.rows


@njit
def solve(core, steps, given, times, states):
    """States `(D, n)` at other `times (D,)`, of a solve from the same initial state; returns as `integrate`."""
    start = doubles(core.setup.start, 0)
    mirror_weights(core.net)
    return integrate(
        core.net, core.method, steps, given.size, start_of(given), start, times.size, start_of(times), start_of(states)
    )[0]


@njit_inner
def _spectrum_at(core, state, row, vectors):
    """Spectrum number `row` at a state `(n,)`, NaN where it was not reached; returns how often the guard fired."""
    work, record = core.work, doubles(core.work.records, row * core.curved.width)
    evaluate_field(core.curved, state, record, doubles(work.rate, 0))
    jacobian(core.curved, record, doubles(work.tangents, 0), doubles(work.a, 0))
    return take_spectrum(core.eigen, doubles(work.a, 0), row, vectors)


@njit_inner
def _evaluate_terms(core, codes, values, states):
    """Values of the named terms; their slopes go to `work.slopes` and `work.solution_slope`."""
    setup, work, n = core.setup, core.work, core.net.n
    count, status = integers(work.outcome, 0)[SPECTRA], integers(work.outcome, 0)[STATUS]
    failed = status != OK
    errors = carray(integers(setup.errors, 0), (6,))
    counted = spectral_terms(
        codes,
        carray(complexes(core.eigen.spectra, 0), (count, n)),
        carray(doubles(setup.frequency, 0), (count, setup.pair_count)),
        carray(doubles(setup.damping, 0), (count, setup.pair_count)),
        carray(integers(setup.pairs, 0), (count,)),
        carray(doubles(setup.stiffness, 0), (count, 2)),
        setup.margin,
        errors,
        setup.delta,
        values,
        carray(complexes(work.slopes, 0), (codes.size, count, n)),
        carray(integers(work.partner, 0), (n,)),
        carray(integers(work.match, 0), (n,)),
    )
    shape = (setup.outputs, n)
    data, mask = carray(doubles(setup.data, 0), shape), carray(booleans(setup.mask, 0), shape)
    slope = carray(doubles(work.solution_slope, 0), shape)
    for term in range(codes.size):
        if codes[term] == SOL:
            values[term] = sol(states, data, mask, errors[SOL], setup.delta, slope)
        elif codes[term] < 0 or counted == 0:
            values[term] = math.nan
        if failed and (codes[term] == SOL or not setup.stabilise):
            values[term] = math.nan


@njit
def pull_back(core, steps, codes, forward_way, values, gradients):
    """Fill `gradients (L, P)` from the slopes that `forward` and the user's terms left in `core.work`.

    Args:
        core, steps, codes: as in `forward`.
        forward_way: forward sensitivities in place of the adjoint.
        values: of the terms `(L,)`; the gradient of one that is NaN is NaN.
        gradients: filled.
    """
    net, setup, work, bars = core.net, core.setup, core.work, core.bars
    outcome = integers(work.outcome, 0)
    if outcome[STATUS] != OK and not setup.stabilise:
        gradients[:] = math.nan
        return
    clear(bars.terms * net.size, doubles(bars.packed, 0))
    clear(setup.outputs * bars.terms * net.n, doubles(bars.states, 0))
    for term in range(bars.terms):
        if codes[term] <= SOL and not math.isnan(values[term]):
            at = 0 if codes[term] == SOL else (-1 - codes[term]) * setup.outputs * net.n
            slope = doubles(work.solution_slope if codes[term] == SOL else work.user_slopes, at)
            for j in range(setup.outputs):
                bar = doubles(bars.states, (j * bars.terms + term) * net.n)
                add_scaled(net.n, 1.0, shift(slope, j * net.n), bar)
    for t in range(outcome[SPECTRA]):
        _pull_back_spectrum_at(core, t, outcome[SPECTRA])
    if outcome[STATUS] == OK and forward_way:
        forward_sensitivities(net, core.method, steps, bars, setup.outputs)
    elif outcome[STATUS] == OK:
        adjoint(net, core.method, steps, bars, setup.outputs)
    for term in range(bars.terms):
        if math.isnan(values[term]):
            gradients[term, :] = math.nan
        else:
            unpack_gradient(net, doubles(bars.packed, term * net.size), shift(start_of(gradients), term * net.size))


@njit_inner
def _pull_back_spectrum_at(core, t, count):
    """Pull the slopes of all terms in spectrum t of `count` back to the state and to the parameters.

    Where A has fewer entries that depend on the network than there are terms, the derivatives of these entries are
    computed once and combined for each term.
    """
    net, work, bars = core.curved, core.work, core.bars
    n, entries = net.n, net.m * net.n
    flags, active = integers(work.active, 0), 0
    along = integers(work.outcome, 0)[STATUS] == OK  # the states of a failed solve count as constants
    for term in range(bars.terms):
        slope, bar_a = complexes(work.slopes, (term * count + t) * n), doubles(work.bar_a, term * entries)
        flags[term] = int(pull_back_spectrum(core.eigen, t, net.m, slope, bar_a))
        active += flags[term]
    if active == 0:
        return
    record, bar_x = doubles(work.records, t * net.width), doubles(work.bar_x, 0)
    push_tangents(net, record, doubles(work.tangents, 0))
    shared = entries < active
    if shared:
        _entry_rows(core, record)
    for term in range(bars.terms):
        if flags[term] == 1:
            bar_a, gradient = doubles(work.bar_a, term * entries), doubles(bars.packed, term * net.size)
            clear(n, bar_x)
            if shared:
                combine_rows(entries, n, bar_a, doubles(work.rows_x, 0), bar_x)
                combine_rows(entries, net.size, bar_a, doubles(work.rows_theta, 0), gradient)
            else:
                _pull_back_matrix(core, record, bar_a, bar_x, gradient)
            if along:
                output = integers(core.setup.indices, 0)[t]
                add_scaled(n, 1.0, bar_x, doubles(bars.states, (output * bars.terms + term) * n))


@njit_inner
def _entry_rows(core, record):
    """Fill `work.rows_x` and `work.rows_theta` with the derivatives of every entry of A that the network makes."""
    net, work = core.curved, core.work
    entries = net.m * net.n
    clear(entries * net.n, doubles(work.rows_x, 0))
    clear(entries * net.size, doubles(work.rows_theta, 0))
    for e in range(entries):
        row_x, row_theta = doubles(work.rows_x, e * net.n), doubles(work.rows_theta, e * net.size)
        _pull_back_matrix(core, record, doubles(work.units, e * entries), row_x, row_theta)


@njit_inner
def _pull_back_matrix(core, record, bar_a, bar_x, gradient):
    tangents, scratch = doubles(core.work.tangents, 0), doubles(core.bars.scratch, 0)
    pull_back_jacobian(core.curved, record, tangents, bar_a, bar_x, gradient, scratch)


@njit
def loss_jacobian(core, steps, given, codes, vectors, forward_way, values, gradients, states, spectra):
    """`forward` and `pull_back` in one call."""
    status = forward(core, steps, given, codes, vectors, values, states, spectra)
    if status >= 0:
        pull_back(core, steps, codes, forward_way, values, gradients)
    return status
