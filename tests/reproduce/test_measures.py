"""Every measure on records whose answer is known."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eigenode_cli.reproduce.measures import MEASURES, Result
from eigenode_cli.reproduce.post_training import measure_tight
from eigenode_cli.reproduce.study import Study
from eigenode_cli.runs.reader import RecordError
from tests.reproduce.test_verdicts import INF, claim

STEPS = np.arange(0.0, 101.0, 25.0)


def result(sol: list[float], max_real: list[float]) -> Any:
    """A result with these five records."""
    metrics = SimpleNamespace(
        step=STEPS,
        terms={"sol": np.array(sol)},
        max_real=np.array(max_real),
        dense_error=2.0 * np.array(sol),
    )
    return SimpleNamespace(metrics=metrics, average=0.5, amplitude=4.0, run=SimpleNamespace(parameters=129))


RECORDS = result([4.0, 1.0, 2.0, np.nan, 0.5], [3.0, 0.04, 0.2, np.nan, -1.0])


@pytest.mark.parametrize(
    ("measure", "options", "value"),
    [
        ("sol", {}, 0.5),
        ("sol", {"step": 25}, 1.0),
        ("sol", {"step": 75}, np.nan),
        ("sol", {"step": 26}, np.nan),
        ("dense_error", {"step": 50}, 4.0),
        ("relative_error", {}, 0.25),
        ("sol_to_average", {}, 1.0),
        ("max_real", {}, -1.0),
        ("mean_sol", {}, 1.875),
        ("stable_first", {"tolerance": 0.05}, 25.0),
        ("stable_first", {"tolerance": 0.0}, 100.0),
        ("stable_from", {"tolerance": 0.05}, 100.0),
        ("stable_from", {"tolerance": 5.0}, 100.0),
        ("rebound", {"window": [50, 75]}, 2.0),
        ("rebound", {"window": [0, 50]}, np.nan),
        ("parameters", {}, 129.0),
    ],
)
def test_measure(measure: str, options: dict[str, Any], value: float) -> None:
    found = MEASURES[measure](RECORDS, claim(measure=measure, **options))
    assert found == pytest.approx(value, nan_ok=True)


def test_never_stable_is_never() -> None:
    unstable = result([1.0] * 5, [-1.0, -1.0, -1.0, -1.0, 0.1])
    spec = claim(measure="stable_from", tolerance=0.0)
    assert MEASURES["stable_from"](unstable, spec) == INF
    assert MEASURES["stable_first"](unstable, spec) == 0.0
    assert MEASURES["stable_from"](result([1.0] * 5, [-1.0] * 5), spec) == 0.0
    assert MEASURES["stable_first"](result([1.0] * 5, [1.0] * 5), spec) == INF
    assert np.isnan(MEASURES["mean_sol"](result([np.nan] * 5, [1.0] * 5), claim()))


def test_average_and_amplitude_are_those_of_the_data(study: Study) -> None:
    one = study.results["small"]["sol"][0]
    states = one.run.data.values[:, 0]
    assert one.average == pytest.approx(np.mean(np.abs(states - np.median(states))), rel=1e-12)
    assert one.amplitude == pytest.approx(1.0, abs=1e-9)


def test_what_was_not_measured_is_named(study: Study, tmp_path: Path) -> None:
    one = study.results["small"]["sol"][0]
    with pytest.raises(RecordError, match=r"^gradient_cost\.json is missing"):
        one.extra("gradient_cost.json")
    assert MEASURES["test_sol"](one, claim()) > 0.0
    assert not Result(study.units["small"]["sol"][0]).unit.folder.samefile(tmp_path)


def test_twice_error_is_the_mean_over_both_horizons() -> None:
    truth, model = np.array([[1.0, 9.0], [3.0, 9.0], [-4.0, 9.0]]), np.array([[1.0, 0.0], [2.0, 0.0], [-2.0, 0.0]])
    one = SimpleNamespace(solution=SimpleNamespace(truth=truth, model=model), amplitude=4.0)
    assert MEASURES["twice_error"](one, claim()) == pytest.approx(0.25)


def test_tight_error_is_that_of_the_field_without_its_solver(study: Study) -> None:
    unit = study.units["small"]["sol"][0]
    measure_tight(unit)
    one = Result(unit)
    loose, tight = MEASURES["relative_error"](one, claim()), MEASURES["tight_error"](one, claim())
    assert tight == pytest.approx(loose, rel=1e-2)
    assert tight != loose
