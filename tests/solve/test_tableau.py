"""Tableaus: order conditions in exact rational arithmetic, so that only the coefficients themselves are judged."""

from fractions import Fraction

import numpy as np
import pytest

from eigenode_cli.solve.tableau import DOPRI5, RK4, TABLEAUS, TSIT5, Tableau

ALL = list(TABLEAUS.values())
FIFTH = [TSIT5, DOPRI5]


def exact(array: np.ndarray) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(array)


def conditions_to_order_4(tableau: Tableau, weights: np.ndarray, theta: Fraction) -> dict[str, float]:
    """Residuals of the eight order conditions up to order 4 for weights that advance by theta steps."""
    a, one = exact(tableau.a), Fraction(1)
    c = a.sum(axis=1)
    residuals = {
        "b = 1": weights.sum() - theta,
        "b c = 1/2": weights @ c - theta**2 / 2,
        "b c2 = 1/3": weights @ c**2 - theta**3 / 3,
        "b A c = 1/6": weights @ (a @ c) - theta**3 / 6,
        "b c3 = 1/4": weights @ c**3 - theta**4 / 4,
        "b c A c = 1/8": (weights * c) @ (a @ c) - theta**4 / 8,
        "b A c2 = 1/12": weights @ (a @ c**2) - theta**4 / 12,
        "b A A c = 1/24": weights @ (a @ (a @ c)) - theta**4 / 24,
    }
    assert one == c[-1] or abs(float(c[-1]) - 1.0) < 1e-14
    return {name: float(value) for name, value in residuals.items()}


def conditions_of_order_5(tableau: Tableau) -> dict[str, float]:
    a, b = exact(tableau.a), exact(tableau.b)
    c = a.sum(axis=1)
    residuals = {
        "b c4": b @ c**4 - Fraction(1, 5),
        "b c2 A c": (b * c**2) @ (a @ c) - Fraction(1, 10),
        "b (A c)2": b @ (a @ c) ** 2 - Fraction(1, 20),
        "b c A c2": (b * c) @ (a @ c**2) - Fraction(1, 15),
        "b A c3": b @ (a @ c**3) - Fraction(1, 20),
        "b c A A c": (b * c) @ (a @ (a @ c)) - Fraction(1, 30),
        "b A c A c": b @ (a @ (c * (a @ c))) - Fraction(1, 40),
        "b A A c2": b @ (a @ (a @ c**2)) - Fraction(1, 60),
        "b A A A c": b @ (a @ (a @ (a @ c))) - Fraction(1, 120),
    }
    return {name: float(value) for name, value in residuals.items()}


@pytest.mark.parametrize("tableau", ALL, ids=lambda t: t.name)
def test_explicit_and_first_same_as_last(tableau: Tableau) -> None:
    assert np.array_equal(tableau.a, np.tril(tableau.a, -1))
    assert tableau.b[-1] == 0.0
    assert tableau.c[-1] == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("tableau", ALL, ids=lambda t: t.name)
def test_order_conditions_to_4(tableau: Tableau) -> None:
    """As many of them hold as the order says: 2, 4 or all 8."""
    residuals = conditions_to_order_4(tableau, exact(tableau.b), Fraction(1))
    sizes, count = [abs(residual) for residual in residuals.values()], {2: 2, 3: 4}.get(tableau.order, 8)
    assert max(sizes[:count]) < 1e-14, residuals
    assert all(size > 1e-3 for size in sizes[count : count + 1]), residuals


@pytest.mark.parametrize("tableau", FIFTH, ids=lambda t: t.name)
def test_order_conditions_of_5(tableau: Tableau) -> None:
    residuals = conditions_of_order_5(tableau)
    assert max(map(abs, residuals.values())) < 1e-14, residuals


def test_rk4_is_not_of_order_5() -> None:
    assert max(map(abs, conditions_of_order_5(RK4).values())) > 1e-3


@pytest.mark.parametrize("tableau", FIFTH, ids=lambda t: t.name)
def test_error_estimate_is_that_of_order_4(tableau: Tableau) -> None:
    """b - error is a method of order 4 and not of order 5, so the estimate sees the fifth-order term."""
    a, embedded = exact(tableau.a), exact(tableau.b) - exact(tableau.error)
    residuals = conditions_to_order_4(tableau, embedded, Fraction(1))
    assert max(map(abs, residuals.values())) < 1e-14, residuals
    assert abs(float(embedded @ a.sum(axis=1) ** 4) - 0.2) > 1e-4


@pytest.mark.parametrize("theta", [Fraction(k, 8) for k in range(1, 9)], ids=str)
def test_tsit5_interpolant_is_of_order_4_everywhere(theta: Fraction) -> None:
    weights = exact(TSIT5.dense) @ np.array([theta, theta**2, theta**3, theta**4], dtype=object)
    residuals = conditions_to_order_4(TSIT5, weights, theta)
    assert max(map(abs, residuals.values())) < 1e-14, residuals


@pytest.mark.parametrize("tableau", ALL, ids=lambda t: t.name)
def test_dense_output_meets_both_ends(tableau: Tableau) -> None:
    """Value and derivative at both ends of a step are those of the solution: the curve is smooth across steps."""
    first, last = np.eye(tableau.b.size)[0], np.eye(tableau.b.size)[-1]
    np.testing.assert_allclose(tableau.dense.sum(axis=1), tableau.b, atol=1e-14)
    np.testing.assert_allclose(tableau.dense[:, 0], first, atol=1e-14)
    np.testing.assert_allclose(tableau.dense @ np.arange(1.0, 5.0), last, atol=2e-12)
