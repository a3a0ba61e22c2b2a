"""The numbers behind each figure."""

import dataclasses
import warnings

import numpy as np
import pytest

from eigenode_cli.data.dataset import Series
from eigenode_cli.reporting.figures.convergence import convergence_numbers, tenth_of_average
from eigenode_cli.reporting.figures.eigenvalues import eigenvalue_numbers
from eigenode_cli.reporting.figures.phase import phase_numbers
from eigenode_cli.reporting.figures.solution import REACH, error_limit, reach, solution_numbers
from eigenode_cli.reporting.figures.stability import stability_numbers
from eigenode_cli.runs.reader import Run


def test_convergence_shows_sol_and_the_named_terms(runs: dict[str, Run]) -> None:
    run = runs["oscillator"]
    numbers = convergence_numbers(run)
    assert list(numbers.terms) == ["sol", "frq", "dmp", "osc"]
    assert numbers.failed.tolist() == [25.0, 50.0, 100.0]
    assert numbers.final["osc"] == 0.0
    assert np.isnan(numbers.terms["osc"][-1])  # a logarithmic axis has no zero
    known = np.isfinite(numbers.terms["sol"])
    np.testing.assert_array_equal(numbers.terms["sol"][known], run.metrics.terms["sol"][known])
    assert known.sum() == 201 - 3


def test_convergence_finds_the_local_minimum(runs: dict[str, Run]) -> None:
    (minimum,) = convergence_numbers(runs["oscillator"]).minima
    assert minimum.level == pytest.approx(0.578, rel=0.01)
    assert 200.0 < minimum.start < 600.0
    assert 1700.0 < minimum.stop < 2000.0


def test_sol_is_shown_even_if_it_does_not_train(runs: dict[str, Run]) -> None:
    run = dataclasses.replace(runs["oscillator"], grads=("frq", "stb"))
    assert list(convergence_numbers(run).terms) == ["sol", "frq", "stb"]


@pytest.mark.parametrize(
    ("error", "expected"), [("mae", 0.1), ("mse", 0.5 * (0.1**2 + 0.1**2)), ("huber", 0.05 * (0.1 - 0.025))]
)
def test_tenth_of_average(error: str, expected: float) -> None:
    states = np.array([[1.0, np.nan], [-1.0, np.nan], [1.0, np.nan], [-1.0, np.nan]])
    data = Series(times=np.arange(4.0), values=states, initial_state=np.full(2, np.nan))
    assert tenth_of_average(data, error, 0.05) == pytest.approx(expected, rel=1e-14)


def test_stability_scale(runs: dict[str, Run]) -> None:
    wild = stability_numbers(runs["oscillator"])  # from 60 to -0.02 1/s
    calm = stability_numbers(runs["van_der_pol"])  # from 10 to 1.9 1/s
    assert wild.scale.threshold == pytest.approx(0.01)
    assert calm.scale.linear
    assert wild.max_real[-1] == wild.final < 0.0


def test_solution_of_one_observed_state_has_the_error_below(runs: dict[str, Run]) -> None:
    run = runs["oscillator"]
    numbers = solution_numbers(run)
    assert [panel.state.name for panel in numbers.panels] == ["s"]
    assert numbers.horizon == 10.0
    assert numbers.panels[0].data.size == 101
    assert numbers.error is not None
    np.testing.assert_array_equal(numbers.error, run.solution.model[:, 0] - run.solution.truth[:, 0])
    assert numbers.error_limit == np.abs(numbers.error).max()


def test_solution_shows_every_observed_state(runs: dict[str, Run]) -> None:
    numbers = solution_numbers(runs["two_mass"])
    assert [panel.state.name for panel in numbers.panels] == ["s1", "s2"]
    assert [panel.data.size for panel in numbers.panels] == [51, 25]
    assert numbers.error is None


def test_solution_without_a_model_has_no_error(runs: dict[str, Run]) -> None:
    assert solution_numbers(runs["unsolvable"]).error is None


def test_a_diverging_model_leaves_the_truth_readable() -> None:
    truth = np.array([-1.0, 1.0])
    assert reach(truth, np.array([0.5, 1e9])) == (-1.0, 1.0 + 2.0 * REACH)
    assert reach(truth, np.array([-1.5, np.nan])) == (-1.5, 1.0)
    assert reach(np.array([np.nan]), np.array([3.0, 4.0])) == (3.0, 4.0)
    assert error_limit(truth, np.array([0.1, -0.3, np.nan])) == 0.3
    assert error_limit(truth, np.array([1e9])) == 2.0


def test_a_constant_target_is_one_target(runs: dict[str, Run]) -> None:
    numbers = eigenvalue_numbers(runs["oscillator"])
    assert numbers.values.size == 202
    assert sorted(numbers.targets.tolist(), key=lambda z: z.imag) == [-0.025 - 5.0j, -0.025 + 5.0j]
    assert numbers.fixed.all()
    assert not numbers.equal


def test_moving_targets_are_all_kept(runs: dict[str, Run]) -> None:
    numbers = eigenvalue_numbers(runs["van_der_pol"])
    assert numbers.targets.size == numbers.values.size == runs["van_der_pol"].eigenvalues.values.size
    assert not numbers.fixed.any()
    assert np.all(np.diff(numbers.times) >= 0.0)
    assert numbers.equal


def test_widely_spread_eigenvalues_are_symlog(runs: dict[str, Run]) -> None:
    numbers = eigenvalue_numbers(runs["two_mass"])
    assert numbers.real.threshold == pytest.approx(0.1)
    assert numbers.imaginary.linear
    assert numbers.targets.tolist() == [-0.1 + 3.0j, -0.1 - 3.0j]


def test_phase_splits_at_the_horizon(runs: dict[str, Run]) -> None:
    run = runs["oscillator"]
    numbers = phase_numbers(run)
    np.testing.assert_array_equal(numbers.model, run.solution.model[:1001, :2])
    np.testing.assert_array_equal(numbers.beyond[0], numbers.model[-1])
    assert numbers.start.tolist() == run.solution.truth[0].tolist()
    assert [state.name for state in numbers.states] == ["s", "v"]


def test_numbers_of_every_kind_of_run_warn_of_nothing(run: Run) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for numbers_of in (
            convergence_numbers,
            stability_numbers,
            solution_numbers,
            eigenvalue_numbers,
            phase_numbers,
        ):
            numbers_of(run)
    assert [str(warning.message) for warning in caught] == []
