"""Verdicts are what the numbers say, also with failures, infinities and ratios; and when two tables agree."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eigenode_cli.reproduce import verdicts
from eigenode_cli.reproduce.schema import ClaimSpec
from eigenode_cli.reproduce.verdicts import (
    FAILS,
    HOLDS,
    MIXED,
    UNDEFINED,
    Verdict,
    differences,
    expected,
    judge,
    probability,
    quantile,
)

INF, NAN = float("inf"), float("nan")


def claim(**changes: Any) -> ClaimSpec:
    options: dict[str, Any] = {
        "name": "small",
        "claim": "It is small.",
        "place": "Sec. 1",
        "run": "a",
        "measure": "sol",
        "at_most": 1.0,
        "statistic": "share",
        "step": None,
        "window": None,
        "tolerance": None,
        "share": None,
    }
    return ClaimSpec(**(options | changes))


@pytest.fixture
def verdict_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The verdict on a claim when its runs give these numbers."""
    monkeypatch.setitem(verdicts.MEASURES, "sol", lambda result, spec: result.value)

    def judged(spec: ClaimSpec, **values: list[float]) -> Verdict:
        results = {
            name: [SimpleNamespace(finished=value is not None, value=value) for value in listed]
            for name, listed in values.items()
        }
        return judge("experiment", spec, results)  # type: ignore[arg-type]

    return judged


@pytest.mark.parametrize(
    ("kept", "of", "verdict"),
    [(1, 1, HOLDS), (0, 1, FAILS), (8, 10, HOLDS), (7, 10, MIXED), (3, 10, MIXED), (2, 10, FAILS), (1, 2, MIXED)],
)
def test_share_of_seeds(kept: int, of: int, verdict: str, verdict_of: Any) -> None:
    found = verdict_of(claim(), a=[0.5] * kept + [2.0] * (of - kept))
    assert (found.kept, found.seeds, found.failures, found.verdict) == (kept, of, 0, verdict)


@pytest.mark.parametrize(("kept", "verdict"), [(20, HOLDS), (19, HOLDS), (18, MIXED), (2, MIXED), (1, FAILS)])
def test_a_claim_may_ask_for_another_share(kept: int, verdict: str, verdict_of: Any) -> None:
    assert verdict_of(claim(share=0.95), a=[0.5] * kept + [2.0] * (20 - kept)).verdict == verdict


def test_bounds_belong_to_the_range(verdict_of: Any) -> None:
    assert verdict_of(claim(at_least=1.0), a=[1.0, 1.0]).kept == 2
    assert verdict_of(claim(at_least=0.5), a=[0.4, 0.5, 1.0, 1.1]).kept == 2
    assert verdict_of(claim(at_least=0.5, at_most=None), a=[0.4, INF]).kept == 1


def test_the_median_alone_decides_where_it_is_asked(verdict_of: Any) -> None:
    spec = claim(statistic="median")
    assert verdict_of(spec, a=[0.1, 0.9, 5.0]).verdict == HOLDS
    assert verdict_of(spec, a=[0.1, 1.1, 5.0]).verdict == FAILS


def test_failures_do_not_keep_bounds_and_are_counted(verdict_of: Any) -> None:
    found = verdict_of(claim(), a=[0.5, NAN, None, 0.7])
    assert (found.kept, found.seeds, found.failures, found.verdict) == (2, 4, 2, MIXED)
    assert found.median == pytest.approx(0.6)
    assert found.values == (0.5, None, None, 0.7)
    nothing = verdict_of(claim(), a=[None, NAN])
    assert (nothing.verdict, nothing.median, nothing.failures) == (UNDEFINED, None, 2)


def test_ratios_are_paired_by_seed(verdict_of: Any) -> None:
    found = verdict_of(claim(against="b"), a=[1.0, 4.0, 1.0, 1.0], b=[2.0, 2.0, 0.0, None])
    assert found.values == (0.5, 2.0, None, None)
    assert (found.kept, found.failures) == (1, 2)


def test_quantiles() -> None:
    values = np.array([3.0, 1.0, 2.0, 10.0, 7.0, 4.0])
    for q in (0.0, 0.25, 0.5, 0.75, 1.0):
        assert quantile(values, q) == pytest.approx(np.quantile(values, q), rel=1e-15)
    assert quantile(np.array([1.0, INF, INF]), 0.5) == INF
    assert quantile(np.array([1.0, INF]), 0.5) == INF
    assert quantile(np.array([1.0, 2.0, INF]), 0.25) == 1.5
    assert quantile(np.array([INF, INF]), 0.25) == INF


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "sol of a ≤ 1"),
        ({"at_most": None, "at_least": 2}, "sol of a ≥ 2"),
        ({"at_least": 1}, "sol of a = 1"),
        ({"at_least": 0.5, "against": "b"}, "sol of a / b from 0.5 to 1"),
        ({"step": 25, "statistic": "median"}, "median of sol at step 25 of a ≤ 1"),
        ({"share": 0.95}, "sol of a ≤ 1 in 95% of the seeds"),
        ({"measure": "rebound", "window": [1, 9]}, "rebound in steps 1 to 9 of a ≤ 1"),
        ({"measure": "stable_from", "tolerance": 0.05}, "stable from (within 0.05 1/s) of a ≤ 1"),
    ],
)
def test_what_is_expected_in_words(changes: dict[str, Any], text: str) -> None:
    assert expected(claim(**changes)) == text


def test_probability_of_a_count() -> None:
    assert probability(0, 1, 10, 10) == pytest.approx(0.5 / 11.0)
    assert probability(0, 3, 10, 10) == pytest.approx(0.5 * 1.5 * 2.5 / (11.0 * 12.0 * 13.0))
    assert probability(3, 3, 0, 10) == pytest.approx(probability(0, 3, 10, 10))
    assert probability(2, 2, 5, 10) == pytest.approx(probability(0, 2, 5, 10))


def test_only_a_verdict_beyond_the_committed_spread_is_a_difference(verdict_of: Any) -> None:
    committed = [verdict_of(claim(), a=[0.5] * 10).as_json()]
    assert committed[0]["verdict"] == HOLDS
    for unlikely in ([0.5, 2.0], [0.5, 2.0, 2.0], [2.0, 2.0]):
        assert differences([verdict_of(claim(), a=unlikely)], committed) == []
    beyond = verdict_of(claim(), a=[2.0] * 3)
    assert differences([beyond], committed) == [
        "experiment/small: fails (0 of 3 seeds), committed is holds (10 of 10); the chance of this is 0.0011"
    ]
    assert differences([replace(beyond, timed=True)], committed) == []
    assert differences([replace(beyond, verdict=HOLDS)], committed) == []
    assert differences([replace(beyond, claim="other")], committed) == ["experiment/other: not in the committed table"]
    assert "0 of 5" in differences([verdict_of(claim(), a=[NAN] * 5)], committed)[0]


def test_never_is_text_in_json(verdict_of: Any) -> None:
    row = verdict_of(claim(), a=[1.0, INF]).as_json()
    assert (row["high"], row["values"]) == ("inf", [1.0, "inf"])
