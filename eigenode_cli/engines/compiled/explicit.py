"""One step of an explicit Runge-Kutta method, and its derivatives: see `stepper`."""

from eigenode_cli.engines.compiled.algebra import add_scaled, clear, combine, copy
from eigenode_cli.engines.compiled.bars import pull_back_field, push_field
from eigenode_cli.engines.compiled.drive import set_drive
from eigenode_cli.engines.compiled.memory import doubles, shift
from eigenode_cli.engines.compiled.method import BOTH, place
from eigenode_cli.engines.compiled.mlp import evaluate_field
from eigenode_cli.jit import njit_inner


@njit_inner
def attempt_explicit(net, drive, method, steps, t, h, step):
    """Fill stages, their records, `steps.trial` and `steps.error` of a trial step of size `h` from time `t`."""
    n, table, stages = net.n, method.explicit, method.explicit.stages
    x, trial, error, k = doubles(steps.x, 0), doubles(steps.trial, 0), doubles(steps.error, 0), doubles(steps.k, 0)
    if method.kind == BOTH:
        set_drive(drive, t)
        evaluate_field(net, x, doubles(steps.record, place(method, steps, step, 0)), k)
    for j in range(1, stages):
        combine(n, j, x, h, doubles(table.a, j * stages), k, trial)
        record = doubles(steps.record, place(method, steps, step, j))
        set_drive(drive, t + doubles(table.nodes, j)[0] * h)
        evaluate_field(net, trial, record, shift(k, j * n))
    clear(n, error)
    combine(n, stages, error, h, doubles(table.error, 0), k, error)


@njit_inner
def fastest_explicit(net, method, steps, h):
    """Estimate the largest modulus of the spectrum in 1/s from the last two stages of the step that was tried."""
    n, stages, widest, apart = net.n, method.explicit.stages, 0.0, 0.0
    state, k, trial = doubles(steps.rate, 0), doubles(steps.k, (stages - 2) * net.n), doubles(steps.trial, 0)
    weights = doubles(method.explicit.a, (stages - 2) * stages)
    combine(n, stages - 2, doubles(steps.x, 0), h, weights, doubles(steps.k, 0), state)
    for i in range(n):
        widest, apart = max(widest, abs(k[n + i] - k[i])), max(apart, abs(trial[i] - state[i]))
    return widest / apart if apart > 0.0 else 0.0


@njit_inner
def pull_back_explicit(net, method, steps, bars, channels, step):
    """Pull the cotangents of all channels back from the end of a recorded step to its start.

    Stage j of a step from x: `X_j = x + h sum_(l<j) a_jl k_l`, `k_j = f(X_j)`; the last one is the state at the end
    and the first one of the next step. Backwards, with bars for cotangents: `bar k_j = (outputs, next step) + h
    sum_(l>j) a_lj bar X_l`, `bar X_j = (df/dx)^T bar k_j`, `bar x = (outputs) + sum_j bar X_j`.
    """
    q, stages, h = channels * net.n, method.explicit.stages, doubles(steps.size, 0)[step]
    rates, states = doubles(bars.stage_rates, 0), doubles(bars.stage_states, 0)
    start, carried, end = doubles(bars.start, 0), doubles(bars.carried, 0), states
    transposed = doubles(method.explicit.transposed, 0)
    add_scaled(q, 1.0, carried, shift(rates, (stages - 1) * q))
    for j in range(stages - 1, 0, -1):
        rate, state, behind = shift(rates, j * q), shift(states, j * q), stages - 1 - j
        combine(q, behind, rate, h, shift(transposed, j * stages + j + 1), shift(state, q), rate)
        record = doubles(steps.record, place(method, steps, step, j))
        pull_back_field(net, record, bars, channels, rate, state)
        if j == stages - 1:
            add_scaled(q, 1.0, end, state)
        add_scaled(q, 1.0, state, start)
    combine(q, stages - 1, rates, h, shift(transposed, 1), shift(states, q), carried)
    if method.kind == BOTH:  # the first stage belongs to this step alone
        pull_back_field(net, doubles(steps.record, place(method, steps, step, 0)), bars, channels, carried, end)
        add_scaled(q, 1.0, end, start)
        clear(q, carried)
    copy(q, start, end)


@njit_inner
def push_explicit(net, method, steps, bars, step):
    """Carry the sensitivities from the start of a recorded step through its stages."""
    stages, length, h = method.explicit.stages, net.n * net.size, doubles(steps.size, 0)[step]
    state, stage, k = doubles(bars.tangent_state, 0), doubles(bars.tangent_stage, 0), doubles(bars.tangent_k, 0)
    if method.kind == BOTH:
        push_field(net, doubles(steps.record, place(method, steps, step, 0)), bars, state, k)
    for j in range(1, stages):
        combine(length, j, state, h, doubles(method.explicit.a, j * stages), k, stage)
        record = doubles(steps.record, place(method, steps, step, j))
        push_field(net, record, bars, stage, shift(k, j * length))
