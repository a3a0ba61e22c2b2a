"""Which eigenvalues form conjugate pairs, and which target each pair is compared with.

Where two eigenvalues merge each of them is only known to the square root of the machine's precision, and rounding
decides whether they are real or a pair. So a part of an eigenvalue counts only above the rounding level of its matrix:
one rule for models, truths and what is written of them.
"""

import math

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.jit import njit

REAL = -1
"""Partner of a real eigenvalue."""
UNMATCHED = -1
"""Target of an eigenvalue that has none."""
ROUNDING = 2.0**-24
"""Rounding level of a spectrum over the size of its matrix: four times the square root of the machine's precision."""
SWEEPS = 3
"""Of balancing: the size need not be exact."""


@njit
def rounding_level(matrix, scale):
    """Modulus in 1/s up to which the part of an eigenvalue of `matrix (n, n)` counts as zero.

    The size of the matrix is its Frobenius norm after balancing, so that units of the states do not matter. The largest
    modulus of the spectrum would not do: that of a matrix far from normal is smaller by orders of magnitude.

    Args:
        matrix: A in 1/s.
        scale: working space `(n,)`.
    """
    n, largest, total = matrix.shape[0], 0.0, 0.0
    for i in range(n):
        scale[i] = 1.0
        for j in range(n):
            largest = max(largest, abs(matrix[i, j]))
    if largest == 0.0:
        return 0.0
    for _ in range(SWEEPS):
        for i in range(n):
            row, column = 0.0, 0.0
            for j in range(n):
                if j != i:
                    row += (matrix[i, j] / largest * scale[j]) ** 2
                    column += (matrix[j, i] / largest / scale[j]) ** 2
            if row > 0.0 and column > 0.0:
                scale[i] = (row / column) ** 0.25
    for i in range(n):
        for j in range(n):
            total += (matrix[i, j] / largest * (scale[j] / scale[i])) ** 2
    return ROUNDING * math.sqrt(total) * largest


@njit
def rounding_levels(matrices):
    """Return the same of each of `matrices (T, n, n)`: `(T,)` in 1/s."""
    levels, scale = np.empty(matrices.shape[0]), np.empty(matrices.shape[1])
    for t in range(levels.size):
        levels[t] = rounding_level(matrices[t], scale)
    return levels


def without_rounding(spectra: NDArray[np.complex128], levels: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the spectra `(T, n)`, with eigenvalues real that are no pair above their rounding levels `(T,)`."""
    return np.where(np.abs(spectra.imag) > levels[:, None], spectra, spectra.real)


@njit
def find_partners(spectrum, level, partner):
    """Fill `partner (n,)` with the index of each eigenvalue's conjugate, `REAL` where there is none.

    `spectrum (n,)` are the eigenvalues of a real matrix, in any order: the members of a pair are exact conjugates.
    Returns the number of pairs. A pair needs an imaginary part above `level`: equal real eigenvalues are not one.
    """
    n = spectrum.size
    pairs = 0
    for i in range(n):
        partner[i] = REAL
    for i in range(n):
        if partner[i] != REAL or not spectrum[i].imag > level:
            continue
        best, least = REAL, np.inf
        for j in range(n):
            if partner[j] == REAL and spectrum[j].imag < -level:
                across, along = spectrum[i].real - spectrum[j].real, spectrum[i].imag + spectrum[j].imag
                distance = across * across + along * along
                if best == REAL or distance < least:
                    best, least = j, distance
        if best != REAL:
            partner[i] = best
            partner[best] = i
            pairs += 1
    return pairs


@njit
def match_targets(spectrum, partner, frequency, damping, match):
    """Fill `match (n,)` with the index of the target that each member of a pair is compared with.

    `frequency, damping (K,)` of the targets in Hz and 1, NaN behind the last one. As many pairs are matched as both
    sides have; the assignment has the smallest sum of distances in the complex plane, since modes of one frequency
    differ in their damping. Returns the number of matched pairs.
    """
    n = spectrum.size
    for i in range(n):
        match[i] = UNMATCHED
    m = 0
    for i in range(n):
        if partner[i] != REAL and spectrum[i].imag > 0.0:
            m += 1
    k = 0
    while k < frequency.size and not np.isnan(frequency[k]):
        k += 1
    if m == 0 or k == 0:
        return 0
    if m == 1 and k == 1:  # the paper's systems: nothing to assign, nothing to allocate
        for i in range(n):
            if partner[i] != REAL:
                match[i] = 0
        return 1
    _assign(spectrum, partner, frequency[:k], damping[:k], match, m)
    return min(m, k)


@njit
def _assign(spectrum, partner, frequency, damping, match, m):
    n, k = spectrum.size, frequency.size
    members = np.empty(m, np.int64)
    a = 0
    for i in range(n):
        if partner[i] != REAL and spectrum[i].imag > 0.0:
            members[a] = i
            a += 1
    cost = np.empty((min(m, k), max(m, k)))
    for b in range(k):
        target = target_eigenvalue(frequency[b], damping[b])
        for a in range(m):
            row, column = (a, b) if m <= k else (b, a)
            cost[row, column] = abs(spectrum[members[a]] - target)
    for row, column in enumerate(assign_rows(cost)):
        a, b = (row, column) if m <= k else (column, row)
        match[members[a]] = b
        match[partner[members[a]]] = b


@njit
def target_eigenvalue(frequency, damping):
    """Upper member of a pair in 1/s from its damped frequency in Hz and its damping ratio, inside (-1, 1)."""
    imag = 2.0 * math.pi * frequency
    share = max((1.0 - damping) * (1.0 + damping), ROUNDING * ROUNDING)  # (Im / |lambda|)^2
    return complex(-imag * damping / math.sqrt(share), imag)


@njit
def assign_rows(cost):
    """Column `(m,)` of each row of `cost (m, k)`, m <= k, all different, with the smallest sum of costs.

    The Hungarian method by shortest augmenting paths (R. Jonker, A. Volgenant, Computing 38 (1987) 325-340): rows are
    entered one after another, each by the cheapest path of exchanges that ends at a free column. Column 0 of the
    working arrays stands for the row that is being entered.
    """
    m, k = cost.shape
    row_price, price = np.zeros(m + 1), np.zeros(k + 1)
    owner = np.zeros(k + 1, np.int64)  # row of each column, both counted from 1; 0 for none
    for row in range(1, m + 1):
        owner[0], column = row, 0
        least, before = np.full(k + 1, np.inf), np.zeros(k + 1, np.int64)
        reached = np.zeros(k + 1, np.bool_)
        while owner[column] != 0:
            reached[column] = True
            here, step, following = owner[column], np.inf, 0
            for j in range(1, k + 1):
                if not reached[j]:
                    reduced = cost[here - 1, j - 1] - row_price[here] - price[j]
                    if reduced < least[j]:
                        least[j], before[j] = reduced, column
                    if least[j] < step or following == 0:
                        step, following = least[j], j
            for j in range(k + 1):
                if reached[j]:
                    row_price[owner[j]] += step
                    price[j] -= step
                else:
                    least[j] -= step
            column = following
        while column != 0:  # exchange along the path
            owner[column], column = owner[before[column]], before[column]
    columns = np.empty(m, np.int64)
    for j in range(1, k + 1):
        if owner[j] > 0:
            columns[owner[j] - 1] = j - 1
    return columns
