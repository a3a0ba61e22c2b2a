"""Slopes inside clusters of eigenvalues, of stiff matrices, and in any units, in both engines."""

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from torch import Tensor

from eigenode_cli.arrays import Floats
from eigenode_cli.spectra.eig import eig, eigvals
from tests.engines.compiled.test_spectrum import spectrum_of

LIMIT = 1e4


def by_torch(a: Floats, limit: float = LIMIT) -> tuple[NDArray[np.complex128], int, NDArray[np.complex128]]:
    """Eigenvalues `(n,)`, firings of the guard, and `d lambda / dA (n, n, n)`, as `spectrum_of` has them."""
    leaf = torch.tensor(np.array(a, dtype=np.float64), requires_grad=True)
    values, fired = eigvals(leaf, limit)
    parts = [[torch.autograd.grad(part, leaf, retain_graph=True)[0] for part in (v.real, v.imag)] for v in values]
    slopes = np.array([real.numpy() + 1j * imag.numpy() for real, imag in parts])
    return values.detach().numpy(), int(fired), slopes


ENGINES = pytest.mark.parametrize("of", [by_torch, spectrum_of], ids=["torch", "compiled"])


def ring(masses: int, stiffness: float = 1.0, damping: float = 0.1) -> Floats:
    """Equal masses in a ring, each one also tied to the ground: all modes but one or two come twice."""
    one = np.eye(masses)
    springs = 3.0 * one - np.roll(one, 1, axis=0) - np.roll(one, -1, axis=0)
    return np.block([[np.zeros((masses, masses)), one], [-stiffness * springs, -damping * one]])


def similar(blocks: Floats, seed: int) -> Floats:
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.normal(size=blocks.shape))[0] * random.uniform(0.5, 2.0, size=len(blocks))
    return basis @ blocks @ np.linalg.inv(basis)


def pair(real: float, imag: float) -> Floats:
    return np.array([[real, imag], [-imag, real]])


GALLERY = [
    *(
        ring(masses, stiffness, damping)
        for masses in (3, 4, 5, 6)
        for stiffness in (0.3, 1.0, 7.0, 1e4)
        for damping in (0.0, 0.1, 1.0)
    ),
    *(similar(np.diag([1.0, 1.0, 2.0, -1.0]), seed) for seed in range(9)),
    *(similar(np.diag([-1.0, -1.0, -1.0, 2.0, 2.0]), seed) for seed in range(9)),
    *(similar(block_diag(pair(-0.1, 2.0), pair(-0.1, 2.0), -3.0), seed) for seed in range(9)),
    *(
        similar(block_diag(pair(-0.1, 2.0), pair(-0.1, 2.0), pair(-0.1, 2.0), pair(0.0, 1.0)), seed)
        for seed in range(9)
    ),
    *(similar(np.diag([0.0, 0.0, 0.0, 2.0, -3.0]), seed) for seed in range(9)),
    *(-2.0 * np.eye(n) for n in (3, 4, 5)),
    np.array([[-1.0, -1.0, 0.0], [2.0, 2.0, 0.0], [-1.0, -1.0, 0.0]]),
    np.ones((3, 3)),
    np.diag([2.0, -1.0, 2.0]),
    np.zeros((4, 4)),
]


def symmetric_functions(size: float) -> list[Callable[[Tensor], Tensor]]:
    """Functions of all eigenvalues, in any order, of matrices of about a size."""
    return [
        lambda values: values.real.sum(),
        lambda values: (values / size).pow(3).real.sum(),
        lambda values: torch.relu(values.real / size + 10.0).sum(),
        lambda values: ((values.real / size).exp() * (1.0 + values.imag / size).sin()).sum(),
    ]


def slope_of(function: Callable[[Tensor], Tensor], values: NDArray, slopes: NDArray) -> Floats:
    """Slope in A of a real function of the eigenvalues: `sum_i dl/dRe_i dRe_i/dA + dl/dIm_i dIm_i/dA`."""
    leaf = torch.tensor(values, requires_grad=True)
    (bar,) = torch.autograd.grad(function(leaf), leaf)
    return np.einsum("i,iab->ab", bar.conj().resolve_conj().numpy(), slopes).real


