"""The solve: steps of `stepper` with the controller of `solve.control`, recorded for the pullback."""

import math

import numpy as np

from eigenode_cli.engines.compiled.algebra import all_finite, clear, copy
from eigenode_cli.engines.compiled.drive import enter_pieces, next_knot, start_drive
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.method import BOTH, IMPLICIT
from eigenode_cli.engines.compiled.mlp import evaluate_field
from eigenode_cli.engines.compiled.stepper import accept, attempt, fastest, interpolate, order_of
from eigenode_cli.jit import njit_inner
from eigenode_cli.solve.control import SMALLEST_RATIO, SMALLEST_STEP, next_step
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.switching import switched

OK, UNDERFLOW, MAX_STEPS, NON_FINITE, UNSOLVED = (int(status) for status in tuple(Status)[:5])
ON_KNOT = 1e-6
"""A given step ends at a knot if it comes this near to it, relative to its size."""
FULL = -1
"""Not a status: there is no room to record another step, the caller makes some and starts again."""


@njit_inner
def integrate(net, drive, method, steps, given_count, given, start, count, times, states):
    """Solve from `start (n,)` at `times[0]` to `times[-1]`, with interpolated outputs at all `times (count,)`.

    No step goes over the start of a piece of the input. Where an input jumps, a step of no length evaluates the field
    once more at the same state, so that the next step starts from the right derivative.

    Args:
        net, drive, method, steps: field, input, tableau with tolerances, record to be filled.
        given_count, given: step sizes to be taken as they are, those of no length too, the last one ending at
            `times[-1]`; none for adaptive steps.
        start: initial state `(n,)`.
        count, times: output times `(N,)` in s, ascending.
        states: filled with the outputs `(N, n)`, NaN where the solve did not arrive.

    Returns:
        Status or `FULL`, accepted steps, rejected steps, number of outputs that were reached.
    """
    n = net.n
    x, first = doubles(steps.x, 0), doubles(steps.k, 0)
    known = _start(method, n, steps, start, count, times, states)
    start_drive(drive, times[0])
    evaluate_field(net, x, doubles(steps.record, 0), first)
    if not all_finite(n, first):
        return NON_FINITE, 0, 0, known
    t, end = times[0], times[count - 1]
    adaptive = given_count == 0
    h = _initial_step(net, method, steps) if adaptive and t < end else 0.0
    accepted, rejected, reached = np.int64(0), np.int64(0), known  # literals would compile what they enter twice
    last_ratio, ratio = SMALLEST_RATIO, 0.0
    implicit, in_a_row = method.kind == IMPLICIT, np.int64(0)
    while t < end:
        jumped = enter_pieces(drive, t)
        if adaptive:
            status = _stuck(method, t, h, accepted + rejected, ratio)
            ending = t + h >= end
            h = end - t if ending else h
        else:
            status = OK if ratio < math.inf else NON_FINITE
            ending = accepted + 1 == given_count
            h = given[accepted]
        if status != OK:
            return status, accepted, rejected, reached
        if accepted == steps.capacity:
            return FULL, accepted, rejected, reached
        wanted, h, after, ending = _until_knot(drive, t, h, end, ending, jumped, adaptive)
        integers(steps.implicit, 0)[accepted] = int(implicit)
        ratio = attempt(net, drive, method, steps, t, h, accepted)
        if ratio <= 1.0 or (not adaptive and ratio < math.inf):
            reached = interpolate(n, method, steps, t, after, h, accepted, reached, count, times, states)
            doubles(steps.size, 0)[accepted] = h
            implicit, in_a_row = _choose(net, method, steps, h, accepted, implicit, in_a_row)
            accepted += 1
            t = after
            accept(n, method, steps)
        else:
            rejected += int(adaptive)  # a given step that fails ends the solve
        h, last_ratio = _following(h, wanted, ratio, last_ratio, order_of(method, implicit))
    return OK, accepted, rejected, reached


