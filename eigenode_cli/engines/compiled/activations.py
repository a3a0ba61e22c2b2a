"""Activations with first and second derivative, written without branches so that loops over a layer vectorise.

LLVM vectorises no call into the C library, and pip's llvmlite has no vector library, so a layer of 32 scalar tanh
costs several times the matrix products around it. Here exponentials are a polynomial after range reduction (the
scheme of J.-M. Muller, Elementary Functions, 3rd ed., Sec. 11.1), which LLVM turns into vector code.
"""

import math

import numpy as np

from eigenode_cli.engines.compiled.memory import bits_of, float_of
from eigenode_cli.jit import njit_fused

TANH, SIGMOID, RELU, SOFTPLUS, SILU, ELU, SIN, IDENTITY, TANH_LIBM = range(9)
ACTIVATIONS = {
    "tanh": TANH,
    "sigmoid": SIGMOID,
    "relu": RELU,
    "softplus": SOFTPLUS,
    "silu": SILU,
    "elu": ELU,
    "sin": SIN,
    "identity": IDENTITY,
    "tanh_libm": TANH_LIBM,
}
"""Codes by name; `tanh_libm` is the C library's tanh, kept to measure against."""

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 6.93147180369123816490e-01
"""ln 2 with the last 20 bits zero, so that its product with an exponent is exact."""
_LN2_LOW = 1.90821492927058770002e-10
_ROUND = 1.5 * 2.0**52
"""Added to a number below 2^51, it leaves the nearest integer in the low bits of the sum."""
_SIGN = -(2**63)
_BIAS = 1023 << 52
_LARGEST = 708.0
"""exp of it and of its negative are normal numbers."""
_SATURATED = 20.0
"""tanh is 1 to the last bit from here on."""


@njit_fused
def _reduced(x):
    """`p` and a power of two with `exp(x) - 1 = p power + power - 1`, for `|x| <= 708`; NaN stays NaN."""
    shifted = x * _LOG2_E + _ROUND
    exponent = shifted - _ROUND
    r = (x - exponent * _LN2_HIGH) - exponent * _LN2_LOW
    # Taylor's series to r^13: |r| <= ln(2)/2 leaves 5e-18 of r. In pairs (Estrin), which wait less for one another
    r2 = r * r
    r4 = r2 * r2
    low = (0.5 + r * (1.0 / 6.0)) + r2 * (1.0 / 24.0 + r * (1.0 / 120.0))
    middle = (1.0 / 720.0 + r * (1.0 / 5040.0)) + r2 * (1.0 / 40320.0 + r * (1.0 / 362880.0))
    high = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) + r2 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    p = (low + r4 * (middle + r4 * high)) * r2 + r
    return p, float_of((bits_of(shifted) << 52) + _BIAS)


@njit_fused
def _cut(x):
    x = -_LARGEST if x < -_LARGEST else x
    return _LARGEST if x > _LARGEST else x


@njit_fused
def expm1(x):
    """`exp(x) - 1` to a few units in the last place, `x` cut to +-708; NaN stays NaN."""
    p, power = _reduced(_cut(x))
    return p * power + (power - 1.0)


@njit_fused
def tanh(x):
    """Hyperbolic tangent to a few units in the last place: `-q / (2 + q)` with `q = expm1(-2 |x|)`, odd, NaN kept."""
    bits = bits_of(x)
    sign = bits & _SIGN
    size = float_of(bits ^ sign)
    size = _SATURATED if size > _SATURATED else size
    p, power = _reduced(-2.0 * size)
    q = p * power + (power - 1.0)
    return float_of(bits_of(abs(q) / (2.0 + q)) | sign)


@njit_fused
def _sigmoid(z):
    """Down to 0: a floor, however low, would be an eigenvalue where there is none."""
    return 0.0 if z < -_LARGEST else 1.0 / (2.0 + expm1(-z))


@njit_fused
def _tanh_all(z):
    u = tanh(z)
    s = 1.0 - u * u
    return u, s, -2.0 * u * s


