"""Spectra and their pullback, each eigenvalue by itself, at good and at bad matrices."""

import numpy as np
import pytest

from eigenode_cli.engines.compiled.memory import complexes, doubles, start_of
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.compiled.spectrum import (
    pull_back_closed_forms,
    pull_back_spectrum,
    take_closed_forms,
    take_spectrum,
)
from eigenode_cli.engines.compiled.spectrum_buffers import build_eigen
from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import rounding_levels


@njit
def take(eigen, a, vectors, spectrum):
    if eigen.n == 2:
        fired = take_closed_forms(eigen, 2, 1, 1, start_of(a), 0, 1, vectors)
    else:
        fired = take_spectrum(eigen, start_of(a), 0, vectors)
    for i in range(eigen.n):
        spectrum[i] = complexes(eigen.spectra, 0)[i]
    return fired


@njit
def read_level(eigen, level):
    level[0] = doubles(eigen.levels, 0)[0]


@njit
def pull_back(eigen, slope, bar_a):
    slopes, m = start_of(slope.view(np.float64)), bar_a.shape[0]
    if eigen.n == 2:
        pull_back_closed_forms(eigen, 0, 1, m, slopes, 1, start_of(bar_a))
    else:
        pull_back_spectrum(eigen, 0, m, slopes, start_of(bar_a))


def spectrum_of(a, max_condition=1e12):
    """Eigenvalues `(n,)`, firings of the guard, and `d lambda / dA (n, n, n)`."""
    n, owner = len(a), Owner()
    eigen = build_eigen(owner, n, 1, max_condition)
    spectrum = np.empty(n, dtype=np.complex128)
    fired = take(eigen, np.ascontiguousarray(a, dtype=np.float64), True, spectrum)
    slopes = np.empty((n, n, n), dtype=np.complex128)
    part = np.empty((n, n))
    for i in range(n):
        for unit in (1.0, 1j):
            slope = np.zeros(n, dtype=np.complex128)
            slope[i] = unit
            pull_back(eigen, slope, part)
            if unit == 1.0:
                slopes[i] = part
            else:
                slopes[i] += 1j * part
    pull_back(eigen, np.zeros(n, dtype=np.complex128), part)
    assert not part.any()
    return spectrum, fired, slopes


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("scale", [1e-160, 1.0, 1e160])
def test_rounding_level_is_that_of_the_matrix(n, scale):
    random = np.random.default_rng(n)
    matrices = [random.normal(size=(n, n)), np.diag([1e4, *np.ones(n - 1)]) @ random.normal(size=(n, n)), np.eye(n)]
    matrices.append(np.diag(np.ones(n - 1), 1) - 0.5 * np.eye(n))
    matrices.append(np.zeros((n, n)))
    for matrix in matrices:
        owner, level = Owner(), np.array([np.nan])
        eigen = build_eigen(owner, n, 1, 1e8)
        take(eigen, scale * matrix, False, np.empty(n, dtype=np.complex128))
        read_level(eigen, level)
        np.testing.assert_allclose(level, rounding_levels(scale * matrix[None]), rtol=1e-12)


def matched(spectrum, wanted):
    """`wanted` in the order of `spectrum`."""
    left = list(wanted)
    return np.array([left.pop(int(np.argmin(np.abs(np.array(left) - value)))) for value in spectrum])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("seed", range(6))
def test_eigenvalues_and_each_derivative(n, seed):
    a = np.random.default_rng(seed).normal(size=(n, n)) * 3.0
    spectrum, fired, slopes = spectrum_of(a)
    assert fired == 0
    np.testing.assert_allclose(spectrum, matched(spectrum, np.linalg.eigvals(a)), rtol=1e-11, atol=1e-12)
    h = 1e-5
    for r in range(n):
        for c in range(n):
            step = np.zeros((n, n))
            step[r, c] = h
            forth, back = (matched(spectrum, np.linalg.eigvals(a + s * step)) for s in (1, -1))
            np.testing.assert_allclose(slopes[:, r, c], (forth - back) / (2 * h), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-300, 1e-170, 1e160, 1e300])
