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


BLOCK = 8
"""Rows that `add_rows` reads at once: the sum that they are added to is then loaded and stored once for all of them."""


@njit_inner
def add_rows(count, size, stride, factors, step, rows, y):
    """`y += sum_e factors[e step] rows_e` with `rows (count, size)`, one every `stride`."""
    e = 0
    while e + BLOCK <= count:
        _add_block(size, stride, shift(factors, e * step), step, shift(rows, e * stride), y)
        e += BLOCK
    while e + 2 <= count:
        _add_pair(size, stride, shift(factors, e * step), step, shift(rows, e * stride), y)
        e += 2
    if e < count and factors[e * step] != 0.0:
        add_scaled(size, factors[e * step], shift(rows, e * stride), y)


@njit_sums
def _add_pair(size, stride, factors, step, rows, y):
    first, second, below = factors[0], factors[step], shift(rows, stride)
    for i in range(size):
        y[i] += first * rows[i] + second * below[i]


@njit_sums
def _add_block(size, stride, factors, step, rows, y):
    f0, f1, f2, f3 = factors[0], factors[step], factors[2 * step], factors[3 * step]
    f4, f5, f6, f7 = factors[4 * step], factors[5 * step], factors[6 * step], factors[7 * step]
    x1, x2, x3 = shift(rows, stride), shift(rows, 2 * stride), shift(rows, 3 * stride)
    x4, x5, x6, x7 = shift(rows, 4 * stride), shift(rows, 5 * stride), shift(rows, 6 * stride), shift(rows, 7 * stride)
    for i in range(size):
        front = f0 * rows[i] + f1 * x1[i] + f2 * x2[i] + f3 * x3[i]
        back = f4 * x4[i] + f5 * x5[i] + f6 * x6[i] + f7 * x7[i]
        y[i] += front + back


@njit_sums
def dot(size, x, y):
    """`sum_i x_i y_i`."""
    total = 0.0
    for i in range(size):
        total += x[i] * y[i]
    return total


@njit_sums
def total(size, x):
    """`sum_i x_i`."""
    result = 0.0
    for i in range(size):
        result += x[i]
    return result


@njit_inner
def multiply(rows, columns, matrix, mirror, x, y):
    """`y += M x` for `matrix (rows, columns)` with its transpose in `mirror`; loops run over the longer side."""
    if rows >= columns:
        add_rows(columns, rows, rows, x, 1, mirror, y)
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
def all_finite(size, x, step=1):
    """Whether none of so many elements, one every `step`, is NaN or infinite."""
    finite = True
    for i in range(size):
        finite &= x[i * step] - x[i * step] == 0.0  # but for NaN and infinity
    return finite


@njit_inner
def any_nonzero(size, x):
    """Whether any element is not zero."""
    found = False
    for i in range(size):
        found |= x[i] != 0.0
    return found
