"""Spectrum of a real matrix, and how slopes in its eigenvalues pull back to the matrix.

`d lambda_i = w_i^H dA v_i / (w_i^H v_i)` with left and right eigenvectors (J. R. Magnus, On differentiating eigenvalues
and eigenvectors, Econometric Theory 1 (1985) 179-191), which is the paper's reverse rule for the eigenvalues (Sec.
3.2, after Giles 2008) without an inverse. `1 / |w_i^H v_i|` of unit vectors is the condition of the eigenvalue: the
guard bounds it, since it grows without limit where a pair merges.
"""

import math
from typing import NamedTuple

from eigenode_cli.engines.compiled.algebra import all_finite, clear
from eigenode_cli.engines.compiled.lapack import dgeev
from eigenode_cli.engines.compiled.memory import complexes, doubles, shift
from eigenode_cli.jit import njit_inner, njit_sums


class Eigen(NamedTuple):
    """Spectra and what their pullback needs, with the working space of the routine; arrays by their addresses.

    Attributes:
        n: number of states.
        max_condition: the guard: largest condition of an eigenvalue that its sensitivity may show.
        spectra: eigenvalues of all T matrices `(T, n)`.
        slopes: `d lambda_i / dA`, guarded, of two states `(T, 2, 2, 2)`; beyond, the eigenvectors stand for them.
        left: `conj(w_i) / (w_i^H v_i)`, guarded, `(T, n, n)`.
        right_real, right_imag: parts of `v_i` `(T, n, n)`; `d lambda_i = sum_ab left[i, a] dA[a, b] right[i, b]`.
        a: a matrix, destroyed `(n, n)`.
        real, imag: eigenvalues `(n,)`.
        vectors, covectors: eigenvectors as LAPACK packs them `(n, n)`.
        space_size, space: of LAPACK.
        words, letter: what LAPACK takes by reference, int32 `(3,)` and uint8 `(1,)`.
        routine: address of LAPACK's routine (`lapack.DGEEV`).
    """

    n: int
    max_condition: float
    spectra: int
    slopes: int
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


@njit_inner
def take_spectrum(eigen, a, at, vectors):
    """Fill spectrum number `at` with the eigenvalues of `a (n, n)` and, if `vectors`, what its pullback needs.

    A matrix that is not finite, or on which LAPACK fails, has a spectrum of NaN. Returns how often the guard fired.
    """
    n = eigen.n
    row = complexes(eigen.spectra, at * n)
    if not all_finite(n * n, a):
        for i in range(n):
            row[i] = complex(math.nan, math.nan)
        return 0
    if n == 2:
        return _two_by_two(eigen, a, at, vectors, row)
    return _general(eigen, a, at, vectors, row)


@njit_inner
def _two_by_two(eigen, a, at, vectors, row):
    """Closed form: `lambda = mean +- root`, `root^2 = delta^2 + b c` with half the difference delta of the diagonal.

    `A` less the other eigenvalue has rank one and the trace `+-2 root`: over its trace it is the projector
    `v w^H / (w^H v)`, whose transpose is `d lambda / dA` and whose norm is the condition of both eigenvalues.
    """
    mean, delta = 0.5 * (a[0] + a[3]), 0.5 * (a[0] - a[3])
    discriminant = delta * delta + a[1] * a[2]
    size = math.sqrt(abs(discriminant))
    root = complex(size, 0.0) if discriminant >= 0.0 else complex(0.0, size)
    row[0], row[1] = mean + root, mean - root
    if not vectors:
        return 0
    first, second = complexes(eigen.slopes, 8 * at), complexes(eigen.slopes, 8 * at + 4)
    # real roots: |delta + root|^2 + |delta - root|^2 is the same
    norm = math.sqrt(2.0 * (delta * delta + size * size) + a[1] * a[1] + a[2] * a[2])
    if norm == 0.0:  # a multiple of the identity: any basis of eigenvectors will do
        none, one = complex(0.0, 0.0), complex(1.0, 0.0)
        _set_slopes(first, one, none, none, none)
        _set_slopes(second, none, none, none, one)
        return 0
    fired = not 2.0 * size * eigen.max_condition >= norm
    over = 1.0 / (norm / eigen.max_condition if fired else 2.0 * size)
    if discriminant >= 0.0:
        off_b, off_c = complex(a[1] * over, 0.0), complex(a[2] * over, 0.0)
        same, other = complex((size + delta) * over, 0.0), complex((size - delta) * over, 0.0)
        _set_slopes(first, same, off_c, off_b, other)
        _set_slopes(second, other, -off_c, -off_b, same)
    else:
        off_b, off_c = complex(0.0, -a[1] * over), complex(0.0, -a[2] * over)
        same, other = complex(size * over, -delta * over), complex(size * over, delta * over)
        _set_slopes(first, same, off_c, off_b, other)
        _set_slopes(second, other, -off_c, -off_b, same)
    return 2 * int(fired)


