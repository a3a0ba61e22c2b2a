"""The Jacobian of the outputs at one recorded state, and derivatives of its products with a vector.

An implicit step needs both at its start: rows of the Jacobian backwards through the record of the evaluation, and the
derivatives of `S = (dy_o/dx, dy_o/du) v` in the state and the parameters, forwards along v and then backwards. Many
states at once are faster as columns of a block (`jacobian`), a single one here.
"""

from eigenode_cli.engines.compiled.activations import activate_twice
from eigenode_cli.engines.compiled.algebra import add_outer, add_scaled, clear, multiply
from eigenode_cli.engines.compiled.memory import doubles, shift
from eigenode_cli.engines.compiled.mlp import (
    BIAS,
    INPUTS,
    OUTPUTS,
    SLOPE,
    VALUE,
    WEIGHT,
    Net,
    affine,
    layer,
    multiply_transposed,
)
from eigenode_cli.jit import njit_inner


def curve_size(net: Net) -> int:
    """Doubles of the curvatures and tangents of all hidden layers, and of the working space, of `pull_back_row`."""
    return 3 * net.width + 5 * net.widest


@njit_inner
def jacobian_rows(net, record, rows, scratch):
    """Fill `rows (m, n + k)` with the derivatives of the outputs in states and inputs; `scratch (2, widest)`."""
    width, scale_in, scale_out = net.n + net.k, doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    for o in range(net.m):
        bar_z, bar_u, row = scratch, shift(scratch, net.widest), shift(rows, o * width)
        clear(net.m, bar_z)
        bar_z[o] = scale_out[o]
        for level in range(net.last, -1, -1):
            multiply_transposed(net, level, bar_z, bar_u)
            if level > 0:
                slope = shift(record, layer(net, level)[SLOPE])
                for j in range(layer(net, level)[INPUTS]):
                    bar_u[j] *= slope[j]
            bar_z, bar_u = bar_u, bar_z
        for i in range(width):
            row[i] = bar_z[i] * scale_in[i]
        if net.field > net.network:
            add_scaled(width, 1.0, doubles(net.theta, net.network + o * width), row)


@njit_inner
def fill_curves(net, record, curves):
    """Fill the curvatures in `curves (curve_size,)`, the second derivatives of the activations at a recorded state.

    Each hidden layer has three rows there, the other two for `pull_back_row`; its working space is behind all of them.
    """
    z, at = shift(curves, 3 * net.width), 0
    slope = shift(z, net.widest)
    for level in range(net.last):
        size = layer(net, level)[OUTPUTS]
        affine(net, level, shift(record, layer(net, level)[VALUE]), z)
        activate_twice(net.activation, size, z, slope, shift(curves, at))
        at += 3 * size


@njit_inner
def pull_back_row(net, record, output, v, curves, bar_x, packed):
    """Add the derivatives of S: `bar_x (n,) += dS/dx`, `packed (P,) += dS/dtheta` in the order of `add_outer`.

    Args:
        net, record: field, and record of its evaluation at the state.
        output: o, whose derivatives are multiplied with v.
        v: a vector in states and inputs `(n + k,)`.
        curves: of `fill_curves`.
        bar_x, packed: added to.
    """
    width, scale_in, scratch = net.n + net.k, doubles(net.scale_in, 0), shift(curves, 3 * net.width)
    first, bar_v, bar_u = scratch, shift(scratch, net.widest), shift(scratch, 2 * net.widest)
    next_v, next_u = shift(scratch, 3 * net.widest), shift(scratch, 4 * net.widest)
    for i in range(width):
        first[i] = scale_in[i] * v[i]
    at, last = _push_direction(net, record, first, curves)
    clear(net.m, next_v)
    next_v[output] = doubles(net.scale_out, output)[0]
    add_outer(net.m, layer(net, net.last)[INPUTS], next_v, last, shift(packed, layer(net, net.last)[WEIGHT]))
    multiply_transposed(net, net.last, next_v, bar_v)
    clear(layer(net, net.last)[INPUTS], bar_u)
    for level in range(net.last, 0, -1):
        size, slope, below = layer(net, level)[INPUTS], shift(record, layer(net, level)[SLOPE]), layer(net, level - 1)
        at -= 3 * size
        curve, t = shift(curves, at), shift(curves, at + size)
        for j in range(size):
            bar_u[j] = slope[j] * bar_u[j] + curve[j] * bar_v[j] * t[j]
            bar_v[j] *= slope[j]
        weight, under = shift(packed, below[WEIGHT]), first
        if level > 1:
            under = shift(curves, at - below[INPUTS])
        add_scaled(size, 1.0, bar_u, shift(packed, below[BIAS]))
        add_outer(size, below[INPUTS], bar_u, shift(record, below[VALUE]), weight)
        add_outer(size, below[INPUTS], bar_v, under, weight)
        multiply_transposed(net, level - 1, bar_u, next_u)
        multiply_transposed(net, level - 1, bar_v, next_v)
        bar_u, next_u = next_u, bar_u
        bar_v, next_v = next_v, bar_v
    if net.last > 0:
        for i in range(net.n):
            bar_x[i] += scale_in[i] * bar_u[i]
    if net.field > net.network:
        add_scaled(width, 1.0, v, shift(packed, net.network + output * width))


@njit_inner
def _push_direction(net, record, first, curves):
    """Fill the other two rows of each hidden layer with T and V along a scaled direction (`jacobian`).

    Returns where the rows end, and the V of the last hidden layer, the direction itself where there is none.
    """
    at, v = 0, first
    for level in range(1, net.last + 1):
        below, size, slope = layer(net, level - 1), layer(net, level)[INPUTS], shift(record, layer(net, level)[SLOPE])
        t, here = shift(curves, at + size), shift(curves, at + 2 * size)
        clear(size, t)
        weight = below[WEIGHT]
        multiply(size, below[INPUTS], doubles(net.theta, weight), doubles(net.mirror, weight), v, t)
        for j in range(size):
            here[j] = slope[j] * t[j]
        v = here
        at += 3 * size
    return at, v