@njit_fused
def _tanh_libm_all(z):
    u = math.tanh(z)
    s = 1.0 - u * u
    return u, s, -2.0 * u * s


@njit_fused
def _sigmoid_all(z):
    u = _sigmoid(z)
    s = u * (1.0 - u)
    return u, s, s * (1.0 - 2.0 * u)


@njit_fused
def _relu_all(z):
    slope = 1.0 if z > 0.0 else 0.0
    return (0.0 if z < 0.0 else z), slope, 0.0


@njit_fused
def _softplus_all(z):
    s = _sigmoid(z)
    # max(z, 0) + log(1 + exp(-|z|)) does not overflow
    return (z if z > 0.0 else 0.0) + math.log1p(math.exp(-abs(z))), s, s * (1.0 - s)


@njit_fused
def _silu_all(z):
    g = _sigmoid(z)
    rest = 1.0 - g
    return z * g, g * (1.0 + z * rest), g * rest * (2.0 + z * (1.0 - 2.0 * g))


@njit_fused
def _elu_all(z):
    p, power = _reduced(_cut(0.0 if z > 0.0 else z))
    slope = 0.0 if z < -_LARGEST else p * power + power  # not 1 + expm1: all digits where it is small
    return (z if z > 0.0 else p * power + (power - 1.0)), slope, (0.0 if z > 0.0 else slope)


@njit_fused
def _sin_all(z):
    u = np.sin(z)
    return u, np.cos(z), -u


@njit_fused
def activate(code, size, z, slope):  # noqa: PLR0912  a loop for each activation, not one with a choice inside
    """Overwrite pre-activations `z (size,)` by activations and fill `slope (size,)` with the first derivative."""
    if code == TANH:
        for j in range(size):
            z[j], slope[j], _ = _tanh_all(z[j])
    elif code == SIGMOID:
        for j in range(size):
            z[j], slope[j], _ = _sigmoid_all(z[j])
    elif code == RELU:
        for j in range(size):
            z[j], slope[j], _ = _relu_all(z[j])
    elif code == SOFTPLUS:
        for j in range(size):
            z[j], slope[j], _ = _softplus_all(z[j])
    elif code == SILU:
        for j in range(size):
            z[j], slope[j], _ = _silu_all(z[j])
    elif code == ELU:
        for j in range(size):
            z[j], slope[j], _ = _elu_all(z[j])
    elif code == SIN:
        for j in range(size):
            z[j], slope[j], _ = _sin_all(z[j])
    elif code == TANH_LIBM:
        for j in range(size):
            z[j], slope[j], _ = _tanh_libm_all(z[j])
    else:
        for j in range(size):
            slope[j] = 1.0


@njit_fused
def activate_twice(code, size, z, slope, curve):  # noqa: PLR0912  as above
    """Do the same, and fill `curve (size,)` with the second derivative."""
    if code == TANH:
        for j in range(size):
            z[j], slope[j], curve[j] = _tanh_all(z[j])
    elif code == SIGMOID:
        for j in range(size):
            z[j], slope[j], curve[j] = _sigmoid_all(z[j])
    elif code == RELU:
        for j in range(size):
            z[j], slope[j], curve[j] = _relu_all(z[j])
    elif code == SOFTPLUS:
        for j in range(size):
            z[j], slope[j], curve[j] = _softplus_all(z[j])
    elif code == SILU:
        for j in range(size):
            z[j], slope[j], curve[j] = _silu_all(z[j])
    elif code == ELU:
        for j in range(size):
            z[j], slope[j], curve[j] = _elu_all(z[j])
    elif code == SIN:
        for j in range(size):
            z[j], slope[j], curve[j] = _sin_all(z[j])
    elif code == TANH_LIBM:
        for j in range(size):
            z[j], slope[j], curve[j] = _tanh_libm_all(z[j])
    else:
        for j in range(size):
            slope[j] = 1.0
            curve[j] = 0.0
