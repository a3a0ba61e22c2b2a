"""Spectrum of a real matrix, and how slopes in its eigenvalues pull back to the matrix.

`d lambda_i = w_i^H dA v_i / (w_i^H v_i)` with left and right eigenvectors (J. R. Magnus, On differentiating eigenvalues
and eigenvectors, Econometric Theory 1 (1985) 179-191), which is the paper's reverse rule for the eigenvalues (Sec.
3.2, after Giles 2008) without an inverse. The guard is that of `spectra.eig`: the moduli of the participation factors
`conj(w_ia) v_ia / (w_i^H v_i)` add up to the condition of the eigenvalue, in whatever units the states are, which grows
without limit where a pair merges and is bounded by `max_condition`.
"""

import math
from typing import NamedTuple

import numpy as np

from eigenode_cli.engines.compiled.algebra import all_finite, clear
from eigenode_cli.engines.compiled.clusters import Cluster, refine_clusters
from eigenode_cli.engines.compiled.lapack import dgeev
from eigenode_cli.engines.compiled.memory import bits_of, carray, complexes, doubles, float_of, shift
from eigenode_cli.jit import njit_inner, njit_sums
from eigenode_cli.spectra.pairs import ROUNDING, rounding_level
from eigenode_cli.spectra.refine import STIFF, UNITS

SPLITTER = 2.0**27 + 1.0
"""A float64 times this, less the excess, is its leading half."""


class Eigen(NamedTuple):
    """Spectra and what their pullback needs, with the working space of the routine; arrays by their addresses.

    Attributes:
        n: number of states.
        max_condition: the guard: largest condition of an eigenvalue that its sensitivity may show.
        spectra: eigenvalues of all T matrices `(T, n)`.
        levels: up to where their parts count as zero (`pairs.rounding_level`) `(T,)`.
        capacity: T.
        forms: of two states, what the pullback of their closed form needs (`take_closed_forms`) `(6, T)`; beyond,
            the eigenvectors.
        left: `conj(w_i) / (w_i^H v_i)`, guarded, `(T, n, n)`.
        right_real, right_imag: parts of `v_i` `(T, n, n)`; `d lambda_i = sum_ab left[i, a] dA[a, b] right[i, b]`.
        a: a matrix, destroyed `(n, n)`.
        real, imag: eigenvalues `(n,)`.
        vectors, covectors: eigenvectors as LAPACK packs them `(n, n)`.
        space_size, space: of LAPACK.
        words, letter: what LAPACK takes by reference, int32 `(3,)` and uint8 `(1,)`.
        routine: address of LAPACK's routine (`lapack.DGEEV`).
        cluster: working space of the refinement inside clusters.
    """

    n: int
    max_condition: float
    spectra: int
    levels: int
    capacity: int
    forms: int
    left: int
    right_real: int
    right_imag: int
    a: int
    real: int
    imag: int
    vectors: int
    covectors: int
    space_size: int
    space: int
    words: int
    letter: int
    routine: int
    cluster: Cluster


@njit_inner
def take_spectrum(eigen, a, at, vectors):
    """Fill spectrum number `at` with the eigenvalues of `a (n, n)` and, if `vectors`, what its pullback needs.

    For any number of states but two, which have a closed form. A matrix that is not finite, or on which LAPACK fails,
    has a spectrum of NaN. LAPACK reads the rows of `a` as columns, so it sees the transpose, whose right eigenvectors
    are conj(w). The matrix is scaled to below 1: some builds of LAPACK do not undo their own scaling.

    Returns:
        How often the guard fired.
    """
    n, largest, per_unit, scaled, row = eigen.n, 0.0, 1.0, doubles(eigen.a, 0), complexes(eigen.spectra, at * eigen.n)
    found = all_finite(n * n, a)
    if found:
        for i in range(n * n):
            largest = max(largest, abs(a[i]))
        unit, per_unit = _power_of_two(2.0 * largest)
        for i in range(n * n):
            scaled[i] = a[i] * per_unit
        level = rounding_level(carray(scaled, (n, n)), carray(doubles(eigen.real, 0), (n,)))
        doubles(eigen.levels, at)[0] = level * unit
        found = dgeev(eigen, vectors) == 0
        for i in range(n):
            row[i] = complex(doubles(eigen.real, 0)[i] * unit, doubles(eigen.imag, 0)[i] * unit)
    fired = 0
    for i in range(n):
        if not found:
            row[i] = complex(math.nan, math.nan)
        elif vectors:
            _unpack_vectors(eigen, at, i)
    if found and vectors:
        refine_clusters(eigen, a, per_unit, at)
        for i in range(n):
            fired += _divide_by_overlap(eigen, at, i)
    return fired


