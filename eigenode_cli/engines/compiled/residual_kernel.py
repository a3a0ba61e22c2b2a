"""Residuals of all terms and their derivatives in the parameters, as least squares needs them, in one kernel.

SOL has one residual for every measured value, the difference itself. A spectral term has one for every spectrum: the
root of its value there with squares as errors, so that its square is what the term averages. Derivatives are forward
sensitivities: one Jacobian of the solution, carried along the recorded steps, gives every row.
"""

import math

from eigenode_cli.engines.compiled.algebra import add_rows, all_finite, any_nonzero, clear
from eigenode_cli.engines.compiled.channels import push_channels, show_channels
from eigenode_cli.engines.compiled.integrate import OK
from eigenode_cli.engines.compiled.jacobian import pull_back_block, push_tangents
from eigenode_cli.engines.compiled.kernel import forward
from eigenode_cli.engines.compiled.memory import booleans, carray, complexes, doubles, integers, shift, start_of
from eigenode_cli.engines.compiled.mlp import unpack_gradient
from eigenode_cli.engines.compiled.spectrum import pull_back_closed_forms, pull_back_spectrum
from eigenode_cli.engines.compiled.stepper import end_push, push_output, push_step, start_push
from eigenode_cli.jit import njit, njit_inner
from eigenode_cli.terms.spectral import COUNT, SOL, spectral_terms


@njit
def residual_jacobian(core, steps, given, codes, differentiated, values, states, spectra, residuals, jacobian):
    """Fill `residuals (R,)` and, where they are `differentiated`, their derivatives `jacobian (R, P)`.

    Rows come term by term in the order of `codes`: for SOL every measured value, time after time; for a spectral term
    every spectrum. A spectrum that is not finite, or has nothing to compare, has a residual of zero.

    Args:
        core, steps, given, codes, values, states, spectra: as in `kernel.forward`.

    Returns:
        How the solve ended; residuals are filled where it succeeded.
    """
    status = forward(core, steps, given, codes, differentiated, values, states, spectra)
    if status != OK:
        return status
    first = 0
    for term in range(codes.size):
        if codes[term] == SOL:
            first = _solution_residuals(core, start_of(states), residuals, first)
        else:
            first = _spectral_residuals(core, codes, term, residuals, first)
    if differentiated:
        _differentiate(core, steps, codes, residuals, jacobian)
    return status


@njit_inner
def _solution_residuals(core, states, residuals, first):
    """Fill those of SOL from row `first` on; returns the row behind them."""
    setup, count = core.setup, core.setup.outputs * core.setup.channels
    data, mask = doubles(setup.data, 0), carray(booleans(setup.mask, 0), (count,))
    shown = show_channels(core, states)
    for i in range(count):
        if mask[i]:
            residuals[first] = shown[i] - data[i]
            first += 1
    return first


@njit_inner
def _spectral_residuals(core, codes, term, residuals, first):
    """Fill those of a spectral term from row `first` on, and leave the slopes of their squares in `work.slopes`."""
    for t in range(core.setup.rows):
        residuals[first + t] = math.sqrt(_square(core, codes, term, t))
    return first + core.setup.rows


@njit_inner
def _square(core, codes, term, t):
    """Value of a spectral term at spectrum t with squares as errors; its slopes go to their place in `work.slopes`."""
    setup, work, n, k = core.setup, core.work, core.net.n, core.setup.pair_count
    at = term * setup.rows + t
    value = carray(doubles(work.square, 0), (1,))
    spectral_terms(
        codes[term : term + 1],
        carray(complexes(core.eigen.spectra, t * n), (1, n)),
        carray(doubles(core.eigen.levels, t), (1,)),
        (
            carray(doubles(setup.frequency, t * k), (1, k)),
            carray(doubles(setup.damping, t * k), (1, k)),
            carray(integers(setup.pairs, t), (1,)),
            carray(doubles(setup.stiffness, 2 * t), (1, 2)),
            carray(doubles(setup.frequency_tolerance, t * k), (1, k)),
            carray(doubles(setup.damping_tolerance, t * k), (1, k)),
            carray(doubles(setup.region, 0), (setup.region_size,)),
        ),
        setup.margin,
        carray(integers(work.squares, 0), (COUNT,)),
        setup.delta,
        value,
        carray(complexes(work.slopes, at * n), (1, 1, n)),
        carray(integers(work.compared, 0), (1,)),
        (carray(integers(work.partner, 0), (n,)), carray(integers(work.match, 0), (n,))),
    )
    return value[0]


