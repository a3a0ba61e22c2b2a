import numpy as np
import pytest

from eigenode_cli.bench.agreement import GRADIENTS, VALUES, agreement
from eigenode_cli.bench.contestants import Result

OURS = Result(np.array([2.0, 0.0]), np.array([[3.0, 4.0], [0.0, 0.0]]), 7)


def test_the_same_agrees_with_itself_where_a_term_is_zero() -> None:
    same = agreement(OURS, OURS)
    assert same.holds
    assert same.as_json() == {"values": [0.0, 0.0], "gradients": [0.0, 0.0], "steps": 7}


@pytest.mark.parametrize(("factor", "holds"), [(0.5, True), (2.0, False)])
def test_values_are_held_to_a_relative_bound(factor: float, holds: bool) -> None:
    other = Result(OURS.values * (1.0 + factor * VALUES), OURS.gradients, 8)
    assert agreement(other, OURS).holds is holds


@pytest.mark.parametrize(("factor", "holds"), [(0.5, True), (2.0, False)])
def test_gradients_are_held_to_the_norm_of_their_difference(factor: float, holds: bool) -> None:
    # across the gradient: its own norm does not change to first order
    other = OURS.gradients + factor * GRADIENTS * np.array([[-4.0, 3.0], [0.0, 0.0]])
    assert agreement(Result(OURS.values, other, 8), OURS).holds is holds


@pytest.mark.parametrize("spoiled", ["values", "gradients"])
def test_nan_never_agrees(spoiled: str) -> None:
    values, gradients = OURS.values.copy(), OURS.gradients.copy()
    (values if spoiled == "values" else gradients)[0] = np.nan
    assert not agreement(Result(values, gradients, 8), OURS).holds


def test_a_term_that_ought_to_be_zero_is_not_forgiven() -> None:
    assert not agreement(Result(np.array([2.0, 1e-9]), OURS.gradients, 8), OURS).holds
