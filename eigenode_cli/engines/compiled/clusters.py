"""Dual eigenvectors inside clusters of nearly equal eigenvalues: `spectra.refine` for compiled code.

LAPACK's right and left eigenvectors are not dual there, `w_i^H v_j != 0`, so that slopes do not add up to those of
symmetric functions of the cluster. Vectors of a repeated eigenvalue are taken anew from the null space of
`A - lambda I`, unless the matrix is defective there; of any other cluster the left vectors become the dual ones of the
right vectors. Eigenvalues outside of clusters keep their vectors bit by bit.
"""

import math
from typing import NamedTuple

from eigenode_cli.engines.compiled.lapack import dgebal, zgesvd
from eigenode_cli.engines.compiled.memory import complexes, doubles, integers
from eigenode_cli.jit import njit_inner
from eigenode_cli.spectra.refine import CLOSE, EQUAL, NULL, OVERLAP, SINGULAR


class Cluster(NamedTuple):
    """Working space, as addresses, and LAPACK's routines.

    Attributes:
        label: the first eigenvalue of the cluster that each one belongs to, int64 `(n,)`.
        members: numbers of the eigenvalues of one cluster, int64 `(n,)`.
        overlap: `w_i^H v_j` `(n, n)` and then those of one cluster, complex.
        balanced, scale: the balanced matrix `(n, n)`, and the scaling of its states `(n,)`.
        shifted: `A - lambda I`, destroyed, complex `(n, n)`.
        left, right: its singular vectors, complex `(n, n)`, one a column and one a row, as LAPACK stores them.
        singular: its singular values `(n,)`.
        space_size, space, real_space: of LAPACK, complex `(space_size,)` and `(5 n,)`.
        balance, decompose: addresses of LAPACK's routines.
    """

    label: int
    members: int
    overlap: int
    balanced: int
    scale: int
    shifted: int
    left: int
    right: int
    singular: int
    space_size: int
    space: int
    real_space: int
    balance: int
    decompose: int


@njit_inner
def refine_clusters(eigen, a, per_unit, at):
    """Refine the unit vectors of matrix `at`, whose entries times `per_unit` are those of `a (n, n)`, in place."""
    n, largest, real, imag = eigen.n, 0.0, doubles(eigen.real, 0), doubles(eigen.imag, 0)
    for i in range(n):
        largest = max(largest, math.hypot(real[i], imag[i]))
    if not _find_clusters(eigen, EQUAL * largest, False):
        if not _find_clusters(eigen, CLOSE * largest, False):
            return
    else:
        for i in range(n):
            count = _gather(eigen, i)
            if count > 1:
                _take_null_space(eigen, a, per_unit, at, count)
    _take_overlaps(eigen, at)
    if _find_clusters(eigen, CLOSE * largest, True):
        for i in range(n):
            count = _gather(eigen, i)
            if count > 1:
                _make_dual(eigen, at, count)
    _mirror(eigen, at)


@njit_inner
def _find_clusters(eigen, gap, by_overlap):
    """Label eigenvalues that lie within a gap, and overlap if asked for; returns whether there is any cluster."""
    n, found, label = eigen.n, False, integers(eigen.cluster.label, 0)
    real, imag, overlap = doubles(eigen.real, 0), doubles(eigen.imag, 0), complexes(eigen.cluster.overlap, 0)
    for i in range(n):
        label[i] = i
        for j in range(i):
            joined = math.hypot(real[i] - real[j], imag[i] - imag[j]) <= gap
            if joined and by_overlap:
                above = abs(overlap[i * n + j]) > OVERLAP * abs(overlap[j * n + j])
                joined = above or abs(overlap[j * n + i]) > OVERLAP * abs(overlap[i * n + i])
            if joined:
                found = True
                first, other = min(label[i], label[j]), max(label[i], label[j])
                for k in range(i + 1):
                    label[k] = first if label[k] == other else label[k]
    return found


@njit_inner
def _gather(eigen, first):
    """Fill `members` with the cluster of which an eigenvalue is the first; returns how many they are."""
    count, label, members = 0, integers(eigen.cluster.label, 0), integers(eigen.cluster.members, 0)
    for i in range(eigen.n):
        if label[i] == first:
            members[count] = i
            count += 1
    return count


@njit_inner
def _take_null_space(eigen, a, per_unit, at, count):
    """Take the vectors of a repeated eigenvalue from the null space, unless the matrix is defective there."""
    n, cluster, largest, real, imag = eigen.n, eigen.cluster, 0.0, 0.0, 0.0
    members, label = integers(cluster.members, 0), integers(cluster.label, 0)
    balanced, shifted, singular = doubles(cluster.balanced, 0), complexes(cluster.shifted, 0), cluster.singular
    for r in range(n):
        for c in range(n):
            balanced[c * n + r] = a[r * n + c] * per_unit
    conjugates = False
    for p in range(count):
        i = members[p]
        real += doubles(eigen.real, i)[0] / count
        imag += doubles(eigen.imag, i)[0] / count
        conjugates |= doubles(eigen.imag, i)[0] > 0.0 and i + 1 < n and label[i + 1] == label[i]
    if dgebal(eigen) != 0:
        return
    for i in range(n * n):
        largest = max(largest, abs(balanced[i]))
        shifted[i] = complex(balanced[i], 0.0)
    for i in range(n):  # rounding makes pairs of a repeated real eigenvalue
        shifted[i * n + i] -= complex(real, 0.0 if conjugates else imag)
    if zgesvd(eigen) != 0 or doubles(singular, n - count)[0] > NULL * largest:
        return
    for p in range(count):
        _load_vectors(eigen, at, members[p], n - count + p)
    for p in range(count):
        i = members[p]
        if doubles(eigen.imag, i)[0] > 0.0 and i + 1 < n and label[i + 1] == label[i]:
            _make_conjugates(eigen, at, i)
    for p in range(count):
        _normalise(eigen, at, members[p])


