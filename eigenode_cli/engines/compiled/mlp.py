"""The vector field: a multilayer perceptron inside a structure, its value and its pullback (vector-Jacobian product).

An evaluation leaves a record: the input of every layer and the slopes of the activations at it. With it the pullback
evaluates no activation again. Jacobians are taken at many states at once (`jacobian`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.compiled.activations import ACTIVATIONS, activate
from eigenode_cli.engines.compiled.algebra import add_outer, add_scaled, clear, copy, is_mirrored, multiply
from eigenode_cli.engines.compiled.memory import address, doubles, integers, shift, whole_lines
from eigenode_cli.jit import njit_inner

COLUMNS = 8
INPUTS, OUTPUTS, WEIGHT, BIAS, VALUE, SLOPE, CURVE, TANGENT = range(COLUMNS)
"""Columns of a layer table: dimensions; where weight and bias stand in theta; where the layer's input and the slopes
and curvatures of the activation that made it stand in a record; where its tangents stand. The last two are of blocks
only (`jacobian`)."""


@dataclass(frozen=True)
class MlpShape:
    """What is fixed of a vector field `dx/dt = f(x; theta)`; theta is flat in the order of torch's parameters.

    Attributes:
        sizes: dimensions of input n + k, hidden layers, output m.
        activation: of the hidden layers, one of `activations.ACTIVATIONS`; the output layer is linear.
        structure: `second_order` (n = 2 m, the second half of the state is the derivative of the first and the
            network gives the derivative of the second) or `full` (m = n).
        input_scale: factors of the states and then of the inputs `(n + k,)`.
        output_scale: factors of the outputs `(m,)`.
        linear: whether a matrix `(m, n + k)`, behind the network in theta, is multiplied with both and added.
        inputs: number k of the inputs `u(t)`.
    """

    sizes: tuple[int, ...]
    activation: str
    structure: str
    input_scale: Floats
    output_scale: Floats
    linear: bool = False
    inputs: int = 0

    def __post_init__(self) -> None:
        if len(self.sizes) < 2 or min(self.sizes) < 1:
            raise ValueError(f"sizes={self.sizes}: an input and an output are needed, each at least 1")
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation={self.activation}: choose from {', '.join(ACTIVATIONS)}")
        n, m = self.states, self.sizes[-1]
        outputs = {"second_order": n // 2 if n % 2 == 0 else -1, "full": n}
        if self.structure not in outputs:
            raise ValueError(f"structure={self.structure}: choose from {', '.join(outputs)}")
        if m != outputs[self.structure]:
            raise ValueError(f"structure={self.structure}: {n} states and {m} outputs do not fit")
        if self.input_scale.shape != self.sizes[:1] or self.output_scale.shape != (m,):
            raise ValueError(f"scales must have the shapes ({self.sizes[0]},) and ({m},)")

    @property
    def states(self) -> int:
        """Number of states n."""
        return self.sizes[0] - self.inputs

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return self.network_parameters + self.linear * self.sizes[0] * self.sizes[-1]

    @property
    def network_parameters(self) -> int:
        """Number of those of the network, which come first."""
        return sum((a + 1) * b for a, b in zip(self.sizes[:-1], self.sizes[1:], strict=True))


class Net(NamedTuple):
    """A shape and its parameters as the kernels read them.

    Attributes:
        layers: address of the layer table `(last + 1, COLUMNS)` int64.
        last: index of the output layer.
        n, k, m, size: number of states, inputs, outputs, and of all parameters, those of unknown initial values and
            offsets included.
        network, field: number of the network's parameters, which come first; and with the linear part's, `(m, n + k)`
            row by row, behind them. Equal where there is no linear part.
        activation: its code.
        scale_in, scale_out: addresses of the scales `(n + k,)` and `(m,)`.
        drive: address of the inputs' present values `(k,)`, which `drive.set_drive` sets.
        theta, mirror: addresses of the parameters `(size,)`, and of the same with every weight matrix transposed.
        width: doubles that one evaluation leaves in a record, or rows that a block of them leaves.
        widest: the longest of all layers, in whole cache lines; `hidden` the longest of the hidden ones.
        tangents: rows of the tangents of all hidden layers in all directions, of blocks (`jacobian`).
    """

    layers: int
    last: int
    n: int
    k: int
    m: int
    size: int
    network: int
    field: int
    activation: int
    scale_in: int
    scale_out: int
    drive: int
    theta: int
    mirror: int
    width: int
    widest: int
    hidden: int
    tangents: int


def layer_table(shape: MlpShape, blocks: bool) -> NDArray[np.int64]:
    """Return the layer table of a shape `(D + 1, COLUMNS)`.

    Args:
        shape: of the field.
        blocks: places are rows of a block, otherwise doubles of the record of one state, at whole cache lines.
    """
    table = np.zeros((len(shape.sizes) - 1, COLUMNS), dtype=np.int64)
    parameter, at, tangent = 0, 0, 0
    for level, (inputs, outputs) in enumerate(zip(shape.sizes[:-1], shape.sizes[1:], strict=True)):
        stride = inputs if blocks else whole_lines(inputs)
        places = [at, at + stride, at + 2 * stride]
        table[level] = [inputs, outputs, parameter, parameter + inputs * outputs, *places, tangent]
        parameter += (inputs + 1) * outputs
        at += stride * (1 if level == 0 else 3 if blocks else 2)
        tangent += 0 if level == 0 else 2 * shape.states * inputs
    return table


def build_net(
    shape: MlpShape,
    blocks: bool,
    table: NDArray[np.int64],
    scales: tuple[Floats, Floats],
    memory: tuple[Floats, Floats],
    drive: int,
) -> Net:
    """Return the net of a shape on the caller's buffers.

    Args:
        shape, blocks: of the field, and whether the net is that of blocks.
        table, scales: layer table and scales.
        memory: room for theta and mirror `(P,)`.
        drive: address of the inputs' present values.
    """
    hidden = shape.sizes[1:-1]
    stride = list(hidden) if blocks else [whole_lines(size) for size in hidden]
    first = shape.sizes[0] if blocks else whole_lines(shape.sizes[0])
    return Net(
        layers=address(table),
        last=len(table) - 1,
        n=shape.states,
        k=shape.inputs,
        m=shape.sizes[-1],
        size=memory[0].size,
        network=shape.network_parameters,
        field=shape.parameters,
        activation=ACTIVATIONS[shape.activation],
        scale_in=address(scales[0]),
        scale_out=address(scales[1]),
        drive=drive,
        theta=address(memory[0]),
        mirror=address(memory[1]),
        width=first + (3 if blocks else 2) * sum(stride),
        widest=whole_lines(max(shape.sizes)),
        hidden=max(hidden, default=0),
        tangents=2 * shape.states * sum(hidden),
    )


@njit_inner
def layer(net, level):
    """Row of the layer table: a pointer to its columns."""
    return integers(net.layers, level * COLUMNS)


@njit_inner
def mirror_weights(net):
    """Fill `net.mirror` from `net.theta`."""
    theta, mirror = doubles(net.theta, 0), doubles(net.mirror, 0)
    for level in range(net.last + 1):
        inputs, outputs, at = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS], layer(net, level)[WEIGHT]
        for r in range(outputs):
            for c in range(inputs):
                mirror[at + c * outputs + r] = theta[at + r * inputs + c]


@njit_inner
def unpack_gradient(net, packed, gradient):
    """Bring a gradient `(P,)` from the order it was gathered in (`algebra.add_outer`) into that of theta."""
    for level in range(net.last + 1):
        inputs, outputs = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS]
        at, bias = layer(net, level)[WEIGHT], layer(net, level)[BIAS]
        if is_mirrored(outputs, inputs):
            for r in range(outputs):
                for c in range(inputs):
                    gradient[at + r * inputs + c] = packed[at + c * outputs + r]
        else:
            copy(inputs * outputs, shift(packed, at), shift(gradient, at))
        copy(outputs, shift(packed, bias), shift(gradient, bias))
    copy(net.size - net.network, shift(packed, net.network), shift(gradient, net.network))


@njit_inner
def evaluate_field(net, x, record, rate):
    """Fill `rate (n,)` with `f(x, u)` at the state `x (n,)`, and `record (net.width,)` with what derivatives need."""
    n, k, m = net.n, net.k, net.m
    scale_in, scale_out, drive = doubles(net.scale_in, 0), doubles(net.scale_out, 0), doubles(net.drive, 0)
    u = record
    for i in range(n):
        u[i] = x[i] * scale_in[i]
    for i in range(k):
        u[n + i] = drive[i] * scale_in[n + i]
    for level in range(net.last):
        size, above = layer(net, level)[OUTPUTS], layer(net, level + 1)
        z, slope = shift(record, above[VALUE]), shift(record, above[SLOPE])
        affine(net, level, u, z)
        activate(net.activation, size, z, slope)
        u = z
    lead = n - m
    y = shift(rate, lead)
    affine(net, net.last, u, y)
    for o in range(m):
        y[o] *= scale_out[o]
    if net.field > net.network:
        linear = doubles(net.theta, net.network)
        for o in range(m):
            for i in range(n):
                y[o] += linear[o * (n + k) + i] * x[i]
            for i in range(k):
                y[o] += linear[o * (n + k) + n + i] * drive[i]
    for i in range(lead):
        rate[i] = x[m + i]


@njit_inner
def affine(net, level, u, z):
    """`z = W_l u + b_l`."""
    inputs, outputs, at = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS], layer(net, level)[WEIGHT]
    copy(outputs, doubles(net.theta, layer(net, level)[BIAS]), z)
    multiply(outputs, inputs, doubles(net.theta, at), doubles(net.mirror, at), u, z)


@njit_inner
def multiply_transposed(net, level, z, u):
    """`u = W_l^T z`."""
    inputs, outputs, at = layer(net, level)[INPUTS], layer(net, level)[OUTPUTS], layer(net, level)[WEIGHT]
    clear(inputs, u)
    multiply(inputs, outputs, doubles(net.mirror, at), doubles(net.theta, at), z, u)


@njit_inner
def pull_back_outputs(net, record, seed, bar_x, packed, scratch):
    """Add the pullback of a cotangent of the outputs: `bar_x += (dy/dx)^T seed`, `packed += (dy/dtheta)^T seed`.

    Args:
        record: of the evaluation.
        seed: cotangent of the outputs `(m,)`.
        bar_x: cotangent of the state `(n,)`, added to.
        packed: cotangent of the parameters `(P,)` in the order of `algebra.add_outer`, added to.
        scratch: working space, two times `net.widest`.
    """
    scale_in, scale_out = doubles(net.scale_in, 0), doubles(net.scale_out, 0)
    bar_z, bar_u = scratch, shift(scratch, net.widest)
    for o in range(net.m):
        bar_z[o] = seed[o] * scale_out[o]
    for level in range(net.last, -1, -1):
        row = layer(net, level)
        inputs, outputs = row[INPUTS], row[OUTPUTS]
        add_scaled(outputs, 1.0, bar_z, shift(packed, row[BIAS]))
        add_outer(outputs, inputs, bar_z, shift(record, row[VALUE]), shift(packed, row[WEIGHT]))
        multiply_transposed(net, level, bar_z, bar_u)
        if level > 0:
            slope = shift(record, row[SLOPE])
            for j in range(inputs):
                bar_u[j] *= slope[j]
        bar_z, bar_u = bar_u, bar_z
    for i in range(net.n):
        bar_x[i] += bar_z[i] * scale_in[i]
    if net.field > net.network:
        _pull_back_linear(net, record, seed, bar_x, packed)


@njit_inner
def _pull_back_linear(net, record, seed, bar_x, packed):
    """Add the pullback of the outputs' cotangent `seed (m,)` through the linear part.

    `record` holds scaled states and inputs.
    """
    n, width, scale_in = net.n, net.n + net.k, doubles(net.scale_in, 0)
    linear = doubles(net.theta, net.network)
    for o in range(net.m):
        for i in range(n):
            bar_x[i] += linear[o * width + i] * seed[o]
        for i in range(width):
            packed[net.network + o * width + i] += seed[o] * record[i] / scale_in[i]
