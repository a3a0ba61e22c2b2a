"""The Jacobian `A = df/dx` of the vector field at many states at once, and its pullback to states and parameters.

States are columns of a block: a row holds one number (an entry of a layer, a tangent, an entry of A) for all states,
so that every loop runs over the states, however narrow the network is. With unit directions e_k: `V_0 = input_scale_k
e_k`, `T_l = W_{l-1} V_{l-1}`, `V_l = act'(z_l) T_l`, and column k of the network's Jacobian is `output_scale W_D V_D`.
The pullback needs the second derivative of the activation; nothing of the size n x n x P is ever made.
"""

from eigenode_cli.engines.compiled.activations import activate_twice
from eigenode_cli.engines.compiled.algebra import add_rows, add_scaled, clear, dot, is_mirrored, total
from eigenode_cli.engines.compiled.memory import doubles, shift
from eigenode_cli.engines.compiled.mlp import (
    BIAS,
    CURVE,
    INPUTS,
    OUTPUTS,
    SLOPE,
    TANGENT,
    VALUE,
    WEIGHT,
    Net,
    layer,
)
from eigenode_cli.jit import njit_inner, njit_sums


def scratch_rows(net: Net) -> int:
    """Rows of working space that `pull_back_block` needs."""
    return 2 * (net.n * net.hidden + net.widest)


@njit_inner
def evaluate_block(net, columns, record):
    """Fill `record (net.width, columns)` but for its leading n + k rows, which hold scaled states and inputs."""
    for level in range(net.last):
        inputs, outputs, above = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS], layer(net, level + 1)
        weights, bias = doubles(net.theta, layer(net, level)[WEIGHT]), doubles(net.theta, layer(net, level)[BIAS])
        u = shift(record, layer(net, level)[VALUE] * columns)
        z = shift(record, above[VALUE] * columns)
        for o in range(outputs):
            _fill(columns, bias[o], shift(z, o * columns))
            add_rows(inputs, columns, columns, shift(weights, o * inputs), 1, u, shift(z, o * columns))
        slope, curve = shift(record, above[SLOPE] * columns), shift(record, above[CURVE] * columns)
        activate_twice(net.activation, outputs * columns, z, slope, curve)


@njit_inner
def _fill(size, value, y):
    for i in range(size):
        y[i] = value


@njit_inner
def _t(net, columns, level, k, tangents):
    """Rows of `T_l` in direction k."""
    return shift(tangents, (layer(net, level)[TANGENT] + k * layer(net, level)[INPUTS]) * columns)


@njit_inner
def _v(net, columns, level, k, tangents):
    """Rows of `V_l` in direction k."""
    return _t(net, columns, level, net.n + k, tangents)


@njit_inner
def push_tangents(net, columns, record, tangents):
    """Fill `tangents (net.tangents, columns)` with `T_l` and `V_l` of all hidden layers."""
    scale_in = doubles(net.scale_in, 0)
    for level in range(1, net.last + 1):
        below, width = layer(net, level - 1), layer(net, level)[INPUTS]
        inputs, weights = below[INPUTS], doubles(net.theta, below[WEIGHT])
        slope = shift(record, layer(net, level)[SLOPE] * columns)
        for k in range(net.n):
            t, v = _t(net, columns, level, k, tangents), _v(net, columns, level, k, tangents)
            for j in range(width):
                row = shift(t, j * columns)
                if level == 1:
                    _fill(columns, scale_in[k] * weights[j * inputs + k], row)
                else:
                    clear(columns, row)
                    beneath = _v(net, columns, level - 1, k, tangents)
                    add_rows(inputs, columns, columns, shift(weights, j * inputs), 1, beneath, row)
            _multiply(width * columns, slope, t, v)


@njit_inner
def _multiply(size, x, y, product):
    for i in range(size):
        product[i] = x[i] * y[i]


@njit_inner
def jacobian_block(net, columns, tangents, a):
    """Fill `a (m n, columns)` with the last m rows of `df/dx`; the others are constant."""
    scale_in, scale_out = doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    width, weights = layer(net, net.last)[INPUTS], doubles(net.theta, layer(net, net.last)[WEIGHT])
    for o in range(net.m):
        for k in range(net.n):
            row = shift(a, (o * net.n + k) * columns)
            if net.last == 0:
                _fill(columns, weights[o * width + k] * scale_in[k], row)
            else:
                clear(columns, row)
                beneath = _v(net, columns, net.last, k, tangents)
                add_rows(width, columns, columns, shift(weights, o * width), 1, beneath, row)
            for t in range(columns):
                row[t] *= scale_out[o]
            if net.field > net.network:
                entry = doubles(net.theta, net.network + o * (net.n + net.k) + k)[0]
                for t in range(columns):
                    row[t] += entry


