"""Cotangents of the trajectory pulled back to the parameters through the recorded steps, all terms at once.

Two ways, exact derivatives of the same steps, so they agree to round-off: the discrete adjoint (backpropagation
through the steps and their dense output) and forward sensitivities (the paper's Equ. 13: one Jacobian of the
solution, shared by all terms). Step sizes count as constants.
"""

from eigenode_cli.engines.compiled.algebra import add_rows, add_scaled, any_nonzero, clear
from eigenode_cli.engines.compiled.bars import pull_back_field
from eigenode_cli.engines.compiled.memory import doubles, integers, shift
from eigenode_cli.engines.compiled.stepper import end_push, pull_back_step, push_output, push_step, start_push
from eigenode_cli.jit import njit_inner


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
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by the discrete adjoint."""
    q = channels * net.n
    output = _last_output(outputs, q, doubles(bars.states, 0))
    if output > 0:
        start, carried, end = doubles(bars.start, 0), doubles(bars.carried, 0), doubles(bars.stage_states, 0)
        clear(q, carried)
        clear(q, end)
        for step in range(integers(steps.output_step, 0)[output], -1, -1):
            output = _gather_outputs(net, method, steps, bars, channels, step, output)
            pull_back_step(net, method, steps, bars, channels, step)
        pull_back_field(net, doubles(steps.record, 0), bars, channels, carried, end)
        add_scaled(q, 1.0, start, end)
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
    unknown = integers(bars.unknown, 0)
    for c in range(channels):
        gradient = doubles(bars.packed, c * net.size + bars.initial)
        for i in range(bars.unknown_count):
            gradient[i] += bar_x[c * net.n + unknown[i]]


@njit_inner
def forward_sensitivities(net, method, steps, bars, channels, outputs):
    """Add the pullback of `bars.states` for N = `outputs` to `bars.packed` by forward sensitivities along the steps.

    The solution Jacobian `(n, P)` is carried from step to step and contracted with the cotangents of the outputs in
    each, so that it is never stored.
    """
    stages = method.stages
    final = _last_output(outputs, channels * net.n, doubles(bars.states, 0))
    _add_first_outputs(net, steps, bars, channels, outputs)
    if final == 0:
        return
    output_step, output = integers(steps.output_step, 0), 0
    start_push(net, steps, bars)
    for step in range(output_step[final] + 1):
        h, before = doubles(steps.size, 0)[step], output
        while output < final and output_step[output + 1] <= step:
            output += 1
        push_step(net, method, steps, bars, step)
        inside = output - before
        if inside * (stages + channels) < channels * (stages + 1):
            for number in range(before + 1, output + 1):
                _contract_output(net, method, steps, bars, channels, h, number)
        else:
            _contract_stages(net, method, steps, bars, channels, step, output)
        end_push(net, method, bars)


@njit_inner
def _contract_output(net, method, steps, bars, channels, h, output):
    """Add the sensitivity of one output of a step, interpolated, times its cotangents: cheap for many channels."""
    n, here = net.n, doubles(bars.tangent_output, 0)
    push_output(net, method, steps, bars, h, output)
    for c in range(channels):
        bar = doubles(bars.states, (output * channels + c) * n)
        add_rows(n, net.size, net.size, bar, 1, here, doubles(bars.packed, c * net.size))


@njit_inner
def _contract_stages(net, method, steps, bars, channels, step, output):
    """Do the same for all outputs of a step, the last of them number `output`, through its stages."""
    n, stages, q = net.n, method.stages, channels * net.n
    _gather_outputs(net, method, steps, bars, channels, step, output)
    state, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_k, 0)
    for c in range(channels):
        gradient = doubles(bars.packed, c * net.size)
        add_rows(n, net.size, net.size, doubles(bars.start, c * n), 1, state, gradient)
        for i in range(n):
            factors = doubles(bars.stage_rates, c * n + i)
            add_rows(stages, net.size, n * net.size, factors, q, shift(k, i * net.size), gradient)
