"""What counts as a pair, from what size on, and which target each one is compared with."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eigenode_cli.data.simulate import Truth
from eigenode_cli.data.targets import StatedTarget, Targets, TruthTarget, targets_of_spectra
from eigenode_cli.spectra.pairs import ROUNDING, assign_rows, find_partners, rounding_levels, without_rounding
from eigenode_cli.systems import Oscillator
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.torch_terms import spectral_values

MERGED = [(9.0, 6.0), (25.0, 10.0), (2.0, 2.8284271247461903)]
"""Stiffness and damping at which a pair merges: rounding makes it a pair, equal, or real and apart."""


def terms_of(matrices: NDArray, targets: Targets, *names: str) -> tuple[NDArray, NDArray]:
    """Recorded values `(L,)` of the terms of `matrices (T, n, n)` and their slopes in the spectra `(L, T, n)`."""
    spectra = torch.from_numpy(np.linalg.eigvals(matrices).astype(np.complex128)).requires_grad_()
    levels, errors = rounding_levels(matrices), np.zeros(len(NAMES), dtype=np.int64)
    trained = spectral_values(spectra, names, targets, 0.0, errors, 1.0, levels)
    slopes = [torch.autograd.grad(value, spectra, retain_graph=True)[0].numpy() for value in trained]
    recorded = spectral_values(spectra.detach(), names, targets, 0.0, errors, 1.0, levels, recorded=True)
    return recorded.numpy(), np.stack(slopes)


def count_pairs(matrices: NDArray) -> list[int]:
    spectra, partner = np.linalg.eigvals(matrices).astype(np.complex128), np.empty(matrices.shape[1], dtype=np.int64)
    return [find_partners(*pair, partner) for pair in zip(spectra, rounding_levels(matrices), strict=True)]


def similar(matrix: NDArray, condition: float, seed: int) -> NDArray:
    """A matrix of the same spectrum, in a random basis of a given condition."""
    random, n = np.random.default_rng(seed), len(matrix)
    left, right = (np.linalg.qr(random.normal(size=(n, n)))[0] for _ in range(2))
    basis = left @ np.diag(np.geomspace(1.0, 1.0 / condition, n)) @ right
    return basis @ matrix @ np.linalg.inv(basis)


def with_zeros(frequency: float, defective: bool) -> NDArray:
    """A pair of this frequency in Hz, and twice the eigenvalue 0."""
    matrix, imag = np.zeros((4, 4)), 2.0 * np.pi * frequency
    matrix[:2, :2] = [[-0.3, imag], [-imag, -0.3]]
    matrix[2, 3] = float(defective)
    return matrix


@pytest.mark.parametrize(("stiffness", "damping"), MERGED)
def test_merged_pairs_are_treated_alike(stiffness: float, damping: float) -> None:
    system = Oscillator(stiffness, damping)
    states = np.ones((3, 2))
    times = np.linspace(0.0, 0.1, 3)
    target = TruthTarget(Truth(system, (1.0, 1.0)))
    assert target.rows(times).pairs.tolist() == [0, 0, 0]
    assert not target.spectra(times).imag.any()
    np.testing.assert_allclose(target.spectra(times).real, -damping / 2.0, rtol=1e-7)
    assert count_pairs(system.jacobian(states)) == [0, 0, 0]
    # a pair of a thousandth of that frequency is one
    near = Oscillator(stiffness * (1.0 + 1e-6), damping)
    assert TruthTarget(Truth(near, (1.0, 1.0))).rows(times).pairs.tolist() == [1, 1, 1]


@pytest.mark.parametrize("defective", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_zero_eigenvalues_make_no_pair_and_no_steep_slope(seed: int, defective: bool) -> None:
    condition = [1.0, 10.0, 100.0, 1000.0][seed % 4]
    matrices = np.stack([similar(with_zeros(0.5, defective), condition, seed)] * 2)
    targets = StatedTarget([0.1], [0.05]).rows(np.zeros(2))
    assert count_pairs(matrices) == [1, 1]
    values, slopes = terms_of(matrices, targets, "frq", "dmp", "stf")
    assert values[0] == pytest.approx(2.0 * 0.4 / 4.0, rel=1e-6)
    assert np.isnan(values[2])  # max|Re| / 0
    assert not slopes[2].any()
    assert np.abs(slopes[1]).max() < 1.0  # that of a pair of 0.5 Hz is 1 / (4 pi)


@pytest.mark.parametrize(("n", "hidden"), [(2, 3), (4, 3), (4, 2), (6, 4)])
@pytest.mark.parametrize("second_order", [False, True])
def test_jacobians_of_relu_networks_have_no_pair_from_rounding(n: int, hidden: int, second_order: bool) -> None:
    random, m = np.random.default_rng(10 * n + hidden), n // 2 if second_order else n
    matrices = np.zeros((100, n, n))
    for matrix in matrices:
        matrix[: n - m, n - m :] = np.eye(n - m, m)
        first, last = random.normal(size=(hidden, n)), random.normal(size=(m, hidden))
        active = first @ random.normal(size=n) + random.normal(size=hidden) > 0.0
        matrix[n - m :] = last @ np.diag(active) @ first
    levels, size = rounding_levels(matrices), np.linalg.norm(matrices, axis=(1, 2))
    spectra = without_rounding(np.linalg.eigvals(matrices).astype(np.complex128), levels)
    shares = np.abs(spectra.imag) / np.maximum(size, 1e-300)[:, None]
    assert not ((shares > 0.0) & (shares < 1e-4)).any()  # true ones are far larger, those of rounding below 1e-7
    stiffness = np.full((100, 2), 1.0)
    targets = Targets(np.full((100, 1), 0.2), np.full((100, 1), 0.1), np.full(100, 1), stiffness)
    _, (dmp, stf) = terms_of(matrices, targets, "dmp", "stf")
    real = np.abs(spectra.real).max(axis=1)
    assert (100.0 * np.abs(dmp).max(axis=1) * levels <= 1.0).all()
    assert (100.0 * np.abs(stf).max(axis=1) * levels**2 <= real + levels).all()


def test_the_rounding_level_does_not_depend_on_units() -> None:
    matrix = np.random.default_rng(0).normal(size=(5, 5))
    units = np.array([1.0, 1e-3, 1e4, 1e-6, 1e3])
    [plain, other] = rounding_levels(np.stack([matrix, matrix * units[:, None] / units]))
    assert other == pytest.approx(plain, rel=0.05)
    # 16 MHz in SI units: the norm as it stands is 1e8 times the frequency
    fast = np.array([[0.0, 1.0], [-1e16, -1e6]])
    assert count_pairs(fast[None]) == [1]
    assert rounding_levels(fast[None])[0] == pytest.approx(ROUNDING * np.sqrt(2e16 + 1e12), rel=1e-12)


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e-170, 1e160, 1e300])
def test_no_matrix_is_too_small_or_too_large_for_a_level(scale: float) -> None:
    matrix = np.array([[-1.0, 3.0, 0.0], [-3.0, -1.0, 0.0], [0.0, 1.0, 2.0]])
    [plain, scaled] = rounding_levels(np.stack([matrix, scale * matrix]))
    assert scaled == pytest.approx(scale * plain, rel=1e-12)


@pytest.mark.parametrize("seed", range(1000))
def test_assignment_is_that_of_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    m, more = random.integers(1, 8), random.integers(0, 4)
    cost = random.uniform(size=(m, m + more)) if seed % 2 else random.integers(0, 4, (m, m + more)).astype(np.float64)
    columns = assign_rows(cost)
    assert np.unique(columns).size == m
    assert cost[np.arange(m), columns].sum() == pytest.approx(cost[linear_sum_assignment(cost)].sum(), abs=1e-12)


@pytest.mark.parametrize("seed", range(100))
def test_a_model_like_the_truth_fits_perfectly_if_modes_share_a_frequency(seed: int) -> None:
    """Three modes, two of them of one frequency that differ in their damping, in any order."""
    random = np.random.default_rng(seed)
    upper = np.array([-0.1 + 5.0j, -0.9 + 5.0j * (1.0 + 1e-12 * random.normal()), -0.2 + 9.0j])
    matrix = np.zeros((6, 6))
    for i, value in enumerate(upper):
        matrix[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[value.real, value.imag], [-value.imag, value.real]]
    matrices = similar(matrix, 3.0, seed)[None]
    targets = targets_of_spectra(np.concatenate([random.permutation(upper), upper.conj()])[None])
    values, _ = terms_of(matrices, targets, "frq", "dmp")
    np.testing.assert_allclose(values, 0.0, atol=1e-9)


def test_stated_pairs_follow_the_same_rule() -> None:
    targets = StatedTarget([1.0, 2.0], [0.1, 1e-17]).rows(np.zeros(1))
    assert np.isinf(targets.stiffness).all()  # a damping ratio that is lost in rounding is none
    targets = StatedTarget([1.0, 2.0], [0.1, 0.2]).rows(np.zeros(1))
    assert targets.stiffness[0, 0] == pytest.approx(2.0 * 0.2 / 0.1 * np.sqrt(0.99 / 0.96))
