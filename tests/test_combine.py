"""Combinations by hand-made gradients."""

import numpy as np
import pytest

from eigenode_cli.combine import COMBINATIONS, acting, sequential_repeating_last

GRADIENTS = np.array([[1.0, -2.0, 0.0], [3.0, 1.0, -1.0]])
EXPECTED = {
    "sequential": GRADIENTS,
    "sum": [[4.0, -1.0, -1.0]],
    "mean": [[2.0, -0.5, -0.5]],
    "switch": [[3.0, 1.0, -1.0]],
    "mix": [[3.0, -2.0, -1.0]],
}


@pytest.mark.parametrize("name", COMBINATIONS)
def test_updates(name: str) -> None:
    np.testing.assert_array_equal(COMBINATIONS[name](GRADIENTS), EXPECTED[name])


@pytest.mark.parametrize("name", COMBINATIONS)
def test_a_single_gradient_passes_unchanged(name: str) -> None:
    np.testing.assert_array_equal(COMBINATIONS[name](GRADIENTS[:1]), GRADIENTS[:1])


def test_authors_quirk_repeats_the_last_update() -> None:
    np.testing.assert_array_equal(sequential_repeating_last(GRADIENTS), GRADIENTS[[0, 1, 1]])


def test_zero_and_undefined_gradients_do_not_act() -> None:
    gradients = np.array([[0.0, 0.0], [np.nan, 1.0], [1.0, 2.0], [np.inf, 0.0]])
    np.testing.assert_array_equal(acting(gradients, np.array([1.0, 1.0, 10.0, 1.0])), [[10.0, 20.0]])
