"""Combinations by hand-made gradients."""

import numpy as np
import pytest

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.combine import COMBINATIONS, SEQUENTIAL_REPEATING_LAST, combine

GRADIENTS = np.array([[1.0, -2.0, 0.0], [3.0, 1.0, -1.0]])
EXPECTED = {
    "sequential": GRADIENTS,
    "sum": [[4.0, -1.0, -1.0]],
    "mean": [[2.0, -0.5, -0.5]],
    "switch": [[3.0, 1.0, -1.0]],
    "mix": [[3.0, -2.0, -1.0]],
}


def updates(code: int, gradients: Floats, scales: Floats | None = None) -> Floats:
    room = np.full((gradients.shape[0] + 1, gradients.shape[1]), np.nan)
    factors = np.ones(gradients.shape[0]) if scales is None else scales
    return room[: combine(code, gradients, factors, room)]


@pytest.mark.parametrize("name", COMBINATIONS)
def test_updates(name: str) -> None:
    np.testing.assert_array_equal(updates(COMBINATIONS[name], GRADIENTS), EXPECTED[name])


@pytest.mark.parametrize("name", COMBINATIONS)
def test_a_single_gradient_passes_unchanged(name: str) -> None:
    np.testing.assert_array_equal(updates(COMBINATIONS[name], GRADIENTS[:1]), GRADIENTS[:1])


def test_authors_quirk_is_not_an_update() -> None:
    """It is the step that comes twice (`tests/training/test_update.py`), not the gradient."""
    np.testing.assert_array_equal(updates(SEQUENTIAL_REPEATING_LAST, GRADIENTS), GRADIENTS)


@pytest.mark.parametrize("name", COMBINATIONS)
def test_zero_and_undefined_gradients_do_not_act(name: str) -> None:
    gradients = np.array([[0.0, 0.0], [np.nan, 1.0], [1.0, 2.0], [np.inf, 0.0]])
    found = updates(COMBINATIONS[name], gradients, np.array([1.0, 1.0, 10.0, 1.0]))
    np.testing.assert_array_equal(found, [[10.0, 20.0]])


@pytest.mark.parametrize("name", COMBINATIONS)
def test_no_update_where_no_gradient_acts(name: str) -> None:
    assert updates(COMBINATIONS[name], np.array([[0.0, 0.0], [np.nan, 1.0]])).shape == (0, 2)
