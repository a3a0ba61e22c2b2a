"""The Jacobian `A = df/dx` of the vector field at one state, and its pullback to state and parameters.

With unit directions e_k: `V_0 = input_scale_k e_k`, `T_l = W_{l-1} V_{l-1}`, `V_l = act'(z_l) T_l`, and column k of
the network's Jacobian is `output_scale W_D V_D`. Tangents are stored direction by direction, so that every
loop runs over the width of a layer. The pullback needs the second derivative of the activation; nothing of the
size n x n x P is ever made.
"""

from eigenode_cli.engines.compiled.algebra import add_outer, add_scaled, clear, dot, is_mirrored, multiply
from eigenode_cli.engines.compiled.memory import doubles, shift
from eigenode_cli.engines.compiled.mlp import (
    BIAS,
    CURVE,
    INPUTS,
    OUTPUTS,
    SLOPE,
    STRIDE,
    TANGENT,
    VALUE,
    WEIGHT,
    Net,
    layer,
    multiply_transposed,
)
from eigenode_cli.jit import njit_inner, njit_sums


def scratch_size(net: Net) -> int:
    """Doubles of working space that `pull_back_jacobian` needs, which is enough for `mlp.pull_back_outputs`."""
    return 2 * (net.n + 1) * net.widest


@njit_inner
def jacobian(net, record, tangents, a):
    """Fill `a (n, n)` with `df/dx` at a recorded state, and `tangents (net.tangents,)` for the pullback."""
    n, m = net.n, net.m
    lead = n - m
    push_tangents(net, record, tangents)
    clear(lead * n, a)
    for i in range(lead):
        a[i * n + m + i] = 1.0
    scale_in, scale_out = doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    width, at = layer(net, net.last)[INPUTS], layer(net, net.last)[WEIGHT]
    for o in range(m):
        weights, row = doubles(net.theta, at + o * width), shift(a, (lead + o) * n)
        for k in range(n):
            entry = weights[k] * scale_in[k] if net.last == 0 else dot(width, weights, _v(net, net.last, k, tangents))
            row[k] = scale_out[o] * entry


@njit_inner
def _t(net, level, k, tangents):
    """`T_l` in direction k."""
    return shift(tangents, layer(net, level)[TANGENT] + k * layer(net, level)[STRIDE])


@njit_inner
def _v(net, level, k, tangents):
    """`V_l` in direction k."""
    return _t(net, level, net.n + k, tangents)


@njit_sums
def push_tangents(net, record, tangents):
    """Fill `tangents (net.tangents,)` with `T_l` and `V_l` of all hidden layers at a recorded state."""
    scale_in = doubles(net.scale_in, 0)
    for level in range(1, net.last + 1):
        inputs, width, at = layer(net, level - 1)[INPUTS], layer(net, level)[INPUTS], layer(net, level - 1)[WEIGHT]
        slope = shift(record, layer(net, level)[SLOPE])
        for k in range(net.n):
            t, v = _t(net, level, k, tangents), _v(net, level, k, tangents)
            clear(width, t)
            if level == 1:
                add_scaled(width, scale_in[k], doubles(net.mirror, at + k * width), t)
            else:
                below = _v(net, level - 1, k, tangents)
                multiply(width, inputs, doubles(net.theta, at), doubles(net.mirror, at), below, t)
            for j in range(width):
                v[j] = slope[j] * t[j]


@njit_inner
def pull_back_jacobian(net, record, tangents, bar_a, bar_x, packed, scratch):
    """Add the pullback of a cotangent of the Jacobian to those of the state and of the parameters.

    Args:
        net: one whose records hold second derivatives.
        record: of the evaluation at the state.
        tangents: of `push_tangents` there.
        bar_a: cotangent of the last m rows of A `(m, n)`; the others are constant.
        bar_x: cotangent of the state `(n,)`, added to.
        packed: cotangent of the parameters `(P,)` in the order of `algebra.add_outer`, added to.
        scratch: working space of `scratch_size(net)`.
    """
    n, room = net.n, net.widest
    scale_in = doubles(net.scale_in, 0)
    # of each set, channels 0 ... n-1 hold the cotangents of V_l, channel n that of the layer's value
    here, there = scratch, shift(scratch, (n + 1) * room)
    _pull_back_output_layer(net, tangents, bar_a, packed, here, there)
    for level in range(net.last, 0, -1):
        _through_activation(net, level, record, tangents, here)
        width, below = layer(net, level)[INPUTS], layer(net, level - 1)
        inputs, weight = below[INPUTS], shift(packed, below[WEIGHT])
        bar_z = shift(here, n * room)
        add_scaled(width, 1.0, bar_z, shift(packed, below[BIAS]))
        add_outer(width, inputs, bar_z, shift(record, below[VALUE]), weight)
        multiply_transposed(net, level - 1, bar_z, shift(there, n * room))
        for k in range(n):
            bar_t = shift(here, k * room)
            if level == 1:
                _add_to_column(width, n, k, scale_in[k], bar_t, weight)
            else:
                add_outer(width, inputs, bar_t, _v(net, level - 1, k, tangents), weight)
                multiply_transposed(net, level - 1, bar_t, shift(there, k * room))
        here, there = there, here
    if net.last > 0:
        bar_u = shift(here, n * room)
        for i in range(n):
            bar_x[i] += scale_in[i] * bar_u[i]


@njit_inner
def _pull_back_output_layer(net, tangents, bar_a, packed, channels, scratch):
    """Parameters of the output layer; fills `channels` with the cotangents of `V_D` and zero for the layer's value."""
    n, m, room = net.n, net.m, net.widest
    scale_in, scale_out = doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    row = layer(net, net.last)
    weight, bar_y = shift(packed, row[WEIGHT]), scratch
    for k in range(n):
        for o in range(m):
            bar_y[o] = scale_out[o] * bar_a[o * n + k]
        if net.last == 0:
            _add_to_column(m, n, k, scale_in[k], bar_y, weight)
        else:
            add_outer(row[OUTPUTS], row[INPUTS], bar_y, _v(net, net.last, k, tangents), weight)
            multiply_transposed(net, net.last, bar_y, shift(channels, k * room))
    clear(row[INPUTS], shift(channels, n * room))


@njit_sums
def _through_activation(net, level, record, tangents, channels):
    """Cotangents of `V_l` become those of `T_l` in place, that of the layer's value becomes that of `z_l`."""
    row, room = layer(net, level), net.widest
    width, slope, curve = row[INPUTS], shift(record, row[SLOPE]), shift(record, row[CURVE])
    bar_z = shift(channels, net.n * room)
    for j in range(width):
        bar_z[j] *= slope[j]
    for k in range(net.n):
        t, bar_v = _t(net, level, k, tangents), shift(channels, k * room)
        for j in range(width):
            bar_z[j] += curve[j] * bar_v[j] * t[j]
            bar_v[j] *= slope[j]


@njit_inner
def _add_to_column(rows, columns, k, factor, column, product):
    """Add `factor column` to column k of a matrix `(rows, columns)` of the packed gradient."""
    if is_mirrored(rows, columns):
        add_scaled(rows, factor, column, shift(product, k * rows))
    else:
        for r in range(rows):
            product[r * columns + k] += factor * column[r]
