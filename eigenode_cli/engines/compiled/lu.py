"""Small linear systems by elimination with row exchanges: a routine of LAPACK takes longer to call than to run."""

from eigenode_cli.engines.compiled.memory import shift
from eigenode_cli.jit import njit_inner


@njit_inner
def factorise(n, a, pivots):
    """Replace `a (n, n)` by its factors L (unit diagonal) and U, rows exchanged as `pivots (n,)` says.

    Returns whether it is regular.
    """
    for c in range(n):
        best = c
        for r in range(c + 1, n):
            if abs(a[r * n + c]) > abs(a[best * n + c]):
                best = r
        pivots[c] = best
        if not abs(a[best * n + c]) > 0.0:  # negated, so that NaN counts as well
            return False
        for i in range(n if best != c else 0):
            a[c * n + i], a[best * n + i] = a[best * n + i], a[c * n + i]
        for r in range(c + 1, n):
            factor = a[r * n + c] / a[c * n + c]
            a[r * n + c] = factor
            for i in range(c + 1, n):
                a[r * n + i] -= factor * a[c * n + i]
    return True


@njit_inner
def solve_factorised(n, a, pivots, size, b):
    """Replace `b (n, size)` by the solution x of `A x = b`, with the factors of A."""
    for c in range(n):
        if pivots[c] != c:
            x, y = shift(b, c * size), shift(b, pivots[c] * size)
            for i in range(size):
                x[i], y[i] = y[i], x[i]
    for r in range(n):
        for c in range(r):
            _subtract(size, a[r * n + c], shift(b, c * size), shift(b, r * size))
    for r in range(n - 1, -1, -1):
        for c in range(r + 1, n):
            _subtract(size, a[r * n + c], shift(b, c * size), shift(b, r * size))
        row = shift(b, r * size)
        for i in range(size):
            row[i] /= a[r * n + r]


@njit_inner
def solve_transposed(n, a, pivots, b):
    """Replace `b (n,)` by the solution x of `A^T x = b`, with the factors of A."""
    for r in range(n):
        for c in range(r):
            b[r] -= a[c * n + r] * b[c]
        b[r] /= a[r * n + r]
    for r in range(n - 1, -1, -1):
        for c in range(r + 1, n):
            b[r] -= a[c * n + r] * b[c]
    for c in range(n - 1, -1, -1):
        b[c], b[pivots[c]] = b[pivots[c]], b[c]


@njit_inner
def _subtract(size, factor, x, y):
    for i in range(size):
        y[i] -= factor * x[i]