@njit_inner
def take_closed_forms(eigen, m, columns, count, rows, at, counted, vectors):
    """`take_spectrum` of `count` matrices of two states, one a column, without a branch.

    `lambda = mean +- root`, `root^2 = delta^2 + b c` for `A = [[a, b], [c, d]]` and half the difference delta of its
    diagonal, so `d lambda / dA^T = I / 2 +- [[delta, b], [c, -delta]] / (2 root)`. The condition of both eigenvalues,
    the sum of the moduli of this matrix's diagonal, is `max(|delta|, |root|) / |root|` if the root is real and
    `|delta + root| / |root|` if not: the guard lets the divisor not become smaller than it allows. Where the norm of
    `A` less an eigenvalue over `2 |root|` is more than units explain, the guard bounds this norm.

    Args:
        m: number of rows of A that are given; the first one is `[0, 1]` if m is 1.
        columns, rows: these rows `(2 m, columns)`.
        count: matrices.
        at: number of the first one.
        counted: for how many of them firings of the guard are counted.
        vectors: whether `forms` is filled: root's modulus, delta, c and b over the divisor, 1 for a real root, and the
            smaller diagonal entry of `d lambda / dA` of a stiff matrix, 0 of any other.

    Returns:
        How often the guard fired.
    """
    stride, below, fired, stiff = eigen.capacity, shift(rows, (m - 1) * 2 * columns), 0, 0
    spectra, forms, levels = doubles(eigen.spectra, 4 * at), doubles(eigen.forms, at), doubles(eigen.levels, at)
    for t in range(count):
        a, b = (0.0, 1.0) if m == 1 else (rows[t], rows[columns + t])
        c, d = below[t], below[columns + t]
        zero = 0.0 * a + 0.0 * b + 0.0 * c + 0.0 * d  # NaN where an entry is not finite, so is the spectrum then
        mean, delta = 0.5 * (a + d) + zero, 0.5 * (a - d)
        unit, per_unit = _power_of_two(max(abs(delta), abs(b), abs(c)))
        delta, b, c = delta * per_unit, b * per_unit, c * per_unit
        square = delta * delta + b * c
        size, real = np.sqrt(abs(square)), square >= 0.0
        across, along = unit * size + zero if real else zero, zero if real else unit * size + zero
        spectra[4 * t], spectra[4 * t + 1] = mean + across, along
        spectra[4 * t + 2], spectra[4 * t + 3] = mean - across, 0.0 - along
        stiff += int(abs(abs(mean) - across) < STIFF * (abs(mean) + across))
        # `rounding_level` of two states: balancing makes |b| and |c| equal, unless one of them is zero
        whole, per_whole = _power_of_two(max(unit, abs(mean)))
        middle, rest = mean * per_whole, unit * per_whole
        apart = 2.0 * abs(b * c) if b * c != 0.0 else b * b + c * c
        levels[t] = ROUNDING * whole * np.sqrt(2.0 * middle * middle + rest * rest * (2.0 * delta * delta + apart))
        if vectors:
            # real roots: |delta + root|^2 + |delta - root|^2 is the same
            norm = np.sqrt(2.0 * (delta * delta + size * size) + b * b + c * c)
            shared = 2.0 * (max(size, abs(delta)) if real else np.sqrt(size * size + delta * delta))
            defective = not 2.0 * size * eigen.max_condition * UNITS >= norm
            guarded = defective or not 2.0 * size * eigen.max_condition >= shared
            over = 1.0 / ((norm if defective else shared) / eigen.max_condition if guarded else 2.0 * size)
            any_basis = norm == 0.0  # a multiple of the identity: any basis of eigenvectors will do
            forms[t] = 0.5 if any_basis else size * over
            forms[stride + t] = 0.5 if any_basis else delta * over
            forms[2 * stride + t] = 0.0 if any_basis else c * over
            forms[3 * stride + t] = 0.0 if any_basis else b * over
            forms[4 * stride + t] = 1.0 if real else 0.0
            forms[5 * stride + t] = 0.0
            fired += 2 * int(guarded and zero == 0.0 and t < counted)
    if stiff > 0:
        _refine_stiff(eigen, m, columns, count, rows, at, vectors)
    return fired