@njit_inner
def pull_back_block(net, columns, record, tangents, bar_a, bar_x, packed, scratch):
    """Pull cotangents of the Jacobians back to the states and, summed over them, to the parameters.

    Args:
        net: with the table of blocks.
        columns: number of states, in whole cache lines; behind the last one cotangents are zero.
        record, tangents: of `evaluate_block` and `push_tangents`.
        bar_a: cotangents of the last m rows of A `(m n, columns)`, overwritten.
        bar_x: filled with the cotangents of the states `(n, columns)`.
        packed: cotangent of the parameters `(P,)` in the order of `algebra.add_outer`, added to.
        scratch: working space `(scratch_rows(net), columns)`.
    """
    n, room = net.n, net.hidden * columns
    scale_in = doubles(net.scale_in, 0)
    # of each set, channels 0 ... n-1 hold the cotangents of V_l, channel n that of the layer's value
    here, there = scratch, shift(scratch, n * room + net.widest * columns)
    clear(n * columns, bar_x)
    if net.field > net.network:
        for o in range(net.m):
            for i in range(n):
                entry = net.network + o * (n + net.k) + i
                packed[entry] += total(columns, shift(bar_a, (o * n + i) * columns))
    _pull_back_output_layer(net, columns, tangents, bar_a, packed, here)
    for level in range(net.last, 0, -1):
        _through_activation(net, columns, level, record, tangents, here)
        below = layer(net, level - 1)
        inputs, weight, bar_z = below[INPUTS], shift(packed, below[WEIGHT]), shift(here, n * room)
        width, value = layer(net, level)[INPUTS], shift(record, below[VALUE] * columns)
        for j in range(width):
            packed[below[BIAS] + j] += total(columns, shift(bar_z, j * columns))
        _add_products(columns, width, inputs, bar_z, value, weight)
        _multiply_transposed(net, columns, level - 1, bar_z, shift(there, n * room))
        for k in range(n):
            bar_t = shift(here, k * room)
            if level == 1:
                for j in range(width):
                    entry = _entry(width, inputs, j, k)
                    weight[entry] += scale_in[k] * total(columns, shift(bar_t, j * columns))
            else:
                _add_products(columns, width, inputs, bar_t, _v(net, columns, level - 1, k, tangents), weight)
                _multiply_transposed(net, columns, level - 1, bar_t, shift(there, k * room))
        here, there = there, here
    if net.last > 0:
        for i in range(n):
            add_scaled(columns, scale_in[i], shift(here, n * room + i * columns), shift(bar_x, i * columns))


@njit_inner
def _pull_back_output_layer(net, columns, tangents, bar_a, packed, channels):
    """Parameters of the output layer; fills `channels` with the cotangents of `V_D` and zero for the layer's value."""
    n, m, room = net.n, net.m, net.hidden * columns
    scale_in, scale_out = doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    row = layer(net, net.last)
    width, weight, weights = row[INPUTS], shift(packed, row[WEIGHT]), doubles(net.theta, row[WEIGHT])
    for o in range(m):
        for i in range(o * n * columns, (o + 1) * n * columns):
            bar_a[i] *= scale_out[o]
    for k in range(n):
        for j in range(width):
            bar_v = shift(channels, k * room + j * columns)
            if net.last == 0:
                if j == k:
                    for o in range(m):
                        bar_y = shift(bar_a, (o * n + k) * columns)
                        weight[_entry(m, width, o, k)] += scale_in[k] * total(columns, bar_y)
            else:
                v = shift(_v(net, columns, net.last, k, tangents), j * columns)
                for o in range(m):
                    weight[_entry(m, width, o, j)] += dot(columns, shift(bar_a, (o * n + k) * columns), v)
                clear(columns, bar_v)
                add_rows(m, columns, n * columns, shift(weights, j), width, shift(bar_a, k * columns), bar_v)
    clear(width * columns, shift(channels, n * room))


@njit_sums
def _through_activation(net, columns, level, record, tangents, channels):
    """Cotangents of `V_l` become those of `T_l` in place, that of the layer's value becomes that of `z_l`."""
    row, room = layer(net, level), net.hidden * columns
    size, slope, curve = row[INPUTS] * columns, shift(record, row[SLOPE] * columns), shift(record, row[CURVE] * columns)
    bar_z = shift(channels, net.n * room)
    for i in range(size):
        bar_z[i] *= slope[i]
    for k in range(net.n):
        t, bar_v = _t(net, columns, level, k, tangents), shift(channels, k * room)
        for i in range(size):
            bar_z[i] += curve[i] * bar_v[i] * t[i]
            bar_v[i] *= slope[i]


@njit_inner
def _entry(rows, columns, r, c):
    """Where entry `[r, c]` of a matrix `(rows, columns)` stands in the packed gradient."""
    return c * rows + r if is_mirrored(rows, columns) else r * columns + c


@njit_inner
def _add_products(columns, rows, inputs, y, x, weight):
    """`weight += y x^T` summed over the columns, for `y (rows, columns)` and `x (inputs, columns)`."""
    for r in range(rows):
        for c in range(inputs):
            weight[_entry(rows, inputs, r, c)] += dot(columns, shift(y, r * columns), shift(x, c * columns))


@njit_inner
def _multiply_transposed(net, columns, level, z, u):
    """`u = W_l^T z` for all columns."""
    inputs, outputs = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS]
    weights = doubles(net.theta, layer(net, level)[WEIGHT])
    for i in range(inputs):
        row = shift(u, i * columns)
        clear(columns, row)
        add_rows(outputs, columns, columns, shift(weights, i), inputs, z, row)