@njit_inner
def _load_vectors(eigen, at, i, column):
    """Make a null vector of the balanced matrix on either side those of eigenvalue i, not yet at unit length."""
    n, start, scale = eigen.n, (at * eigen.n + i) * eigen.n, doubles(eigen.cluster.scale, 0)
    left, u = complexes(eigen.left, start), complexes(eigen.cluster.left, column * n)
    v = complexes(eigen.cluster.right, column)
    for c in range(n):
        left[c] = u[c].conjugate() / scale[c]
        doubles(eigen.right_real, start)[c] = v[c * n].real * scale[c]
        doubles(eigen.right_imag, start)[c] = -v[c * n].imag * scale[c]


@njit_inner
def _make_conjugates(eigen, at, i):
    """Make two real vectors of eigenvalues i and i + 1 the real and the imaginary part of those of a pair."""
    n, start = eigen.n, (at * eigen.n + i) * eigen.n
    left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
    right_imag = doubles(eigen.right_imag, start)
    for c in range(n):
        left[c] = complex(left[c].real, -left[n + c].real)
        left[n + c] = left[c].conjugate()
        right_imag[c], right_imag[n + c] = right_real[n + c], -right_real[n + c]
        right_real[n + c] = right_real[c]


@njit_inner
def _normalise(eigen, at, i):
    """Bring both vectors of eigenvalue i to unit length."""
    n, start, covector, vector = eigen.n, (at * eigen.n + i) * eigen.n, 0.0, 0.0
    left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
    right_imag = doubles(eigen.right_imag, start)
    for c in range(n):
        covector += left[c].real ** 2 + left[c].imag ** 2
        vector += right_real[c] ** 2 + right_imag[c] ** 2
    covector, vector = math.sqrt(covector), math.sqrt(vector)
    for c in range(n):
        left[c] /= covector
        right_real[c] /= vector
        right_imag[c] /= vector


@njit_inner
def _take_overlaps(eigen, at):
    n, overlap = eigen.n, complexes(eigen.cluster.overlap, 0)
    for i in range(n):
        left = complexes(eigen.left, (at * n + i) * n)
        for j in range(n):
            start = (at * n + j) * n
            right_real, right_imag = doubles(eigen.right_real, start), doubles(eigen.right_imag, start)
            product = complex(0.0, 0.0)
            for c in range(n):
                product += left[c] * complex(right_real[c], right_imag[c])
            overlap[i * n + j] = product


@njit_inner
def _make_dual(eigen, at, count):
    """Make `w_i^H v_j = 0` for any two members, unless the cluster is defective: Gauss and Jordan's scheme."""
    n, members, kept = eigen.n, integers(eigen.cluster.members, 0), complexes(eigen.cluster.shifted, 0)
    overlap, block = complexes(eigen.cluster.overlap, 0), complexes(eigen.cluster.right, 0)
    for p in range(count):
        rows = complexes(eigen.left, (at * n + members[p]) * n)
        for c in range(n):
            kept[p * n + c] = rows[c]
        for q in range(count):
            block[p * n + q] = overlap[members[p] * n + members[q]]
    for q in range(count):
        pivot = q
        for p in range(q + 1, count):
            pivot = p if abs(block[p * n + q]) > abs(block[pivot * n + q]) else pivot
        if not abs(block[pivot * n + q]) > SINGULAR:
            return
        for c in range(n):
            block[q * n + c], block[pivot * n + c] = block[pivot * n + c], block[q * n + c]
            kept[q * n + c], kept[pivot * n + c] = kept[pivot * n + c], kept[q * n + c]
        divisor = block[q * n + q]
        for c in range(n):
            block[q * n + c] /= divisor
            kept[q * n + c] /= divisor
        for p in range(count):
            factor = block[p * n + q]
            for c in range(n if p != q else 0):
                block[p * n + c] -= factor * block[q * n + c]
                kept[p * n + c] -= factor * kept[q * n + c]
    for p in range(count):
        rows = complexes(eigen.left, (at * n + members[p]) * n)
        for c in range(n):
            rows[c] = kept[p * n + c]
        _normalise(eigen, at, members[p])


@njit_inner
def _mirror(eigen, at):
    """Make members of a pair exact conjugates, and the left vectors of real eigenvalues real."""
    n, imag = eigen.n, doubles(eigen.imag, 0)
    for i in range(n):
        start = (at * n + i) * n
        left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
        right_imag = doubles(eigen.right_imag, start)
        for c in range(n):
            if imag[i] == 0.0:
                left[c] = complex(left[c].real, 0.0)
            if imag[i] < 0.0:
                left[c] = left[c - n].conjugate()
                right_real[c], right_imag[c] = right_real[c - n], -right_imag[c - n]
