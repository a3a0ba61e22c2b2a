"""Cutting a problem for a growing horizon, and choosing what a failed solve still contributes."""

import numpy as np
import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import build
from tests.conftest import make_case


@pytest.mark.parametrize(("fraction", "count"), [(0.25, 26), (0.5, 51), (1.0, 101), (1e-6, 3)])
def test_leading_part_of_the_horizon(fraction: float, count: int) -> None:
    whole = make_case("oscillator").problem()
    part = whole.until(fraction)
    assert part.data.times.size == count
    np.testing.assert_array_equal(part.data.values, whole.data.values[:count])
    np.testing.assert_array_equal(part.states, whole.states[:count])  # type: ignore[index]
    assert part.targets.pairs.size == count
    assert part.terms == whole.terms


def test_every_kth_spectrum_keeps_its_target() -> None:
    case = make_case("vdp")
    targets = case.problem().targets.rows(np.arange(0, 91, 4))
    part = case.problem(every=4, targets=targets).until(0.5)
    assert part.spectral_index.tolist() == list(range(0, part.data.times.size, 4))
    assert part.targets.pairs.size == part.spectral_index.size
    np.testing.assert_array_equal(part.targets.frequency, targets.frequency[: part.spectral_index.size])


def test_far_states_of_a_failed_solve_stay_out() -> None:
    problem = make_case("oscillator").problem()
    reached = problem.states[:8].copy()  # type: ignore[index]
    reached[5:] *= 1e3
    assert problem.stabilising_rows(reached).tolist() == [0, 1, 2, 3, 4]
    assert problem.stabilising_rows(reached[:1]).tolist() == [0]


def test_fewer_spectra_have_the_same_targets_to_the_last_bit() -> None:
    """They are rows of those at all data times, from one solution of the truth."""
    each, fourth = (build(typed(compose(["system=vdp", f"eigen.every={k}"]))).problem.targets for k in (1, 4))
    assert fourth.frequency.tobytes() == each.frequency[::4].tobytes()
    assert fourth.damping.tobytes() == each.damping[::4].tobytes()
    assert fourth.stiffness.tobytes() == each.stiffness[::4].tobytes()
