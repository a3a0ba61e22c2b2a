"""How a training ends: by which rule it has diverged, and where BFGS is at an optimum."""

import math

import numpy as np
import pytest

from eigenode_cli.batch.run import EXIT
from eigenode_cli.training.ending import DIVERGED, ENDED, FINAL, FINISHED, STATUSES, UNSUCCESSFUL, judge
from eigenode_cli.training.total_loss import FLAT, stationary


@pytest.mark.parametrize(
    ("first", "last", "failure", "zero", "status"),
    [
        (0.5, 0.01, None, 0.6, FINISHED),
        (0.5, 40.0, None, 0.6, FINISHED),  # a bad fit
        (0.5, 59.0, None, 0.6, FINISHED),
        (0.5, 61.0, None, 0.6, DIVERGED),
        (0.5, 4e4, None, 0.6, DIVERGED),
        (65.0, 6e3, None, 0.6, FINISHED),  # it started far out
        (65.0, 4e4, None, 0.6, DIVERGED),
        (1e-9, 1e-3, None, 0.6, FINISHED),  # a good start, and still good
        (0.5, math.inf, None, 0.6, DIVERGED),
        (None, 0.1, None, 0.6, FINISHED),  # could not be solved at the start
        (None, 4e4, None, 0.6, DIVERGED),
        (None, math.nan, "underflow", 0.6, FINISHED),  # never could be
        (0.5, math.nan, "underflow", 0.6, DIVERGED),
        (0.5, 4e4, None, math.nan, FINISHED),  # SOL was not trained, it may be what it is
        (0.0, 0.0, None, 0.0, FINISHED),
    ],
)
def test_a_training_has_diverged_where_sol_left_both_the_start_and_the_data_behind(
    first: float | None, last: float, failure: str | None, zero: float, status: str
) -> None:
    ending = judge(first, last, failure, zero)
    assert ending.status == status
    assert (ending.reason is None) == (status == FINISHED)


def test_every_status_is_of_one_kind_and_has_an_exit_status() -> None:
    assert set(ENDED) == {FINISHED, *UNSUCCESSFUL}
    assert set(STATUSES) - set(ENDED) == {"running", "interrupted"}
    assert set(FINAL) < set(ENDED)
    assert set(EXIT) == set(STATUSES) - {"running"}
    assert {status: EXIT[status] for status in ENDED} == {FINISHED: 0} | dict.fromkeys(UNSUCCESSFUL, 1)


def test_a_function_is_flat_where_no_parameter_of_its_own_size_changes_it() -> None:
    gradient, theta = 0.9 * np.array([FLAT, -FLAT / 10.0]), np.array([0.1, 10.0])
    assert stationary(gradient, theta, 1.0)
    assert not stationary(2.0 * gradient, theta, 1.0)
    assert not stationary(gradient, 2.0 * theta, 1.0)
    assert stationary(2.0 * gradient, theta, 2.0)
    assert stationary(np.zeros(2), theta, 0.0)
