"""Mode k is the same mode at all times, whatever order the eigenvalues come in."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenode_cli.spectra.eig import eig
from eigenode_cli.spectra.pairs import UNMATCHED
from eigenode_cli.spectra.tracking import assign, canonical_order, predict, track


def eigensystems(matrices):
    system = eig(torch.from_numpy(matrices))
    return system.eigenvalues.numpy(), system.eigenvectors.numpy(), system.left.numpy()


def two_oscillators(count):
    """Decoupled, angular frequencies 1 + t and 3 - t: they cross at t = 1, where the spectrum is degenerate."""
    times = np.linspace(0.0, 2.0, count)
    matrices = np.zeros((count, 4, 4))
    for k, omega in enumerate((1.0 + times, 3.0 - times)):
        matrices[:, 2 * k, 2 * k + 1] = omega
        matrices[:, 2 * k + 1, 2 * k] = -omega
    return times, matrices


def shuffled(spectra, vectors, seed):
    permutations = np.random.default_rng(seed).permuted(np.tile(np.arange(spectra.shape[1]), (len(spectra), 1)), axis=1)
    return (
        np.take_along_axis(spectra, permutations, 1),
        np.take_along_axis(vectors, permutations[:, None, :], 2),
        permutations,
    )


@pytest.mark.parametrize("count", [20, 40, 200])  # even: no time lies on the crossing itself
@pytest.mark.parametrize("predicted", [False, True])
def test_crossing_frequencies_of_decoupled_modes(count, predicted):
    times, matrices = two_oscillators(count)
    spectra, vectors, left = eigensystems(matrices)
    prediction = predict(matrices, spectra, vectors, left) if predicted else None
    tracked = np.take_along_axis(spectra, track(spectra, vectors, prediction), 1)
    rising, falling = 1j * (1.0 + times), 1j * (3.0 - times)
    expected = np.stack([rising, -rising, falling, -falling], axis=1)
    np.testing.assert_allclose(tracked, expected, atol=1e-13)


@settings(max_examples=25, deadline=None)
@given(n=st.integers(1, 6), seed=st.integers(0, 1000))
def test_the_order_of_the_input_does_not_matter(n, seed):
    generator = np.random.default_rng(seed)
    start, end = generator.standard_normal((2, n, n))
    matrices = start + np.linspace(0.0, 0.2, 15)[:, None, None] * end
    spectra, vectors, _ = eigensystems(matrices)
    tracked = np.take_along_axis(spectra, track(spectra, vectors), 1)
    mixed, mixed_vectors, _ = shuffled(spectra, vectors, seed)
    np.testing.assert_array_equal(np.take_along_axis(mixed, track(mixed, mixed_vectors), 1), tracked)


def test_random_swaps_are_recovered():
    matrix = np.random.default_rng(2).standard_normal((6, 6))
    spectra, vectors, _ = eigensystems(np.tile(matrix, (50, 1, 1)))
    mixed, mixed_vectors, permutations = shuffled(spectra, vectors, 3)
    found = np.take_along_axis(permutations, track(mixed, mixed_vectors), 1)
    np.testing.assert_array_equal(found, np.tile(canonical_order(spectra[0]), (50, 1)))


def test_every_row_is_a_permutation_and_norm_and_phase_of_vectors_do_not_count():
    _, matrices = two_oscillators(31)  # one time on the crossing
    spectra, vectors, _ = eigensystems(matrices)
    generator = np.random.default_rng(4)
    factors = generator.uniform(0.5, 2.0, (31, 1, 4)) * np.exp(1j * generator.uniform(0.0, 6.0, (31, 1, 4)))
    order = track(spectra, vectors)
    np.testing.assert_array_equal(np.sort(order, axis=1), np.tile(np.arange(4), (31, 1)))
    np.testing.assert_array_equal(track(spectra, vectors * factors), order)


def test_rows_with_nan_keep_the_identity_and_are_bridged():
    times, matrices = two_oscillators(40)
    spectra, vectors, left = eigensystems(matrices)
    prediction = predict(matrices, spectra, vectors, left)
    spectra[[0, 7, 8, 39]] = np.nan
    vectors[12, 0, 0] = np.nan
    order = track(spectra, vectors, prediction)
    lost = [0, 7, 8, 12, 39]
    np.testing.assert_array_equal(order[lost], np.tile(np.arange(4), (5, 1)))
    kept = np.setdiff1d(np.arange(40), lost)
    first = np.take_along_axis(spectra, order, 1)[kept, 0]
    np.testing.assert_allclose(first, 1j * (1.0 + times[kept]), atol=1e-13)
    nothing = np.full((3, 4), np.nan + 0j)
    np.testing.assert_array_equal(track(nothing, np.full((3, 4, 4), np.nan + 0j)), np.tile(np.arange(4), (3, 1)))


def test_a_pair_that_splits_and_forms_again_keeps_its_modes():
    """Damping ratio 0.5 to 1.5 and back, beside a real eigenvalue: upper member and right one go together."""
    ratio = 1.0 + 0.5 * np.cos(np.linspace(np.pi, 3.0 * np.pi, 60))
    matrices = np.zeros((60, 3, 3))
    matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1], matrices[:, 2, 2] = 1.0, -1.0, -2.0 * ratio, -6.0
    spectra, vectors, _ = eigensystems(matrices)
    mixed, mixed_vectors, _ = shuffled(spectra, vectors, 6)
    tracked = np.take_along_axis(mixed, track(mixed, mixed_vectors), 1)
    root = np.sqrt((ratio**2 - 1.0).astype(np.complex128))
    pair = tracked[:, [k for k in range(3) if abs(tracked[0, k] + 6.0) > 1.0]]
    np.testing.assert_allclose(pair, np.stack([-ratio + root, -ratio - root], axis=1), atol=1e-7)


def test_prediction_is_first_order():
    generator = np.random.default_rng(8)
    start, step = generator.standard_normal((2, 5, 5))
    errors = []
    for h in (1e-3, 1e-4):
        matrices = np.stack([start, start + h * step])
        spectra, vectors, left = eigensystems(matrices)
        expected = predict(matrices, spectra, vectors, left)[0]
        errors.append(np.abs(expected[:, None] - spectra[1][None, :]).min(1).max())
    assert 80.0 < errors[0] / errors[1] < 125.0  # a tenth of the step, a hundredth of the error


def test_prediction_of_a_defective_matrix_is_none_and_tracking_goes_on_without():
    matrices = np.stack([np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [0.0, -0.1]])])
    spectra, vectors, left = eigensystems(matrices)
    prediction = predict(matrices, spectra, vectors, left)
    assert np.isnan(prediction).all()
    np.testing.assert_array_equal(np.sort(track(spectra, vectors, prediction), axis=1), [[0, 1], [0, 1]])


def test_targets_find_their_eigenvalues():
    spectrum = np.array([-1.0 + 2.0j, -1.0 - 2.0j, -3.0, -0.5])
    np.testing.assert_array_equal(assign(spectrum, np.array([-0.4, -1.1 - 2j, -2.5, -1 + 2.2j])), [3, 1, 2, 0])
    np.testing.assert_array_equal(assign(spectrum, np.array([np.nan, -2.9 + 0j])), [UNMATCHED, 2])
    more = assign(spectrum[2:], np.array([-3.1 + 0j, 50.0, -0.5]))
    np.testing.assert_array_equal(more, [0, UNMATCHED, 1])
    assert assign(np.full(2, np.nan + 0j), np.array([1.0 + 0j])).tolist() == [UNMATCHED]
    # the smallest sum, not the nearest each: both would like -1
    np.testing.assert_array_equal(assign(np.array([-1.0 + 0j, -2.0]), np.array([-1.2 + 0j, -1.1])), [1, 0])


def test_canonical_order():
    spectrum = np.array([-1 - 5j, -2.0, -1 + 5j, 1 - 2j, -1.0, 1 + 2j])
    np.testing.assert_array_equal(canonical_order(spectrum), [4, 1, 5, 3, 2, 0])
