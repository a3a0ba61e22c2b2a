"""Schedules of the learning rate: their formulas, and a plateau that remembers."""

import math

import numpy as np
import pytest

from eigenode_cli.training.methods import Sgd
from eigenode_cli.training.optimizers import Optimizer
from eigenode_cli.training.schedules import Cosine, Exponential, Plateau, Schedule


def test_exponential_decays_in_stairs_to_its_end() -> None:
    schedule = Exponential(extra=9e-3, decay=2e-3, every=10)
    rates = [schedule.rate(1e-3, k) for k in range(5001)]
    assert rates[:10] == pytest.approx([1e-2] * 10)
    assert rates[4990] == rates[4999] == 1e-3 + 9e-3 * math.exp(-9.98)
    assert np.all(np.diff(rates)[9::10] < 0.0)
    assert len(set(rates)) == 501


def test_cosine_falls_from_the_rate_to_its_share() -> None:
    schedule = Cosine(steps=101, final=0.1)
    rates = np.array([schedule.rate(2.0, k) for k in range(120)])
    assert rates[0] == 2.0
    assert rates[50] == pytest.approx(1.1)
    np.testing.assert_allclose(rates[100:], 0.2)
    assert np.all(np.diff(rates[:101]) < 0.0)


def test_constant_and_single_step() -> None:
    assert Schedule().rate(0.3, 7) == 0.3
    assert Cosine(steps=1).rate(0.3, 0) == 0.3


def test_a_plateau_lowers_the_rate_after_its_patience_and_not_below_the_smallest() -> None:
    optimizer = Optimizer(Sgd(lr=1.0), 2, Plateau(factor=0.5, patience=2, smallest=0.2))
    rates = []
    for value in (3.0, 2.0, 2.0, 2.5, 1.0, math.inf, math.inf, 1.0, 1.0, 1.0, 1.0):
        optimizer.observe(value)
        rates.append(optimizer.lr(0))
    assert rates == [1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.25, 0.25, 0.2, 0.2, 0.2]
    other = Optimizer(Sgd(lr=1.0), 2, Plateau(factor=0.5, patience=2))
    other.state()["plateau"][:] = optimizer.state()["plateau"]
    assert other.lr(5) == 0.2
