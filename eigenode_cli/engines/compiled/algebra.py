"""The few vector operations that everything here is made of, on pointers, the sizes first."""

from eigenode_cli.engines.compiled.memory import shift
from eigenode_cli.jit import njit_inner, njit_sums

SHORT = 8
"""Below this length a vector is treated element by element: the set-up of a vector loop would cost more."""


@njit_inner
def clear(size, y):
    """`y = 0`."""
    for i in range(size):
        y[i] = 0.0


@njit_inner
def copy(size, x, y):
    """`y = x`."""
    for i in range(size):
        y[i] = x[i]


@njit_sums
def add_scaled(size, factor, x, y):
    """`y += factor x`."""
    for i in range(size):
        y[i] += factor * x[i]


@njit_sums
def dot(size, x, y):
    """`sum_i x_i y_i`."""
    total = 0.0
    for i in range(size):
        total += x[i] * y[i]
    return total


@njit_inner
def multiply(rows, columns, matrix, mirror, x, y):
    """`y += M x` for `matrix (rows, columns)` with its transpose in `mirror`; loops run over the longer side."""
    if rows >= columns:
        for c in range(columns):
            add_scaled(rows, x[c], shift(mirror, c * rows), y)
    else:
        for r in range(rows):
            y[r] += dot(columns, shift(matrix, r * columns), x)


@njit_inner
def is_mirrored(rows, columns):
    """Whether gradients in a matrix `(rows, columns)` are gathered column by column."""
    return rows >= columns


@njit_inner
def add_outer(rows, columns, y, x, product):
    """`product += y x^T (rows, columns)`, stored along its longer side: column by column where `is_mirrored`."""
    if is_mirrored(rows, columns):
        for c in range(columns):
            add_scaled(rows, x[c], y, shift(product, c * rows))
    else:
        for r in range(rows):
            add_scaled(columns, y[r], x, shift(product, r * columns))


@njit_sums
def combine(n, count, base, factor, weights, vectors, out):
    """`out = base + factor sum_l weights_l vectors_l` with `vectors (count, n)`; `out` may be `base`."""
    if n < SHORT:
        for i in range(n):
            total = 0.0
            for j in range(count):
                total += weights[j] * vectors[j * n + i]
            out[i] = base[i] + factor * total
    else:
        copy(n, base, out)
        for j in range(count):
            add_scaled(n, factor * weights[j], shift(vectors, j * n), out)


@njit_inner
def all_finite(size, x):
    """Whether no element is NaN or infinite."""
    finite = True
    for i in range(size):
        finite &= x[i] - x[i] == 0.0  # but for NaN and infinity
    return finite