@njit_inner
def _differentiate(core, steps, codes, residuals, jacobian):
    """Fill `jacobian (R, P)`: carry the solution Jacobian from step to step, and enter its rows at every output."""
    net, method, bars, setup = core.net, core.method, core.bars, core.setup
    state, here = doubles(bars.tangent_state, 0), doubles(bars.tangent_output, 0)
    output_step = integers(steps.output_step, 0)
    start_push(net, steps, bars)
    output, row, spectrum = 0, 0, 0
    while output < setup.outputs and output_step[output] < 0:
        row, spectrum = _enter_output(core, codes, output, row, spectrum, state, residuals, jacobian)
        output += 1
    if output == setup.outputs:
        return
    for step in range(output_step[setup.outputs - 1] + 1):
        h = doubles(steps.size, 0)[step]
        push_step(net, method, steps, bars, step)
        while output < setup.outputs and output_step[output] == step:
            push_output(net, method, steps, bars, h, output)
            row, spectrum = _enter_output(core, codes, output, row, spectrum, here, residuals, jacobian)
            output += 1
        end_push(net, method, bars)


@njit_inner
def _enter_output(core, codes, output, row, spectrum, here, residuals, jacobian):
    """Enter the rows of one output, whose state has the derivatives `here (n, P)`.

    Returns the numbers of SOL's next row among its own, and of the next spectrum.
    """
    net, setup, channels = core.net, core.setup, core.setup.channels
    mask, indices = carray(booleans(setup.mask, 0), (setup.outputs * channels,)), integers(setup.indices, 0)
    taken = spectrum < setup.rows and indices[spectrum] == output
    before, next_row = 0, row
    for term in range(codes.size):
        if codes[term] == SOL:
            next_row, shown = row, push_channels(core, output, here)
            for i in range(channels):
                if mask[output * channels + i]:
                    gradient = shift(start_of(jacobian), (before + next_row) * net.size)
                    unpack_gradient(net, shift(shown, i * net.size), gradient)
                    next_row += 1
            before += setup.measured
        else:
            if taken:
                _enter_spectrum(core, term, spectrum, here, residuals, before + spectrum, jacobian)
            before += setup.rows
    return next_row, spectrum + int(taken)


@njit_inner
def _enter_spectrum(core, term, t, here, residuals, row, jacobian):
    """Enter the row of one spectral term at spectrum t: `d sqrt(v) = dv / (2 sqrt(v))`, zero where v is."""
    net, batch, work, bars, n, m = core.net, core.batch, core.work, core.bars, core.net.n, core.net.m
    columns, gradient = work.columns, shift(start_of(jacobian), row * net.size)
    slopes = doubles(work.slopes, 2 * (term * core.setup.rows + t) * n)
    clear(net.size, gradient)
    if not residuals[row] > 0.0 or not any_nonzero(2 * n, slopes):
        return
    block = t // columns
    record, tangents = doubles(work.records, block * batch.width * columns), doubles(work.tangents, 0)
    if integers(work.pushed, 0)[0] != block:
        push_tangents(batch, columns, record, tangents)
        integers(work.pushed, 0)[0] = block
    rows, bar, c = doubles(work.rows, 0), doubles(work.bar, 0), t - block * columns
    clear(m * n * columns, rows)
    if n == 2:
        pull_back_closed_forms(core.eigen, t, 1, m, slopes, columns, shift(rows, c))
    else:
        pull_back_spectrum(core.eigen, t, m, slopes, bar)
        for i in range(m * n):
            rows[i * columns + c] = bar[i]
    packed, bar_x = doubles(bars.packed, 0), doubles(work.bar_x, 0)
    clear(net.size, packed)
    pull_back_block(batch, columns, record, tangents, rows, bar_x, packed, doubles(work.scratch, 0))
    for i in range(n):
        bar[i] = bar_x[i * columns + c]
    add_rows(n, net.size, net.size, bar, 1, here, packed)
    if not all_finite(net.size, packed):
        return
    unpack_gradient(net, packed, gradient)
    for i in range(net.size):
        gradient[i] /= 2.0 * residuals[row]
