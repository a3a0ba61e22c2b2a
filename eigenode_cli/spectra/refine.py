"""What LAPACK's eigenvectors lack inside clusters of eigenvalues, and in stiff matrices of two states.

Inside a cluster of nearly equal eigenvalues LAPACK's right and left eigenvectors are not dual to one another,
`w_i^H v_j != 0`, so that slopes `w_i^H dA v_i / (w_i^H v_i)` do not add up to those of symmetric functions of the
cluster. Rounding alone causes it: the product is about `eps |A|` over the gap. Two cures, each within the backward
error of the eigenvectors themselves:

- Eigenvalues that are equal to rounding, of a matrix that is not defective there (the null space of `A - lambda I` has
  as many dimensions): both sets of vectors are taken anew from that null space. LAPACK's own may be parallel.
- Any other cluster: the left vectors become the dual ones of the right vectors, `W (W^H V)^-H`, at unit length.

Eigenvalues outside of clusters keep their vectors bit by bit. Where a cluster is defective no dual vectors exist, and
`w_i^H v_i` stays near zero.

In a stiff matrix of two states the smaller eigenvalue has an absolute error of `eps` times the larger one. It is taken
from the determinant, and the vectors from the entries, without cancellation.

The thresholds are those of the njit kernels of the compiled engine as well.
"""

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance, svd

CLOSE = 1e-3
"""Eigenvalues may share a cluster if their gap is at most this part of the largest modulus."""
OVERLAP = 1e-10
"""They share one if `|w_i^H v_j|` is above this part of `|w_j^H v_j|`."""
EQUAL = 1e-10
"""Eigenvalues may be one repeated eigenvalue if their gap is at most this part of the largest modulus."""
NULL = 1e-13
"""They are one if as many singular values of `A - lambda I`, balanced, are at most this part of the largest entry."""
SINGULAR = 1e-15
"""A cluster has no dual vectors if the overlaps of its vectors are singular to this."""
STIFF = 2.0**-20
"""Two real eigenvalues are stiff if the ratio of their moduli is below this."""
UNITS = 1e6
"""Condition that a choice of units may add to an eigenvalue: frequencies from 1e-6 to 1e6 rad/s have less."""

Matrix = NDArray[np.float64] | NDArray[np.complex128]
Complex = NDArray[np.complex128]
Members = NDArray[np.intp]


def refine(stack: Matrix, values: Complex, right: Complex, left: Complex) -> None:
    """Refine unit eigenvectors, one a column, in place; of stiff real matrices of two states the eigenvalues as well.

    Args:
        stack: matrices `(N, n, n)`, finite.
        values: their eigenvalues `(N, n)`; of a real matrix, a pair's members are neighbours, Im > 0 first.
        right, left: unit eigenvectors `(N, n, n)`.
    """
    n, size = values.shape[1], np.abs(values)
    gaps = np.abs(values[:, :, None] - values[:, None, :])
    gaps[:, np.arange(n), np.arange(n)] = np.inf
    for k in np.flatnonzero((gaps <= CLOSE * size.max(1)[:, None, None]).any((1, 2))):
        _refine_clusters(stack[k], values[k], right[k], left[k])
    if n == 2 and not np.iscomplexobj(stack):
        for k in np.flatnonzero((values.imag == 0.0).all(1) & (size.min(1) < STIFF * size.max(1))):
            values[k], right[k], left[k] = _stiff_eigensystem(stack[k], values[k].real)


def _refine_clusters(matrix: Matrix, values: Complex, right: Complex, left: Complex) -> None:
    gaps, largest = np.abs(values[:, None] - values), np.abs(values).max()
    for members in _components(gaps <= EQUAL * largest):
        _take_null_space(matrix, values, members, right, left)
    overlap = np.abs(left.conj().T @ right)
    joined = (gaps <= CLOSE * largest) & (overlap > OVERLAP * np.diag(overlap))
    for members in _components(joined | joined.T):
        _make_dual(members, right, left)
    if not np.iscomplexobj(matrix):
        left.imag[:, values.imag == 0.0] = 0.0
        second = np.flatnonzero(values.imag < 0.0)
        right[:, second], left[:, second] = right[:, second - 1].conj(), left[:, second - 1].conj()


def _components(joined: NDArray[np.bool_]) -> list[Members]:
    """Return the connected components of a symmetric relation `(n, n)` that have more than one member."""
    reached = joined | np.eye(len(joined), dtype=bool)
    for _ in joined:
        reached = reached @ reached
    first = reached.argmax(1)
    return [np.flatnonzero(first == i) for i in np.unique(first) if (first == i).sum() > 1]


def _take_null_space(matrix: Matrix, values: Complex, members: Members, right: Complex, left: Complex) -> None:
    """Take the vectors of a repeated eigenvalue from the null space, unless the matrix is defective there."""
    mean, n, count = values[members].mean(), len(values), len(members)
    # rounding makes pairs of a repeated real eigenvalue; those alone have both members in one cluster
    first = members[(values[members].imag > 0.0) & np.isin(members + 1, members)]
    first = first[:0] if np.iscomplexobj(matrix) else first
    mean = mean.real if first.size > 0 else mean
    balanced, (scale, _) = matrix_balance(matrix, permute=False, separate=True)
    u, singular, vh = svd(balanced - mean * np.eye(n))
    if singular[n - count] > NULL * np.abs(balanced).max():
        return
    v, w = np.zeros((2, n, n), dtype=np.complex128)
    v[:, members] = vh[n - count :].conj().T
    w[:, members] = u[:, n - count :]
    for side in (v, w):
        side[:, first] += 1j * side[:, first + 1]
        side[:, first + 1] = side[:, first].conj()
    right[:, members] = _unit(scale[:, None] * v[:, members])
    left[:, members] = _unit(w[:, members] / scale[:, None])


def _make_dual(members: Members, right: Complex, left: Complex) -> None:
    """Make `w_i^H v_j = 0` for any two members, unless the cluster is defective to rounding."""
    overlap = left[:, members].conj().T @ right[:, members]
    if np.linalg.svd(overlap, compute_uv=False)[-1] > SINGULAR:
        left[:, members] = _unit(np.linalg.solve(overlap, left[:, members].conj().T).conj().T)


def _unit(vectors: NDArray[Any]) -> Complex:
    return vectors / np.linalg.norm(vectors, axis=0)


def _stiff_eigensystem(matrix: Matrix, values: NDArray[np.float64]) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues `(2,)`, right and left unit eigenvectors `(2, 2)` of a stiff real matrix `[[a, b], [c, d]]`.

    `(lambda - d, c)` and `(b, lambda - a)` are right eigenvectors, `(lambda - d, b)` and `(c, lambda - a)` left ones:
    each eigenvalue takes those with the larger difference.
    """
    (a, b), (c, d) = matrix
    large = int(np.abs(values).argmax())
    values = values.copy()
    values[1 - large] = float(Fraction(a) * Fraction(d) - Fraction(b) * Fraction(c)) / values[large]
    right, left = np.zeros((2, 2, 2), dtype=np.complex128)
    for i, value in enumerate(values):
        upper = abs(value - d) >= abs(value - a)
        right[:, i] = (value - d, c) if upper else (b, value - a)
        left[:, i] = (value - d, b) if upper else (c, value - a)
    return values.astype(np.complex128), _unit(right), _unit(left)
