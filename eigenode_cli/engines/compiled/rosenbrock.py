"""One step of a Rosenbrock method, and its exact derivatives: see `stepper` and `solve.rosenbrock_tableau`.

The stages solve `M k_i = r_i` with `r_i = f(X_i) + sum_j c_ij k_j + h drift_i df/dt` and `M = I / gamma - h J`, J at
the start of the step. A change of J changes k_i by `M^-1 h dJ k_i`, so that the derivatives of J come in through its
product with the vector `v_i = h (k_i, drift_i du/dt)` alone, in states and inputs, which covers `df/dt` as well.
"""

import math

from eigenode_cli.engines.compiled.algebra import add_rows, add_scaled, clear, combine, copy
from eigenode_cli.engines.compiled.bars import pull_back_field, push_field
from eigenode_cli.engines.compiled.curvature import fill_curves, jacobian_rows, pull_back_row
from eigenode_cli.engines.compiled.drive import set_drive
from eigenode_cli.engines.compiled.lu import factorise, solve_factorised, solve_transposed
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.method import place, slot
from eigenode_cli.engines.compiled.mlp import evaluate_field
from eigenode_cli.jit import njit_inner
from eigenode_cli.solve.switching import SQUARINGS


@njit_inner
def attempt_rosenbrock(net, drive, method, steps, t, h, step):
    """Fill stages, their records, `steps.trial` and `steps.error` of a trial step of size `h` from time `t`.

    Returns whether M is regular.
    """
    n, table, stages, lead, width = net.n, method.implicit, method.implicit.stages, net.n - net.m, net.n + net.k
    x, trial, error, k = doubles(steps.x, 0), doubles(steps.trial, 0), doubles(steps.error, 0), doubles(steps.k, 0)
    rows, slope, rate = doubles(steps.rows, 0), doubles(steps.slope, slot(steps, step) * net.k), doubles(steps.rate, 0)
    factors, pivots = doubles(steps.factors, slot(steps, step) * n * n), integers(steps.pivots, slot(steps, step) * n)
    copy(net.k, doubles(drive.slopes, integers(drive.piece, 0)[0] * net.k), slope)
    copy(n, x, trial)
    for j in range(stages):
        if j > 0:
            combine(n, j, x, h, doubles(table.a, j * stages), k, trial)
        record = doubles(steps.record, place(method, steps, step, j))
        set_drive(drive, t + doubles(table.nodes, j)[0] * h)
        evaluate_field(net, trial, record, rate)
        if j == 0:
            jacobian_rows(net, record, rows, doubles(steps.scratch, 0))
            _fill_matrix(net, table.gamma, h, rows, factors)
            if not factorise(n, factors, pivots):
                return False
        stage = shift(k, j * n)
        combine(n, j, rate, 1.0, doubles(table.c, j * stages), k, stage)
        for o in range(net.m):
            for i in range(net.k):
                stage[lead + o] += h * doubles(table.drift, j)[0] * rows[o * width + n + i] * slope[i]
        solve_factorised(n, factors, pivots, 1, stage)
    combine(n, stages, x, h, doubles(table.end, 0), k, trial)
    clear(n, error)
    combine(n, stages, error, h, doubles(table.error, 0), k, error)
    copy(stages * n, k, doubles(steps.solved, slot(steps, step) * method.stages * n))
    return True


@njit_inner
def _fill_matrix(net, gamma, h, rows, matrix):
    """Fill `M = I / gamma - h J (n, n)`; the leading rows of J are those of positions, whose derivatives are states."""
    n, m, width = net.n, net.m, net.n + net.k
    lead = n - m
    clear(n * n, matrix)
    for i in range(lead):
        matrix[i * n + m + i] = -h
    for o in range(m):
        for i in range(n):
            matrix[(lead + o) * n + i] = -h * rows[o * width + i]
    for i in range(n):
        matrix[i * n + i] += 1.0 / gamma


@njit_inner
def fastest_rosenbrock(net, steps):
    """Return an upper estimate of the largest modulus of the spectrum in 1/s, `|J^p|^(1/p)` (Gelfand's formula)."""
    n, power, square, logarithm, exponent = net.n, doubles(steps.powers, 0), doubles(steps.powers, net.n**2), 0.0, 1.0
    _fill_matrix(net, math.inf, -1.0, doubles(steps.rows, 0), power)
    for turn in range(SQUARINGS + 1):
        norm = 0.0
        for r in range(n):
            total = 0.0
            for c in range(n):
                total += abs(power[r * n + c])
            norm = max(norm, total)
        if not 0.0 < norm < math.inf:
            return norm
        logarithm += math.log(norm) / exponent
        exponent *= 2.0
        if turn < SQUARINGS:
            for i in range(n * n):
                power[i] /= norm
            clear(n * n, square)
            for r in range(n):
                add_rows(n, n, n, shift(power, r * n), 1, power, shift(square, r * n))
            power, square = square, power
    return math.exp(logarithm)


