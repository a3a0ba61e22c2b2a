"""Units and what they are in the SI."""

import pytest

from eigenode_cli.export.units import rate_unit, unit_of


@pytest.mark.parametrize(
    ("name", "powers", "factor"),
    [
        ("m", {"m": 1}, 1.0),
        ("mm/s", {"m": 1, "s": -1}, 1e-3),
        ("m/s^2", {"m": 1, "s": -2}, 1.0),
        ("m/s2", {"m": 1, "s": -2}, 1.0),
        ("1/s", {"s": -1}, 1.0),
        ("kN m", {"kg": 1, "m": 2, "s": -2}, 1e3),
        ("kg*m^2", {"kg": 1, "m": 2}, 1.0),
        ("g", {"kg": 1}, 1e-3),
        ("rad/s", {"s": -1, "rad": 1}, 1.0),
        ("cm2", {"m": 2}, 1e-4),
        ("V/A", {"kg": 1, "m": 2, "s": -3, "A": -2}, 1.0),
    ],
)
def test_known_units(name: str, powers: dict[str, int], factor: float) -> None:
    found = unit_of(name)
    assert found.known
    assert found.powers == powers
    assert found.factor == pytest.approx(factor)


@pytest.mark.parametrize("name", ["furlong", "\u00b0C", "%", "a.u.", "m/s/s", "(m)/s", "m^0.5", "kkg", ""])
def test_unknown_units(name: str) -> None:
    assert not unit_of(name).known
    assert unit_of(name).name == name


@pytest.mark.parametrize(
    ("name", "rate"),
    [
        *(("", "1/s"), ("m", "m/s"), ("m/s", "m/s2"), ("m/s^2", "m/s^3"), ("1/s", "1/s2"), ("kg/m", "(kg/m)/s")),
        ("N m", "N m/s"),
    ],
)
def test_units_of_rates(name: str, rate: str) -> None:
    assert rate_unit(name) == rate
