"""What the model says of the measured channels: states, their derivatives, and trained offsets of both."""

from eigenode_cli.engines.compiled.algebra import any_nonzero, clear, copy
from eigenode_cli.engines.compiled.bars import pull_back_field, push_field
from eigenode_cli.engines.compiled.memory import booleans, carray, doubles, integers, shift
from eigenode_cli.engines.compiled.mlp import evaluate_field
from eigenode_cli.jit import njit_inner
from eigenode_cli.terms.spectral import SOL


@njit_inner
def show_channels(core, states):
    """Return the channels `(N, C)` at the trajectory `states (N, n)`: itself, where nothing else is measured."""
    setup, n, channels = core.setup, core.net.n, core.setup.channels
    if setup.plain:
        return states
    shown, trained = doubles(core.work.shown, 0), doubles(core.net.theta, core.net.size - setup.offset_count)
    copy(setup.outputs * n, states, doubles(core.work.states, 0))
    for j in range(setup.outputs):
        copy(n, shift(states, j * n), shift(shown, j * channels))
        if has_rates(core, j):
            evaluate_output(core, j, shift(states, j * n))
            copy(n, doubles(core.bars.rate, 0), shift(shown, j * channels + n))
        elif channels > n:
            clear(n, shift(shown, j * channels + n))
        for i in range(setup.offset_count):
            shown[j * channels + integers(setup.offset, 0)[i]] += trained[i]
    return shown


@njit_inner
def has_rates(core, output):
    """Whether any derivative was measured at an output."""
    n, channels, measured = core.net.n, core.setup.channels, False
    mask = carray(booleans(core.setup.mask, output * channels), (channels,))
    for i in range(n, channels):
        measured |= mask[i]
    return measured


@njit_inner
def evaluate_output(core, output, state):
    """Evaluate the field at the state `(n,)` of an output: fills `bars.record` and `bars.rate`."""
    copy(core.net.k, doubles(core.setup.driven, output * core.net.k), doubles(core.drive.now, 0))
    evaluate_field(core.net, state, doubles(core.bars.record, 0), doubles(core.bars.rate, 0))


@njit_inner
def pull_back_rates(core, codes, channels):
    """Pull SOL's slopes in the derivatives back to the trajectory, in `bars.states`, and to the parameters."""
    setup, work, bars, n = core.setup, core.work, core.bars, core.net.n
    bar_rate, bar_x = doubles(bars.bar_rate, 0), doubles(bars.start, 0)
    for term in range(codes.size):
        channel = integers(work.channel, 0)[term]
        if codes[term] != SOL or channel < 0:
            continue
        for j in range(setup.outputs):
            slope = doubles(work.solution_slope, j * setup.channels + n)
            if any_nonzero(n, slope):
                clear(channels * n, bar_rate)
                copy(n, slope, shift(bar_rate, channel * n))
                evaluate_output(core, j, doubles(work.states, j * n))
                pull_back_field(core.net, doubles(bars.record, 0), bars, channels, bar_rate, bar_x)
                bar = doubles(bars.states, (j * channels + channel) * n)
                for i in range(n):
                    bar[i] += bar_x[channel * n + i]


@njit_inner
def add_offsets(core, packed):
    """Add SOL's slopes in the trained offsets to its gradient `(P,)`."""
    setup, slope = core.setup, doubles(core.work.solution_slope, 0)
    gradient = shift(packed, core.net.size - setup.offset_count)
    for i in range(setup.offset_count):
        for j in range(setup.outputs):
            gradient[i] += slope[j * setup.channels + integers(setup.offset, 0)[i]]


@njit_inner
def push_channels(core, output, here):
    """Return the sensitivity of the channels `(C, P)` at an output whose state has the sensitivity `here (n, P)`."""
    setup, net, size = core.setup, core.net, core.net.size
    if setup.plain:
        return here
    shown = doubles(core.bars.tangent_shown, 0)
    copy(net.n * size, here, shown)
    if has_rates(core, output):
        evaluate_output(core, output, doubles(core.work.states, output * net.n))
        push_field(net, doubles(core.bars.record, 0), core.bars, here, shift(shown, net.n * size))
    for i in range(setup.offset_count):
        shown[integers(setup.offset, 0)[i] * size + size - setup.offset_count + i] += 1.0
    return shown
