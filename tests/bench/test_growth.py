import json

import numpy as np
import pytest

from eigenode_cli.bench import measure
from eigenode_cli.bench.case import oscillating
from eigenode_cli.bench.contestants import PEERS
from eigenode_cli.bench.growth import Curve, curves, fit_power, measure_curve


def test_a_power_law_is_found_exactly() -> None:
    x = np.array([2.0, 7.0, 30.0, 100.0])
    law = fit_power(x, 0.3 * x**1.7)
    assert (law.a, law.b) == (pytest.approx(0.3, rel=1e-12), pytest.approx(1.7, rel=1e-12))


def test_the_exponent_does_not_depend_on_units() -> None:
    x, y = np.array([1.0, 2.0, 5.0]), np.array([3.0, 4.0, 9.0])
    assert fit_power(10.0 * x, 1e-6 * y).b == pytest.approx(fit_power(x, y).b, rel=1e-12)


def test_one_abscissa_has_no_exponent() -> None:
    with pytest.raises(ValueError, match="two different"):
        fit_power(np.array([3.0, 3.0]), np.array([1.0, 2.0]))


def test_curves_cover_terms_and_spectra_and_differ_in_one_quantity() -> None:
    found = list(curves())
    assert [curve.quantity for curve in found] == 4 * ["states"] + ["width", "depth", "horizon"]
    assert len({curve.name for curve in found}) == len(found)
    for curve in found[4:]:
        first, second = (curve.make(value) for value in curve.values[:2])
        changed = (first.shape.sizes != second.shape.sizes) + (first.times[-1] != second.times[-1])
        assert changed == 1


def test_a_curve_of_small_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "SAMPLE_SECONDS", 0.0)
    monkeypatch.setattr(measure, "PAIRS", measure.FEWEST)
    said: list[str] = []
    curve = Curve("tiny", "states", (2, 4), lambda n: oscillating(n, [4], 0.5, 3, ("sol", "frq")), checked=True)
    found = measure_curve(curve, [PEERS["torchdiffeq"]], said.append)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["values"] == [2, 4]
    assert found["disagree"] == {}
    assert set(found["exponents"]) == set(found["seconds"]) == {"compiled", "torchdiffeq"}
    assert len(found["ratios"]["torchdiffeq"]) == len(said) == 2
