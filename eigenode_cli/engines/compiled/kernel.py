"""The loss Jacobian as two kernels and their fusion: solve, spectra and terms forward; pullback to the parameters.

    theta -> field with mirrored weights -> recorded steps, trajectory -> A and its spectrum at the data times
          -> values and slopes of the terms -> cotangents of spectra, states, steps -> gradients

The user's own terms are evaluated between the two. Nothing is allocated but what a term allocates.
"""

import math

from eigenode_cli.engines.compiled.algebra import any_nonzero, clear, copy
from eigenode_cli.engines.compiled.bars import gather_rows
from eigenode_cli.engines.compiled.blocks import pull_back_spectra, take_block
from eigenode_cli.engines.compiled.channels import add_offsets, pull_back_rates, show_channels
from eigenode_cli.engines.compiled.core import ACCEPTED, GUARDED, REACHED, REJECTED, SPECTRA, STATUS
from eigenode_cli.engines.compiled.integrate import FULL, OK, UNSOLVED, integrate
from eigenode_cli.engines.compiled.memory import booleans, carray, complexes, doubles, integers, shift, start_of
from eigenode_cli.engines.compiled.mlp import mirror_weights, unpack_gradient
from eigenode_cli.engines.compiled.pullback import adjoint, forward_sensitivities
from eigenode_cli.engines.update import train_step
from eigenode_cli.jit import njit, njit_inner
from eigenode_cli.terms.sol import sol
from eigenode_cli.terms.spectral import COUNT, SOL, spectral_terms


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
    times, start, trajectory = doubles(setup.times, 0), _initial_state(core), start_of(states)
    status, accepted, rejected, reached = UNSOLVED, 0, 0, 0
    if setup.solved:
        status, accepted, rejected, reached = integrate(
            core.net,
            core.drive,
            core.method,
            steps,
            given.size,
            start_of(given),
            start,
            setup.outputs,
            times,
            trajectory,
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
def _initial_state(core):
    """Return the state `(n,)` that the solve starts from, its trained entries taken from theta."""
    start, unknown, count = doubles(core.setup.start, 0), integers(core.setup.unknown, 0), core.setup.unknown_count
    trained = doubles(core.net.theta, core.setup.initial)
    for i in range(count):
        start[unknown[i]] = trained[i]
    return start


@njit_inner
def _spectra_are_wanted(codes):
    wanted = False
    for code in codes:
        wanted |= code != SOL
    return wanted


@njit_inner
def _take_spectra(core, status, reached, trajectory, vectors, spectra):
    """Spectra along the trajectory, and at the data states too where a failed solve stabilises."""
    setup, outcome, n = core.setup, integers(core.work.outcome, 0), core.net.n
    outcome[SPECTRA], counted = setup.rows, setup.rows
    if status != OK and setup.stabilise:
        counted = _stabilising_rows(core, reached, trajectory)
    for block in range(core.work.blocks):
        take_block(core, trajectory, 0, block, counted, vectors)
    found = complexes(core.eigen.spectra, 0)
    for t in range(setup.rows):
        for i in range(n):
            spectra[t, i] = found[t * n + i]
    if status != OK and setup.stabilise:
        for i in range(counted * n, setup.rows * n):  # the terms skip a spectrum of NaN
            found[i] = complex(math.nan, math.nan)
        outcome[SPECTRA] = 2 * setup.rows
        for block in range(core.work.blocks):
            take_block(core, trajectory, 1, block, setup.rows, vectors)


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
    start = _initial_state(core)
    mirror_weights(core.net)
    return integrate(
        core.net,
        core.drive,
        core.method,
        steps,
        given.size,
        start_of(given),
        start,
        times.size,
        start_of(times),
        start_of(states),
    )[0]


@njit
def evaluate(core, steps, given, codes, values, states, spectra, dense_steps, dense_given, times, dense):
    """`forward` without what a pullback needs, and `solve` at other times: a record of the training in one call.

    A term that has nothing to compare, which trains as zero, is recorded as NaN.

    Returns:
        How the two ended.
    """
    status = forward(core, steps, given, codes, False, values, states, spectra)
    for term in range(codes.size):
        if codes[term] > SOL and integers(core.work.compared, 0)[term] == 0:
            values[term] = math.nan
    return status, solve(core, dense_steps, dense_given, times, dense)


@njit_inner
def _evaluate_terms(core, codes, values, states):
    """Values of the named terms; their slopes go to `work.slopes` and `work.solution_slope`."""
    setup, work, n = core.setup, core.work, core.net.n
    count, status = integers(work.outcome, 0)[SPECTRA], integers(work.outcome, 0)[STATUS]
    failed = status != OK
    errors = carray(integers(setup.errors, 0), (COUNT,))
    counted = spectral_terms(
        codes,
        carray(complexes(core.eigen.spectra, 0), (count, n)),
        carray(doubles(core.eigen.levels, 0), (count,)),
        (
            carray(doubles(setup.frequency, 0), (count, setup.pair_count)),
            carray(doubles(setup.damping, 0), (count, setup.pair_count)),
            carray(integers(setup.pairs, 0), (count,)),
            carray(doubles(setup.stiffness, 0), (count, 2)),
            carray(doubles(setup.frequency_tolerance, 0), (count, setup.pair_count)),
            carray(doubles(setup.damping_tolerance, 0), (count, setup.pair_count)),
            carray(doubles(setup.region, 0), (setup.region_size,)),
        ),
        setup.margin,
        errors,
        setup.delta,
        values,
        carray(complexes(work.slopes, 0), (codes.size, count, n)),
        carray(integers(work.compared, 0), (codes.size,)),
        (carray(integers(work.partner, 0), (n,)), carray(integers(work.match, 0), (n,))),
    )
    shape = (setup.outputs, setup.channels)
    data, mask = carray(doubles(setup.data, 0), shape), carray(booleans(setup.mask, 0), shape)
    slope = carray(doubles(work.solution_slope, 0), shape)
    for term in range(codes.size):
        if codes[term] == SOL:
            shown = carray(show_channels(core, start_of(states)), shape)
            values[term] = sol(shown, data, mask, errors[SOL], setup.delta, slope)
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
    channels = _open_channels(core, codes, values)
    channel = integers(work.channel, 0)
    for number in range(work.blocks * (outcome[SPECTRA] // setup.rows)):
        pull_back_spectra(core, codes.size, channels, number)
    if outcome[STATUS] == OK and setup.channels > net.n:
        pull_back_rates(core, codes, channels)
    if outcome[STATUS] == OK and forward_way:
        forward_sensitivities(net, core.method, steps, bars, channels, setup.outputs)
    elif outcome[STATUS] == OK:
        adjoint(net, core.method, steps, bars, channels, setup.outputs)
    gather_rows(net, bars, channels)
    for term in range(codes.size):
        if codes[term] == SOL and channel[term] >= 0 and not setup.plain:
            add_offsets(core, doubles(bars.packed, channel[term] * net.size))
        if channel[term] < 0:
            gradients[term, :] = math.nan if math.isnan(values[term]) else 0.0
        else:
            packed, gradient = (
                doubles(bars.packed, channel[term] * net.size),
                shift(start_of(gradients), term * net.size),
            )
            unpack_gradient(net, packed, gradient)


@njit_inner
def _open_channels(core, codes, values):
    """Count the terms that have a slope anywhere, clear their sums and enter their slopes in the trajectory.

    Most terms of a field that is nearly right have none: no eigenvalue is unstable, none lacks its partner.
    """
    net, setup, work, bars = core.net, core.setup, core.work, core.bars
    channel, count, channels = integers(work.channel, 0), integers(work.outcome, 0)[SPECTRA], 0
    for term in range(codes.size):
        width = setup.channels if codes[term] == SOL else net.n
        along = codes[term] <= SOL and any_nonzero(setup.outputs * width, _trajectory_slope(core, codes[term]))
        slopes = doubles(work.slopes, 2 * term * count * net.n)
        opened = not math.isnan(values[term]) and (along or any_nonzero(2 * count * net.n, slopes))
        channel[term] = channels if opened else -1
        channels += int(opened)
    clear(channels * net.size, doubles(bars.packed, 0))
    clear(setup.outputs * channels * net.n, doubles(bars.states, 0))
    for term in range(codes.size):
        if channel[term] >= 0 and codes[term] <= SOL:
            slope, width = _trajectory_slope(core, codes[term]), setup.channels if codes[term] == SOL else net.n
            for j in range(setup.outputs):
                copy(net.n, shift(slope, j * width), doubles(bars.states, (j * channels + channel[term]) * net.n))
    return channels


@njit_inner
def _trajectory_slope(core, code):
    """Slope of SOL in the channels `(N, C)` or, for a negative code, of one of the user's terms in the trajectory."""
    if code == SOL:
        return doubles(core.work.solution_slope, 0)
    return doubles(core.work.user_slopes, (-1 - code) * core.setup.outputs * core.net.n)


@njit
def loss_jacobian(core, steps, given, codes, vectors, forward_way, values, gradients, states, spectra):
    """`forward` and `pull_back` in one call."""
    status = forward(core, steps, given, codes, vectors, values, states, spectra)
    if status >= 0:
        pull_back(core, steps, codes, forward_way, values, gradients)
    return status


@njit
def advance(
    core,
    steps,
    given,
    codes,
    vectors,
    forward_way,
    update,
    rates,
    halt,
    theta,
    gradients,
    states,
    spectra,
    values,
    statuses,
):
    """Training steps without the interpreter, one for each of `rates (K,)`.

    Args:
        core, steps, given, codes, vectors, forward_way, gradients, states, spectra: as in `loss_jacobian`.
        update: of the updates.
        rates: learning rates.
        halt: end behind a solve that failed, before its update.
        theta: the parameters at `core.net.theta` as an array `(P,)`, changed.
        values: filled with the terms of each step `(K, L)`.
        statuses: filled with how each solve ended `(K,)`.

    Returns:
        The number of loss Jacobians, K but where it halted or there is no room to record a solve, and how often the
        guard fired.
    """
    guarded = 0
    for k in range(rates.size):
        status = loss_jacobian(core, steps, given, codes, vectors, forward_way, values[k], gradients, states, spectra)
        if status == FULL:
            return k, guarded
        statuses[k] = status
        guarded += integers(core.work.outcome, 0)[GUARDED]
        if halt and status not in (OK, UNSOLVED):
            return k + 1, guarded
        train_step(update, theta, gradients, rates[k], status in (OK, UNSOLVED))
    return rates.size, guarded
