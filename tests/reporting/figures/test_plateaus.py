"""Local minima on curves whose minima are known."""

import numpy as np
import pytest

from eigenode_cli.reporting.figures.plateaus import CHANGE, FEWEST, plateaus

STEPS = np.arange(0.0, 5001.0, 25.0)


def fall(level: float, leave: float, final: float) -> np.ndarray:
    """A loss that stands at `level` until the step `leave` and then falls to `final`."""
    return np.where(leave >= STEPS, level, final + (level - final) * np.exp(-(STEPS - leave) / 200.0))


def test_level_of_a_passed_minimum() -> None:
    (minimum,) = plateaus(STEPS, fall(0.578, 2000.0, 0.01), solved=0.05)
    assert minimum.level == 0.578
    assert minimum.start == 0.0
    assert minimum.stop == pytest.approx(2000.0, abs=25.0)


def test_final_level_counts_unless_it_is_the_solution() -> None:
    values = fall(0.578, 1000.0, 0.2)
    assert [round(m.level, 2) for m in plateaus(STEPS, values, solved=0.1)] == [0.58, 0.2]
    assert [round(m.level, 2) for m in plateaus(STEPS, values, solved=0.3)] == [0.58]


@pytest.mark.parametrize(("length", "count"), [(450.0, 0), (500.0, 1)])
def test_shortest_plateau_is_a_tenth_of_the_steps(length: float, count: int) -> None:
    values = np.exp(-STEPS / 300.0)
    stands = (STEPS >= 1000.0) & (1000.0 + length >= STEPS)
    values[stands] = 5.0
    assert len(plateaus(STEPS, values, solved=0.0)) == count


def test_steady_decay_has_no_minimum() -> None:
    assert plateaus(STEPS, np.exp(-STEPS / 1000.0), solved=0.0) == []


@pytest.mark.parametrize(("ripple", "count"), [(0.4 * CHANGE, 1), (0.6 * CHANGE, 0)])
def test_a_few_percent_of_change(ripple: float, count: int) -> None:
    values = 1.0 + ripple * np.where(np.arange(STEPS.size) % 2 == 0, 1.0, -1.0)
    assert len(plateaus(STEPS, values, solved=0.0)) == count


def test_a_minimum_visited_twice_is_one() -> None:
    values = np.full(STEPS.size, 0.5)
    values[70:100] = 3.0 - 0.05 * np.arange(30)
    values[100:] = 0.51
    (minimum,) = plateaus(STEPS, values, solved=0.0)
    assert (minimum.start, minimum.level) == (2500.0, 0.51)


@pytest.mark.parametrize("gap", [np.nan, np.inf, 0.0, -1.0])
def test_a_failed_record_ends_a_plateau(gap: float) -> None:
    values = np.full(STEPS.size, 0.5)
    values[5::10] = gap
    assert plateaus(STEPS, values, solved=0.0) == []


@pytest.mark.parametrize(("size", "count"), [(1, 0), (2, 0), (FEWEST - 1, 0), (FEWEST, 1)])
def test_fewest_records(size: int, count: int) -> None:
    assert len(plateaus(STEPS[:size], np.ones(size), solved=0.0)) == count


def test_scale_invariance() -> None:
    values = fall(0.578, 2000.0, 0.01)
    few = plateaus(STEPS, values, solved=0.05)
    many = plateaus(3.0 * STEPS, 1e-6 * values, solved=0.05e-6)
    assert [(3.0 * m.start, 3.0 * m.stop, pytest.approx(1e-6 * m.level)) for m in few] == [
        (m.start, m.stop, m.level) for m in many
    ]