@njit_inner
def _set_slopes(slopes, p, q, r, s):
    slopes[0], slopes[1], slopes[2], slopes[3] = p, q, r, s


@njit_inner
def _general(eigen, a, at, vectors, row):
    """LAPACK reads the rows of `a` as columns, so it sees the transpose, whose right eigenvectors are conj(w).

    The matrix is scaled to about 1 by a power of two: some builds of LAPACK do not undo their own scaling.
    """
    n, largest, scaled = eigen.n, 0.0, doubles(eigen.a, 0)
    for i in range(n * n):
        largest = max(largest, abs(a[i]))
    scale = math.ldexp(1.0, min(1000, max(-1000, -math.frexp(largest)[1])))
    for i in range(n * n):
        scaled[i] = a[i] * scale
    info = dgeev(eigen, vectors)
    real, imag = doubles(eigen.real, 0), doubles(eigen.imag, 0)
    for i in range(n):
        row[i] = complex(real[i] / scale, imag[i] / scale) if info == 0 else complex(math.nan, math.nan)
    fired = 0
    if info == 0 and vectors:
        for i in range(n):
            fired += _unpack_vectors(eigen, at, i)
    return fired


@njit_inner
def _unpack_vectors(eigen, at, i):
    """Vectors of eigenvalue i of matrix `at`, the left one over the guarded `w^H v`; returns 1 if the guard fired."""
    n, start = eigen.n, (at * eigen.n + i) * eigen.n
    left, right_real = complexes(eigen.left, start), doubles(eigen.right_real, start)
    right_imag, imag = doubles(eigen.right_imag, start), doubles(eigen.imag, 0)[i]
    # the members of a pair share two columns: real part and, for the first member, imaginary part
    sign = 0.0 if imag == 0.0 else math.copysign(1.0, imag)
    base = (i - 1 if sign < 0.0 else i) * n
    other = base if sign == 0.0 else base + n
    vectors, covectors = doubles(eigen.vectors, 0), doubles(eigen.covectors, 0)
    product = complex(0.0, 0.0)
    for c in range(n):
        left[c] = complex(covectors[base + c], sign * covectors[other + c])
        right_real[c], right_imag[c] = vectors[base + c], -sign * vectors[other + c]
        product += left[c] * complex(right_real[c], right_imag[c])
    size = abs(product)
    fired = not size * eigen.max_condition >= 1.0
    if fired:
        product = product / (size * eigen.max_condition) if size > 0.0 else complex(1.0 / eigen.max_condition, 0.0)
    for c in range(n):
        left[c] /= product
    return int(fired)


@njit_inner
def pull_back_spectrum(eigen, at, m, slope, bar_a):
    """Fill `bar_a (m, n)`, cotangent of the last m rows of matrix `at`, with `sum_i Re(conj(slope_i) d lambda_i/dA)`.

    `slope (n, 2)` is `dl/dRe, dl/dIm` of each eigenvalue.
    """
    n = eigen.n
    if n == 2:
        pull_back_closed_forms(eigen, at, 1, m, slope, 1, bar_a)
        return
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
    """The same of `count` matrices of two states from number `at` on, with `slopes (count, 2, 2)`.

    Entry e of the cotangent of each one goes to its column of row e of `rows (2 m, columns)`. Where there is no slope
    the derivatives count for nothing: they may be those of a matrix that is not finite.
    """
    for e in range(2 * m):
        row = shift(rows, e * columns)
        first = doubles(eigen.slopes, 16 * at + 2 * (4 - 2 * m + e))
        second = shift(first, 8)
        for c in range(count):
            real_1, imag_1, real_2, imag_2 = slopes[4 * c], slopes[4 * c + 1], slopes[4 * c + 2], slopes[4 * c + 3]
            front = real_1 * first[16 * c] + imag_1 * first[16 * c + 1]
            back = real_2 * second[16 * c] + imag_2 * second[16 * c + 1]
            none = real_1 == 0.0 and imag_1 == 0.0 and real_2 == 0.0 and imag_2 == 0.0
            row[c] = 0.0 if none else front + back


@njit_sums
def _add_real_part(n, real, imag, right_real, right_imag, row):
    for c in range(n):
        row[c] += real * right_real[c] - imag * right_imag[c]
