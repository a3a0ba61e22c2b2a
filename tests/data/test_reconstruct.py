"""States that were not measured, from those that were; what a dataset says of itself."""

import numpy as np
import pytest

from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.reconstruct import reconstruct
from eigenode_cli.data.simulate import Truth, simulate
from eigenode_cli.systems import Oscillator

TIMES = np.linspace(0.0, 4.0, 81)
TRUTH = Truth(Oscillator(c=9.0, d=0.4), (1.0, 0.5))


def test_velocity_is_the_derivative_of_the_position() -> None:
    series = simulate(TRUTH, TIMES, ["s"]).series[0]
    states, estimate = TRUTH.states(TIMES), reconstruct(series, "second_order")
    np.testing.assert_array_equal(estimate.states[:, 0], states[:, 0])
    assert np.abs(estimate.states[5:-5, 1] - states[5:-5, 1]).max() < 0.01
    rates = TRUTH.system.dynamics(states)
    assert np.abs(estimate.rates[5:-5, 1] - rates[5:-5, 1]).max() < 0.2
    assert estimate.states[0, 1] == 0.5  # it is known
    assert estimate.complete


def test_position_is_the_integral_of_the_velocity() -> None:
    series = simulate(TRUTH, TIMES, ["v"]).series[0]
    estimate = reconstruct(series, "second_order")
    assert np.abs(estimate.states[:, 0] - TRUTH.states(TIMES)[:, 0]).max() < 0.01


def test_noise_is_smoothed_before_it_is_differentiated() -> None:
    series = simulate(TRUTH, TIMES, ["s"], noise=0.05, seed=1).series[0]
    velocity = reconstruct(series, "second_order").states[:, 1]
    noisy = np.gradient(series.values[:, 0], TIMES)
    exact = TRUTH.states(TIMES)[:, 1]
    assert np.std(velocity - exact) < 0.3 * np.std(noisy - exact)


def test_nothing_is_made_up_without_a_structure() -> None:
    estimate = reconstruct(simulate(TRUTH, TIMES, ["s"]).series[0], "full")
    assert not estimate.complete
    assert np.isnan(estimate.states[1:, 1]).all()
    assert reconstruct(simulate(TRUTH, TIMES, ["s", "v"]).series[0], "full").complete


def test_few_samples_and_gaps_do() -> None:
    series = simulate(TRUTH, TIMES[::20], ["s"]).series[0]
    assert reconstruct(series, "second_order").complete
    values = simulate(TRUTH, TIMES, ["s"]).series[0].values.copy()
    values[10:20] = np.nan
    filled = reconstruct(Series(TIMES, values, np.array([1.0, 0.5])), "second_order")
    assert np.abs(filled.states[10:20, 0] - TRUTH.states(TIMES)[10:20, 0]).max() < 0.02


def test_a_series_checks_itself() -> None:
    with pytest.raises(ValueError, match="there are 3 times"):
        Series(np.arange(3.0), np.zeros((2, 2)), np.zeros(2))
    with pytest.raises(ValueError, match="nothing was measured"):
        Series(np.arange(3.0), np.full((3, 2), np.nan), np.zeros(2))
    with pytest.raises(ValueError, match="the initial state has shape"):
        Series(np.arange(3.0), np.zeros((3, 2)), np.zeros(3))
    with pytest.raises(ValueError, match="named are s"):
        Dataset(Series(np.arange(3.0), np.zeros((3, 2)), np.zeros(2)), ["s"])
    with pytest.raises(ValueError, match="not of the states s, v"):
        simulate(TRUTH, TIMES, ["x"])