@pytest.mark.parametrize("a", [[[-1.0, 0.0], [0.0, -2.0]], [[-1.0, 3.0], [-3.0, -1.0]], [[0.0, 1.0], [0.0, 0.0]]])
def test_no_scale_is_too_small_or_too_large(a, scale):
    plain, fired, slopes = spectrum_of(np.array(a), max_condition=100.0)
    scaled, fired_there, slopes_there = spectrum_of(scale * np.array(a), max_condition=100.0)
    np.testing.assert_allclose(scaled / scale, plain, rtol=1e-14)
    np.testing.assert_allclose(slopes_there, slopes, rtol=1e-14, atol=1e-14)
    assert fired_there == fired


@pytest.mark.parametrize("n", [2, 3, 6])
def test_members_of_a_pair_are_exact_conjugates(n):
    spectrum, _, slopes = spectrum_of(np.random.default_rng(n).normal(size=(n, n)) + 3.0 * np.eye(n)[::-1])
    for i in np.flatnonzero(spectrum.imag > 0.0):
        j = int(np.argmin(np.abs(spectrum - spectrum[i].conj())))
        assert spectrum[j] == spectrum[i].conj()
        np.testing.assert_allclose(slopes[j], slopes[i].conj(), rtol=1e-12)


@pytest.mark.parametrize(
    "a",
    [
        np.zeros((2, 2)),
        np.eye(2),
        -3.0 * np.eye(3),
        np.array([[2.0, 0.0], [0.0, -1.0]]),
        np.diag([1.0, 2.0, 3.0]),
    ],
    ids=["zero", "identity", "multiple of the identity", "diagonal", "diagonal of 3"],
)
def test_symmetric_matrices_never_fire_the_guard(a):
    spectrum, fired, slopes = spectrum_of(a, max_condition=2.0)
    assert fired == 0
    np.testing.assert_allclose(np.sort(spectrum.real), np.sort(np.diag(a)))
    np.testing.assert_allclose(slopes.sum(axis=0), np.eye(len(a)), atol=1e-14)  # derivative of the trace
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=(1, 2)), 1.0)


@pytest.mark.parametrize(
    "a",
    [
        np.array([[0.0, 1.0], [0.0, 0.0]]),
        np.array([[0.0, 0.0], [5.0, 0.0]]),
        np.array([[-1.0, 1.0], [-1.0, 1.0]]),
        np.array([[1.0, 1e-150], [0.0, 1.0]]),
        np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]),
    ],
    ids=["jordan", "lower jordan", "nilpotent", "tiny", "jordan of 3"],
)
def test_guard_bounds_defective_matrices(a):
    _, fired, slopes = spectrum_of(a, max_condition=100.0)
    assert fired == len(a)
    assert np.isfinite(slopes).all()
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=(1, 2)), 100.0, rtol=1e-9)


@pytest.mark.parametrize("distance", [1e-4, -1e-4])
def test_guard_keeps_the_phase(distance):
    """Beyond the border the sensitivity points where the true one does, with the length of the border."""
    a = 0.5 * np.array([[1.0, 1.0], [4.0 * distance - 1.0, -1.0]])  # condition 50 in any units
    _, none, true = spectrum_of(a, max_condition=51.0)
    _, fired, guarded = spectrum_of(a, max_condition=10.0)
    assert (none, fired) == (0, 2)
    length = np.abs(np.einsum("iaa->ia", true)).sum(axis=1)
    np.testing.assert_allclose(length, 50.0, rtol=1e-3)
    np.testing.assert_allclose(guarded, true * (10.0 / length)[:, None, None], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_matrices_that_are_not_finite(n, bad):
    owner = Owner()
    eigen = build_eigen(owner, n, 1, 1e8)
    a, spectrum = np.eye(n), np.empty(n, dtype=np.complex128)
    a[0, 1] = bad
    assert take(eigen, a, True, spectrum) == 0
    assert np.isnan(spectrum).all()


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("exponent", [-140, 140])
def test_very_large_and_very_small_matrices(n, exponent):
    a = np.random.default_rng(n).normal(size=(n, n))
    plain, _, slopes = spectrum_of(a)
    scaled, _, slopes_scaled = spectrum_of(a * 10.0**exponent)
    np.testing.assert_allclose(scaled / 10.0**exponent, plain, rtol=1e-10)
    np.testing.assert_allclose(slopes_scaled, slopes, rtol=1e-9, atol=1e-12)