@njit_inner
def _following(h, wanted, ratio, last_ratio, order):
    """Size of the next trial in s, and the error ratio to remember, after one of size `h` where `wanted` was asked for.

    A step that was cut short says nothing against the size that was wanted.
    """
    size = next_step(h, ratio, last_ratio, order)
    if ratio <= 1.0 and h < wanted:
        return max(wanted, size), last_ratio
    return size, max(ratio, SMALLEST_RATIO) if ratio <= 1.0 else last_ratio


@njit_inner
def _choose(net, method, steps, h, step, implicit, in_a_row):
    """Whether the step behind an accepted one is implicit, and the count of `switching.switched`."""
    if method.kind != BOTH or not h > 0.0:
        return implicit, in_a_row
    return switched(implicit, in_a_row, h * fastest(net, method, steps, h, step))


@njit_inner
def _until_knot(drive, t, h, end, ending, jumped, adaptive):
    """Cut a step short at the next knot of the input, or to nothing where an input has just jumped.

    Returns:
        The size that was wanted, the size of the step, the time at its end, whether that is the end of the solve.
    """
    if adaptive and jumped:
        return h, 0.0, t, False
    after, knot = end if ending else t + h, next_knot(drive)
    if adaptive and knot < after:
        return h, knot - t, knot, False
    if not adaptive and abs(after - knot) <= ON_KNOT * h:  # sums of steps meet a knot to rounding
        after = knot
    return h, h, after, ending


@njit_inner
def _start(method, n, steps, start, count, times, states):
    """Copy the initial state to where the first step and the outputs at its time read it; NaN for all other outputs.

    Returns the number of the first output at a later time.
    """
    copy(n, start, doubles(steps.x, 0))
    known = 0
    while known < count and times[known] <= times[0]:
        copy(n, start, shift(states, known * n))
        integers(steps.output_step, 0)[known] = -1
        clear(method.stages, doubles(steps.output_weights, known * method.stages))
        known += 1
    for i in range(known * n, count * n):
        states[i] = math.nan
    return known


@njit_inner
def _stuck(method, t, h, attempts, ratio):
    """Why an adaptive solve cannot go on from time `t` with a step of `h`, `OK` if it can."""
    if attempts >= method.max_steps:
        return MAX_STEPS
    # negated, so that a step of NaN counts as well
    if not h >= SMALLEST_STEP * max(abs(t), 1e-300) or t + h == t:
        return UNDERFLOW if ratio < math.inf else NON_FINITE
    return OK


@njit_inner
def _norm(n, vector, x, method):
    total = 0.0
    for i in range(n):
        part = vector[i] / (method.atol + method.rtol * abs(x[i]))
        total += part * part
    return np.sqrt(total / n)


@njit_inner
def _initial_step(net, method, steps):
    """First step size (E. Hairer, S. P. Norsett, G. Wanner, Solving ODEs I, 2nd ed., Sec. II.4).

    It evaluates the field once, into the record of a stage that the first step overwrites.
    """
    n = net.n
    x, trial, error = doubles(steps.x, 0), doubles(steps.trial, 0), doubles(steps.error, 0)
    first, second = doubles(steps.k, 0), doubles(steps.k, n)
    d0, d1 = _norm(n, x, x, method), _norm(n, first, x, method)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    for i in range(n):
        trial[i] = x[i] + h0 * first[i]
    evaluate_field(net, trial, doubles(steps.record, steps.width), second)
    for i in range(n):
        error[i] = second[i] - first[i]
    d2 = _norm(n, error, x, method) / h0
    if d1 <= 1e-15 and d2 <= 1e-15:
        h1 = max(1e-6, h0 * 1e-3)
    else:
        h1 = (0.01 / (d2 if d2 > d1 else d1)) ** (1.0 / order_of(method, method.kind == IMPLICIT))
    return min(100.0 * h0, h1)