@ENGINES
def test_symmetric_functions_of_repeated_eigenvalues_have_the_slopes_of_torch_linalg(of):
    assert len(GALLERY) == 100
    for a in GALLERY:
        values, fired, slopes = of(a, LIMIT)
        assert fired == 0
        size = max(float(np.abs(values).max()), 1.0)
        for function in symmetric_functions(size):
            leaf = torch.tensor(a, requires_grad=True)
            (expected,) = torch.autograd.grad(function(torch.linalg.eigvals(leaf)), leaf)
            scale = max(1.0, float(expected.abs().max()))
            np.testing.assert_allclose(slope_of(function, values, slopes), expected, rtol=0, atol=1e-6 * scale)


@ENGINES
def test_the_slope_of_the_sum_is_the_identity(of):
    for a in GALLERY:
        _, _, slopes = of(a, LIMIT)
        np.testing.assert_allclose(slopes.sum(axis=0), np.eye(len(a)), atol=1e-9)


@ENGINES
@pytest.mark.parametrize("masses", [3, 4, 5, 6])
def test_stability_of_a_ring_of_equal_masses(of, masses):
    """The mean of `max(0, Re + 10)` of all eigenvalues has the slope `I / (2 masses)`."""
    _, _, slopes = of(ring(masses), LIMIT)
    np.testing.assert_allclose(slopes.real.mean(axis=0), np.eye(2 * masses) / (2 * masses), atol=1e-12)


@ENGINES
@pytest.mark.parametrize("seed", range(10))
def test_singular_matrices_of_low_rank(of, seed):
    """LAPACK's vectors of the eigenvalue zero may be parallel to the last bit; torch.linalg raises there."""
    random = np.random.default_rng(seed)
    n, rank = int(random.integers(3, 8)), 1 + seed % 2
    a = random.normal(size=(n, rank)) @ random.normal(size=(rank, n))
    values, fired, slopes = of(a, LIMIT)
    assert fired == 0
    np.testing.assert_allclose(slopes.sum(axis=0), np.eye(n), atol=1e-7)
    found = np.einsum("i,iab->ab", 2.0 * values, slopes)
    np.testing.assert_allclose(found, 2.0 * a.T, atol=1e-7 * np.abs(a).max())


@ENGINES
@pytest.mark.parametrize("n", [4, 5, 6])
def test_a_matrix_of_ones(of, n):
    """`sum lambda^3 = tr A^3` has the slope `3 (A^2)^T`; torch.linalg's is a third off for n = 6."""
    a = np.ones((n, n))
    values, fired, slopes = of(a, LIMIT)
    assert fired == 0
    np.testing.assert_allclose(np.einsum("i,iab->ab", 3.0 * values**2, slopes), 3.0 * n * a, atol=1e-10)


@ENGINES
@pytest.mark.parametrize("gap", 10.0 ** -np.arange(1.0, 15.0))
def test_the_sum_of_squares_of_two_close_pairs(of, gap):
    """`sum lambda^2 = tr A^2` has the slope `2 A^T`."""
    for seed in range(5):
        a = similar(block_diag(pair(-0.1, 2.0), pair(-0.1, 2.0 + gap)), seed)
        values, fired, slopes = of(a, LIMIT)
        assert fired == 0
        found = np.einsum("i,iab->ab", 2.0 * values, slopes)
        np.testing.assert_allclose(found, 2.0 * a.T, rtol=0, atol=1e-8 * np.abs(a).max())


@ENGINES
def test_eigenvalues_outside_of_the_cluster_are_untouched(of):
    """Each eigenvalue's own slope beside a repeated one, against that of the eigenvectors of the two matrices."""
    a = block_diag(ring(3), pair(-0.5, 3.0))
    values, _, slopes = of(a, LIMIT)
    own = int(np.argmin(np.abs(values - (-0.5 + 3.0j))))
    expected = np.zeros((8, 8), dtype=np.complex128)
    expected[6:, 6:] = [[0.5, 0.5j], [-0.5j, 0.5]]
    np.testing.assert_allclose(slopes[own], expected, atol=1e-12)


