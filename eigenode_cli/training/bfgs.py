"""BFGS on a flat parameter vector, one iteration at a call: for noise-free fits it gains digits that Adam leaves.

The line search asks for the weak Wolfe conditions by doubling and halving. It needs no bound on the function's
curvature, so it copes with kinks (terms have some) and with points where there is no value (a solve fails there).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eigenode_cli.arrays import Floats

DECREASE, CURVATURE = 1e-4, 0.9
"""Constants of the Wolfe conditions: the customary ones of quasi-Newton methods (Nocedal & Wright 2006, Sec. 3.1)."""
TRIALS = 30
"""Points that one line search may try."""
FIRST = 0.1
"""Longest first trial of a search along the gradient, whose length says nothing about how far to go."""
NOISE = 1e-12
"""Curvature, as the cosine between step and change of gradient, up to which it is taken for rounding."""


@dataclass(frozen=True)
class Point:
    """A function at some parameters: its value, infinite where it has none, and its gradient `(P,)`."""

    value: float
    gradient: Floats


class QuasiNewton(ABC):
    """Minimisation along the direction of a matrix that stands for the inverse Hessian.

    Line search of A. S. Lewis, M. L. Overton, Nonsmooth optimization via quasi-Newton methods, Math. Program. 141,
    2013, Algorithm 2.6, https://doi.org/10.1007/s10107-012-0514-2. Where a search finds no lower point the curvature is
    forgotten; where it finds none along the gradient either, the parameters stay where they are until `restart`.
    """

    def __init__(self) -> None:
        self._phase = np.zeros(2)  # whether the curvature is known; whether no lower point is to be found

    @property
    def stuck(self) -> bool:
        """Whether no lower point was found along the gradient itself."""
        return bool(self._phase[1])

    def restart(self) -> None:
        """Forget the curvature: another function comes."""
        self._phase[:] = 0.0

    @abstractmethod
    def state(self) -> dict[str, Floats]:
        """Return everything that the next iteration depends on besides the parameters; the arrays themselves."""

    @abstractmethod
    def _scaled(self, gradient: Floats) -> Floats:
        """Return the inverse Hessian times `gradient (P,)`, where it is known."""

    @abstractmethod
    def _learn(self, step: Floats, change: Floats, curvature: float) -> None:
        """Take the curvature `step @ change` seen over a step `(P,)` and its change of the gradient `(P,)`."""

    def step(self, theta: Floats, here: Point, function: Callable[[Floats], Point]) -> None:
        """Take one iteration: change `theta (P,)` in place, to a lower point if there is one.

        Args:
            theta: parameters.
            here: the function there, which must have a value.
            function: value and gradient at other parameters.
        """
        if self.stuck:
            return
        known = bool(self._phase[0])
        direction = -self._scaled(here.gradient) if known else -here.gradient
        length = 1.0 if known else min(1.0, FIRST / max(float(np.linalg.norm(here.gradient)), FIRST))
        found = line_search(theta, direction, length, here, function)
        if found is None:
            self._phase[:] = 0.0, 0.0 if known else 1.0
            return
        there, point = found
        step, change = there - theta, point.gradient - here.gradient
        curvature = float(step @ change)
        if curvature > NOISE * np.linalg.norm(step) * np.linalg.norm(change):  # else it is rounding
            self._learn(step, change, curvature)
            self._phase[0] = 1.0
        theta[:] = there


class Bfgs(QuasiNewton):
    """BFGS with a dense inverse Hessian, P^2 numbers for P parameters.

    J. Nocedal, S. J. Wright, Numerical Optimization, 2006, Algorithm 6.1 and Equ. 6.20 (the first scale).
    https://doi.org/10.1007/978-0-387-40065-5
    """

    def __init__(self, parameters: int) -> None:
        super().__init__()
        self._inverse = np.zeros((parameters, parameters))

    def state(self) -> dict[str, Floats]:
        """See `QuasiNewton.state`."""
        return {"inverse_hessian": self._inverse, "phase": self._phase}

    def _scaled(self, gradient: Floats) -> Floats:
        return self._inverse @ gradient

    def _learn(self, step: Floats, change: Floats, curvature: float) -> None:
        if not self._phase[0]:
            self._inverse[:] = np.eye(step.size) * (curvature / float(change @ change))
        image = self._inverse @ change
        mixed = np.outer(image, step)
        factor = (1.0 + float(change @ image) / curvature) / curvature
        self._inverse += factor * np.outer(step, step) - (mixed + mixed.T) / curvature


class Lbfgs(QuasiNewton):
    """L-BFGS, which remembers the last steps alone: a few times P numbers.

    J. Nocedal, S. J. Wright, Numerical Optimization, 2006, Algorithm 7.4 (the two loops) and Equ. 7.20 (the scale).
    https://doi.org/10.1007/978-0-387-40065-5

    Args:
        parameters: P.
        pairs: how many steps, with their changes of the gradient, are kept.
    """

    def __init__(self, parameters: int, pairs: int) -> None:
        super().__init__()
        self._steps, self._changes = np.zeros((2, pairs, parameters))
        self._kept = np.zeros(1)

    def restart(self) -> None:
        """See `QuasiNewton.restart`."""
        super().restart()
        self._kept[0] = 0.0

    def state(self) -> dict[str, Floats]:
        """See `QuasiNewton.state`."""
        return {"steps": self._steps, "changes": self._changes, "kept": self._kept, "phase": self._phase}

    def _scaled(self, gradient: Floats) -> Floats:
        kept = int(self._kept[0])  # the newest pairs stand last
        steps, changes = self._steps[len(self._steps) - kept :], self._changes[len(self._changes) - kept :]
        inverse = 1.0 / np.einsum("kp,kp->k", steps, changes)
        result, shares = gradient.copy(), np.empty(kept)
        for k in reversed(range(kept)):
            shares[k] = inverse[k] * float(steps[k] @ result)
            result -= shares[k] * changes[k]
        result /= inverse[-1] * float(changes[-1] @ changes[-1])
        for k in range(kept):
            result += (shares[k] - inverse[k] * float(changes[k] @ result)) * steps[k]
        return result

    def _learn(self, step: Floats, change: Floats, curvature: float) -> None:
        del curvature
        if not self._phase[0]:
            self._kept[0] = 0.0
        for kept, new in ((self._steps, step), (self._changes, change)):
            kept[:-1] = kept[1:].copy()
            kept[-1] = new
        self._kept[0] = min(self._kept[0] + 1.0, len(self._steps))


def line_search(
    theta: Floats, direction: Floats, length: float, here: Point, function: Callable[[Floats], Point]
) -> tuple[Floats, Point] | None:
    """Parameters on the ray from `theta (P,)` along `direction (P,)` that meet the weak Wolfe conditions.

    Where `TRIALS` points do not meet both conditions, the last that is low enough counts; None if there is none, or
    if the direction leads uphill.
    """
    slope = float(here.gradient @ direction)
    if not slope < 0.0:
        return None
    low, high, found = 0.0, math.inf, None
    for _ in range(TRIALS):
        there = theta + length * direction
        point = function(there)
        if not point.value <= here.value + DECREASE * length * slope:  # higher, or no value at all
            high = length
        else:
            found = there, point
            if float(point.gradient @ direction) >= CURVATURE * slope:
                break
            low = length
        length = 0.5 * (low + high) if high < math.inf else 2.0 * length
    return found