@njit_inner
def _refine_stiff(eigen, m, columns, count, rows, at, vectors):
    """Replace what cancels in the closed forms of stiff matrices: `mean -+ root`, and `delta -+ root` in the slopes.

    The smaller eigenvalue is the determinant over the larger one, `root - |delta| = b c / (root + |delta|)`.
    """
    below, spectra = shift(rows, (m - 1) * 2 * columns), doubles(eigen.spectra, 4 * at)
    for t in range(count):
        first, second = spectra[4 * t], spectra[4 * t + 2]
        if spectra[4 * t + 1] != 0.0 or not min(abs(first), abs(second)) < STIFF * max(abs(first), abs(second)):
            continue
        a, b = (0.0, 1.0) if m == 1 else (rows[t], rows[columns + t])
        c, d = below[t], below[columns + t]
        large, at_small = (first, 2) if abs(first) > abs(second) else (second, 0)
        unit, per_unit = _power_of_two(max(abs(a), abs(b), abs(c), abs(d)))
        a, b, c, d = a * per_unit, b * per_unit, c * per_unit, d * per_unit
        spectra[4 * t + at_small] = _determinant(a, b, c, d) / (large * per_unit) * unit
        root, delta = 0.5 * abs(first - second) * per_unit, 0.5 * abs(a - d)
        if vectors:
            forms = doubles(eigen.forms, at)  # the first is 1/2 unless the guard fired
            forms[5 * eigen.capacity + t] = forms[t] * b * c / (root * (root + delta))


@njit_inner
def _determinant(a, b, c, d):
    """Return `a d - b c` with the rounding errors of both products added (Dekker, Numer. Math. 18, 1971, 224-242)."""
    return (a * d - b * c) + (_rounding_error(a, d) - _rounding_error(b, c))


@njit_inner
def _rounding_error(x, y):
    """`x y` less the rounded product."""
    x_high, y_high = SPLITTER * x - (SPLITTER * x - x), SPLITTER * y - (SPLITTER * y - y)
    x_low, y_low = x - x_high, y - y_high
    return x_low * y_low - (((x * y - x_high * y_high) - x_low * y_high) - x_high * y_low)


@njit_inner
def _power_of_two(size):
    """Return the power of two at or below a modulus, and its inverse: entries over it have squares in range."""
    exponent = bits_of(size) >> 52
    exponent = 1 if exponent < 1 else 2045 if exponent > 2045 else exponent
    return float_of(exponent << 52), float_of((2046 - exponent) << 52)


@njit_inner
def _unpack_vectors(eigen, at, i):
    """Return the unit vectors of eigenvalue i of matrix `at`."""
    n, start = eigen.n, (at * eigen.n + i) * eigen.n
    left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
    right_imag, imag = doubles(eigen.right_imag, start), doubles(eigen.imag, 0)[i]
    # the members of a pair share two columns: real part and, for the first member, imaginary part
    sign = 0.0 if imag == 0.0 else math.copysign(1.0, imag)
    base = (i - 1 if sign < 0.0 else i) * n
    other = base if sign == 0.0 else base + n
    vectors, covectors = doubles(eigen.vectors, 0), doubles(eigen.covectors, 0)
    for c in range(n):
        left[c] = complex(covectors[base + c], sign * covectors[other + c])
        right_real[c], right_imag[c] = vectors[base + c], -sign * vectors[other + c]


