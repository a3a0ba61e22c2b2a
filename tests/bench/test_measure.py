import json

import numpy as np
import pytest

from eigenode_cli.bench import measure
from eigenode_cli.bench.measure import compare, describe_machine, ratio_of


def test_a_ratio_is_taken_pair_by_pair() -> None:
    # a machine that becomes ten times slower half way changes no ratio
    below = np.array([1.0, 1.0, 10.0, 10.0])
    ratio = ratio_of(3.0 * below, below)
    assert (ratio.median, ratio.low, ratio.high, ratio.least, ratio.pairs) == (3.0, 3.0, 3.0, 3.0, 4)


def test_quartiles_of_the_ratios() -> None:
    ratio = ratio_of(np.arange(1.0, 6.0), np.ones(5))
    assert (ratio.least, ratio.low, ratio.median, ratio.high) == (1.0, 2.0, 3.0, 4.0)
    assert (ratio.numerator_seconds, ratio.denominator_seconds) == (3.0, 1.0)


def test_samples_alternate_after_a_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "SAMPLE_SECONDS", 0.0)
    monkeypatch.setattr(measure, "PAIRS", 6)
    calls: list[str] = []
    ratio = compare(lambda: calls.append("A"), lambda: calls.append("B"), patience=60.0)
    assert ratio.pairs == 6
    assert "".join(calls) == "AA" + "BB" + 6 * "AB"


def test_the_fewest_pairs_are_taken_without_patience() -> None:
    assert compare(lambda: None, lambda: None, patience=0.0).pairs == measure.FEWEST


def test_the_machine_is_described_without_its_name() -> None:
    machine = describe_machine({"torch": "2"})
    assert set(machine) == {"cores", "architecture", "system", "python", "versions", "load"}
    json.dumps(machine, allow_nan=False)
