"""Stability functions of explicit methods: by what a step multiplies a mode."""

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.solve.tableau import TABLEAUS

_SHORT = {
    "euler": (1.0, 1.0),
    "midpoint": (1.0, 1.0, 1.0 / 2.0),
    "heun3": (1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0),
}
METHODS = (*_SHORT, *TABLEAUS)
"""Methods whose stability function is known here."""


def stability_polynomial(name: str) -> NDArray[np.float64]:
    """Return the coefficients `(s + 1,)` of the stability function `R(z) = sum_k c_k z^k` of a method, as in `solver=`.

    Of a method with the coefficients A and the weights b they are `c_k = b^T A^(k-1) 1`: E. Hairer, G. Wanner, Solving
    Ordinary Differential Equations II, 2nd ed., Sec. IV.2.

    Raises:
        ValueError: the method is not one of `METHODS`.
    """
    if name in _SHORT:
        return np.array(_SHORT[name])
    if name not in TABLEAUS:
        raise ValueError(f"{name}: choose from {', '.join(METHODS)}")
    tableau = TABLEAUS[name]
    coefficients, power = [1.0], np.ones(tableau.b.size)
    for _ in range(tableau.b.size):
        coefficients.append(float(tableau.b @ power))
        power = tableau.a @ power
    found = np.array(coefficients)
    return found[: int(np.flatnonzero(np.abs(found) > 1e-14)[-1]) + 1]


def region_of(name: str, step: float) -> NDArray[np.float64]:
    """Return what the term `stp` compares a spectrum with: the step in s, and the coefficients `(s + 2,)`."""
    return np.concatenate([[step], stability_polynomial(name)])