@njit_inner
def _divide_by_overlap(eigen, at, i):
    """Divide the left vector of eigenvalue i of matrix `at` by the guarded `w^H v`; returns 1 if the guard fired."""
    n, start, shared = eigen.n, (at * eigen.n + i) * eigen.n, 0.0
    left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
    right_imag, product = doubles(eigen.right_imag, start), complex(0.0, 0.0)
    for c in range(n):
        part = left[c] * complex(right_real[c], right_imag[c])
        product += part
        shared += math.sqrt(part.real * part.real + part.imag * part.imag)
    size = abs(product)
    defective = not size * eigen.max_condition * UNITS >= 1.0
    fired = defective or not size * eigen.max_condition >= shared
    if fired:
        bound = (1.0 if defective else shared) / eigen.max_condition
        product = product / size * bound if size > 0.0 else complex(bound, 0.0)
    for c in range(n):
        left[c] /= product
    return int(fired)


@njit_inner
def pull_back_spectrum(eigen, at, m, slope, bar_a):
    """Fill `bar_a (m, n)`, cotangent of the last m rows of matrix `at`, with `sum_i Re(conj(slope_i) d lambda_i/dA)`.

    `slope (n, 2)` is `dl/dRe, dl/dIm` of each eigenvalue.
    """
    n = eigen.n
    clear(m * n, bar_a)
    for i in range(n):
        along_real, along_imag = slope[2 * i], slope[2 * i + 1]
        if along_real == 0.0 and along_imag == 0.0:
            continue
        start = (at * n + i) * n
        left = complexes(eigen.left, start + n - m)
        right_real, right_imag = doubles(eigen.right_real, start), doubles(eigen.right_imag, start)
        for r in range(m):
            factor = complex(along_real, -along_imag) * left[r]
            _add_real_part(n, factor.real, factor.imag, right_real, right_imag, shift(bar_a, r * n))


@njit_sums
def pull_back_closed_forms(eigen, at, count, m, slopes, columns, rows):
    """Do the same for `count` matrices of two states from number `at` on, with `slopes (count, 2, 2)`.

    The cotangents of each one go to its column of `rows (2 m, columns)`. Where there is no slope the derivatives count
    for nothing: they may be those of a matrix that is not finite.
    """
    stride, forms, below = eigen.capacity, doubles(eigen.forms, at), shift(rows, (m - 1) * 2 * columns)
    for t in range(count):
        real_1, imag_1, real_2, imag_2 = slopes[4 * t], slopes[4 * t + 1], slopes[4 * t + 2], slopes[4 * t + 3]
        none = real_1 == 0.0 and imag_1 == 0.0 and real_2 == 0.0 and imag_2 == 0.0
        apart = real_1 - real_2 if forms[4 * stride + t] == 1.0 else imag_2 - imag_1
        half, tilt = forms[t] * (real_1 + real_2), forms[stride + t] * apart
        if m == 2:
            rows[t] = 0.0 if none else half + tilt
            rows[columns + t] = 0.0 if none else forms[2 * stride + t] * apart
        below[t] = 0.0 if none else forms[3 * stride + t] * apart
        below[columns + t] = 0.0 if none else half - tilt
    _pull_back_stiff(eigen, at, count, m, slopes, columns, rows)


@njit_inner
def _pull_back_stiff(eigen, at, count, m, slopes, columns, rows):
    """Replace the diagonal's cotangents of stiff matrices, whose smaller entry would be lost beside the larger one."""
    stride, forms, below = eigen.capacity, doubles(eigen.forms, at), shift(rows, (m - 1) * 2 * columns)
    for t in range(count):
        small, real_1, real_2 = forms[5 * stride + t], slopes[4 * t], slopes[4 * t + 2]
        if small != 0.0 and (real_1 != 0.0 or real_2 != 0.0):
            upper, lower = forms[t] + abs(forms[stride + t]), small
            if forms[stride + t] < 0.0:
                upper, lower = lower, upper
            if m == 2:
                rows[t] = upper * real_1 + lower * real_2
            below[columns + t] = lower * real_1 + upper * real_2


@njit_sums
def _add_real_part(n, real, imag, right_real, right_imag, row):
    for c in range(n):
        row[c] += real * right_real[c] - imag * right_imag[c]