@ENGINES
@pytest.mark.parametrize("n", [3, 4, 6])
def test_a_defective_eigenvalue_is_bounded_and_counted(of, n):
    block = -np.eye(n) + np.diag(np.ones(n - 1), 1)
    random = np.linalg.qr(np.random.default_rng(n).normal(size=(n, n)))[0]
    for a in (block, random @ block @ random.T):
        _, fired, slopes = of(a, LIMIT)
        assert fired == n
        assert np.isfinite(slopes).all()
        assert (np.abs(np.einsum("iaa->ia", slopes)).sum(axis=1) <= LIMIT * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("a", [ring(3), ring(6), np.ones((3, 3)), similar(np.diag([1.0, 1.0, 2.0, -1.0]), 3)])
def test_vectors_in_a_cluster_are_dual_eigenvectors(a):
    values, vectors, left, guarded = eig(torch.tensor(a), LIMIT)
    full = torch.tensor(a, dtype=torch.complex128)
    torch.testing.assert_close(full @ vectors, vectors * values, rtol=0, atol=1e-13 * np.abs(a).sum())
    torch.testing.assert_close(full.mH @ left, left * values.conj(), rtol=0, atol=1e-13 * np.abs(a).sum())
    overlap = (left.mH @ vectors).abs()
    torch.testing.assert_close(overlap, torch.diag(overlap.diagonal()), rtol=0, atol=1e-13)
    for side in (vectors, left):
        torch.testing.assert_close(side.norm(dim=0), torch.ones(len(a), dtype=torch.float64))
        for i in np.flatnonzero(values.imag.numpy() > 0.0):
            assert torch.equal(side[:, i + 1], side[:, i].conj())
    assert int(guarded) > 0  # the eigenvectors' own derivatives do not exist


# ---- units ----------------------------------------------------------------------------------------------------------


@ENGINES
@pytest.mark.parametrize("frequency", [1e-5, 1.0, 1e5])
def test_the_slope_of_a_frequency_in_any_unit(of, frequency):
    """omega_d = sqrt(k - c^2 / 4), so that `d omega_d / dk = 1 / (2 omega_d)`."""
    stiffness, damping = frequency**2, 2.0 * 0.01 * frequency
    a = np.array([[0.0, 1.0], [-stiffness, -damping]])
    values, fired, slopes = of(a, LIMIT)
    assert fired == 0
    damped = frequency * np.sqrt(1.0 - 1e-4)
    upper = int(np.argmax(values.imag))
    assert values[upper].imag == pytest.approx(damped, rel=1e-12)
    assert -slopes[upper].imag[1, 0] == pytest.approx(0.5 / damped, rel=1e-9)


@ENGINES
@pytest.mark.parametrize("n", [2, 4, 6])
@pytest.mark.parametrize("limit", [1.5, 5.0, 1e4])
def test_the_guard_does_not_depend_on_the_units_of_the_states(of, n, limit):
    random = np.random.default_rng(n)
    a = random.normal(size=(n, n))
    values, fired, slopes = of(a, limit)
    for _ in range(5):
        units = 2.0 ** random.integers(-8, 9, size=n)  # exact, within what rounding leaves of the vectors
        found, there, scaled = of(a * units[:, None] / units, limit)
        assert there == fired
        order = [int(np.argmin(np.abs(found - value))) for value in values]
        back = scaled[order] * units[:, None] / units
        np.testing.assert_allclose(back, slopes, rtol=0, atol=1e-9 * np.abs(slopes).max())


@ENGINES
def test_a_chain_of_two_masses_at_high_frequency(of):
    slow = np.array([[0.0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, -0.02, 0.01], [1, -2, 0.01, -0.02]])
    unit = 1e5
    units = np.array([1.0, 1.0, unit, unit])
    values, _, slopes = of(slow, LIMIT)
    fast, fired, scaled = of(unit * slow * units[:, None] / units, LIMIT)
    assert fired == 0
    order = [int(np.argmin(np.abs(fast / unit - value))) for value in values]
    np.testing.assert_allclose(scaled[order] * units[:, None] / units, slopes, atol=1e-9)


def test_eigenvectors_mix_in_any_unit():
    """The derivative of an eigenvector of a fast oscillator is not cut off by a guard that reads rad/s."""
    stiff = torch.tensor(1e10, dtype=torch.float64, requires_grad=True)
    zero, one = torch.zeros_like(stiff), torch.ones_like(stiff)
    system = eig(torch.stack([torch.stack([zero, one]), torch.stack([-stiff, -2e3 * one])]), LIMIT)
    assert int(system.guarded) == 0
    # |v|^2 = (1, k) / (1 + k), so that the slope of the first entry is -1 / (1 + k)^2
    (slope,) = torch.autograd.grad(system.eigenvectors[0, 0].abs() ** 2, stiff)
    assert float(slope) == pytest.approx(-1.0 / (1.0 + 1e10) ** 2, rel=1e-6)


# ---- stiff matrices of two states -----------------------------------------------------------------------------------


def exactly(a: Floats) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real eigenvalues `(2,)` and `d lambda / dA (2, 2, 2)` with 60 digits, rounded."""
    with mpmath.workdps(60):
        (p, b), (c, d) = (tuple(map(mpmath.mpf, row)) for row in a.tolist())
        root = mpmath.sqrt(((p - d) / 2) ** 2 + b * c)
        values = [(p + d) / 2 + sign * root for sign in (1, -1)]
        slopes = [
            [[(value - d) / gap, c / gap], [b / gap, (value - p) / gap]]
            for value, gap in ((values[0], 2 * root), (values[1], -2 * root))
        ]
        return np.array(values, dtype=np.float64), np.array(slopes, dtype=np.float64)


STIFF = {
    **{f"1e{k}": [[0.0, 1.0], [-1.0, -(10.0**k)]] for k in (6, 7, 8, 12)},
    "unstable": [[0.0, 1.0], [-3.0, 1e7]],
    "saddle": [[0.0, 1.0], [3.0, -1e7]],
    "upper": [[-1e8, 7.0], [-2.0, -0.3]],
    "cancelling determinant": [[-1e8, 1e4], [1e4, -1.0000001]],
    "coupled": [[-3e5, 2e5 + 0.1], [3e5, -2e5]],
    "triangular": [[-1e9, 5.0], [0.0, -1.0]],
}


@ENGINES
@pytest.mark.parametrize("a", STIFF.values(), ids=STIFF)
def test_stiff_matrices_of_two_states(of, a):
    a = np.array(a)
    expected, expected_slopes = exactly(a)
    values, fired, slopes = of(a, LIMIT)
    assert fired == 0
    assert (values.imag == 0.0).all()
    order = [int(np.argmin(np.abs(values.real - value))) for value in expected]
    np.testing.assert_allclose(values.real[order], expected, rtol=2e-15)
    np.testing.assert_allclose(slopes.real[order], expected_slopes, rtol=1e-14, atol=1e-300)


@ENGINES
@pytest.mark.parametrize("seed", range(20))
def test_random_stiff_matrices_of_two_states(of, seed):
    random = np.random.default_rng(seed)
    basis = random.normal(size=(2, 2))
    a = basis @ np.diag([-(10.0 ** random.uniform(0, 2)), -(10.0 ** random.uniform(9, 12))]) @ np.linalg.inv(basis)
    expected, expected_slopes = exactly(a)
    values, _, slopes = of(a, LIMIT)
    order = [int(np.argmin(np.abs(values.real - value))) for value in expected]
    np.testing.assert_allclose(values.real[order], expected, rtol=1e-14)
    np.testing.assert_allclose(slopes.real[order], expected_slopes, rtol=1e-13)