@njit_inner
def pull_back_rosenbrock(net, method, steps, bars, channels, step):
    """Pull the cotangents of all channels back from the end of a recorded step to its start.

    With `y_i = M^-T bar k_i`, the cotangent of `r_i`: `bar X_i = (df/dx)^T y_i`, `bar k_j += c_ij y_i + h a_ij bar X_i`
    for j < i, and the rows of J have the cotangents `sum_i y_i v_i^T`.
    """
    n, m, width, q, table, kept = net.n, net.m, net.n + net.k, channels * net.n, method.implicit, slot(steps, step)
    stages, h, directions = table.stages, doubles(steps.size, 0)[step], doubles(bars.directions, 0)
    rates, states, start = doubles(bars.stage_rates, 0), doubles(bars.stage_states, 0), doubles(bars.start, 0)
    k, end, slope = doubles(steps.solved, kept * method.stages * n), states, doubles(steps.slope, kept * net.k)
    factors, pivots = doubles(steps.factors, kept * n * n), integers(steps.pivots, kept * n)
    a, c, bar_state = doubles(table.a, 0), doubles(table.c, 0), shift(states, q)
    clear(channels * m * width, directions)
    for j in range(stages - 1, -1, -1):
        rate, drift = shift(rates, j * q), h * doubles(table.drift, j)[0]
        add_scaled(q, h * doubles(table.end, j)[0], end, rate)
        for channel in range(channels):
            y = shift(rate, channel * n)
            solve_transposed(n, factors, pivots, y)
            for o in range(m):
                direction = shift(directions, (channel * m + o) * width)
                add_scaled(n, h * y[n - m + o], shift(k, j * n), direction)
                add_scaled(net.k, drift * y[n - m + o], slope, shift(direction, n))
        pull_back_field(net, doubles(steps.record, place(method, steps, step, j)), bars, channels, rate, bar_state)
        add_scaled(q, 1.0, bar_state, start)
        for i in range(j):
            add_scaled(q, c[j * stages + i], rate, shift(rates, i * q))
            add_scaled(q, h * a[j * stages + i], bar_state, shift(rates, i * q))
    add_scaled(q, 1.0, end, start)
    curves, record = doubles(bars.curves, 0), doubles(steps.record, place(method, steps, step, 0))
    fill_curves(net, record, curves)
    for channel in range(channels):
        for o in range(m):
            v, packed = shift(directions, (channel * m + o) * width), doubles(bars.packed, channel * net.size)
            pull_back_row(net, record, o, v, curves, shift(start, channel * n), packed)
    copy(q, start, end)


@njit_inner
def push_rosenbrock(net, method, steps, bars, step):
    """Carry the sensitivities from the start of a recorded step to its end, which goes to `bars.tangent_stage`."""
    n, m, size, table, kept = net.n, net.m, net.size, method.implicit, slot(steps, step)
    stages, length, h, v = table.stages, net.n * net.size, doubles(steps.size, 0)[step], doubles(bars.directions, 0)
    state, stage, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_stage, 0), doubles(bars.tangent_k, 0)
    solved, slope = doubles(steps.solved, kept * method.stages * n), doubles(steps.slope, kept * net.k)
    factors, pivots = doubles(steps.factors, kept * n * n), integers(steps.pivots, kept * n)
    curves, first, row_x = doubles(bars.curves, 0), doubles(steps.record, place(method, steps, step, 0)), bars.rows_x
    fill_curves(net, first, curves)
    for j in range(stages):
        combine(length, j, state, h, doubles(table.a, j * stages), k, stage)
        rate = shift(k, j * length)
        push_field(net, doubles(steps.record, place(method, steps, step, j)), bars, stage, rate)
        for i in range(n):
            v[i] = h * solved[j * n + i]
        for i in range(net.k):
            v[n + i] = h * doubles(table.drift, j)[0] * slope[i]
        for o in range(m):
            row, bar_x = shift(rate, (n - m + o) * size), doubles(row_x, 0)
            clear(n, bar_x)
            pull_back_row(net, first, o, v, curves, bar_x, row)
            add_rows(n, size, size, bar_x, 1, state, row)
        combine(length, j, rate, 1.0, doubles(table.c, j * stages), k, rate)
        solve_factorised(n, factors, pivots, size, rate)
    combine(length, stages, state, h, doubles(table.end, 0), k, stage)
