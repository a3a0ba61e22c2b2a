"""The scaled terms of one engine as a sum of squares, and Levenberg-Marquardt on it, one step at a call.

SciPy's `least_squares` was tried and does not fit: it cannot stop and go on with the same bytes, and its scaling of
the damping by columns fails on these networks, whose columns differ by orders of magnitude and are nearly dependent.
One damping for all parameters works.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import Engine, ResidualJacobian
from eigenode_cli.engines.problem import Problem
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import TERMS

TRIALS = 12
"""Points that one step may try."""
LARGEST = 1e16
"""Damping from which on no lower point is to be found."""
RIDGE, EVIDENT = 7, 8
"""Where the ridge stands in the memory of an iteration, and whether it follows the evidence by now."""
CONVERGED, STUCK = 1.0, 2.0
"""How an iteration ends."""
LARGEST_CUT = 3.0
"""An accepted step divides the damping by at most so much."""


@dataclass(frozen=True)
class Squares:
    """The sum of squares at some parameters, `|J x + r|^2` for a small change x of them, plus a ridge.

    Attributes:
        value: infinite where the solve fails.
        gradient: half of its gradient, `J^T r` and that of the ridge `(P,)`; zero for parameters that are held.
        residuals: r `(R,)`; jacobian: J `(R, P)`.
        ridge: of each parameter `(P,)`.
        offset: half of the ridge's gradient `(P,)`.
        status: how the solve ended.
        values: of the named terms `(L,)`.
        guard_count: 0: no guard is counted in residuals.
    """

    value: float
    gradient: Floats
    residuals: Floats
    jacobian: Floats
    ridge: Floats
    offset: Floats
    status: Status
    values: Floats
    guard_count: int = 0

    @property
    def curvature(self) -> Floats:
        """Diagonal of the Gauss-Newton matrix `J^T J` with the ridge `(P,)`."""
        return np.einsum("rp,rp->p", self.jacobian, self.jacobian) + self.ridge

    @cached_property
    def _normal(self) -> Floats:
        matrix = self.jacobian.T @ self.jacobian
        matrix[np.diag_indices_from(matrix)] += self.ridge
        return matrix

    def change(self, damping: float) -> Floats | None:
        """Return x that solves `(J^T J + ridge + damping I) x = -gradient`; None where rounding prevents it.

        Where there are fewer residuals than parameters a system of as many unknowns as residuals says the same
        (the matrix inversion lemma): `x = y - D J^T (I + J D J^T)^-1 (r + J y)`, with the inverse D of the diagonal
        and `y = -D offset`.
        """
        rows, size = self.jacobian.shape
        if rows >= size:
            matrix = self._normal + 0.0
            matrix[np.diag_indices_from(matrix)] += damping
            found = _solved(matrix, self.gradient)
            return None if found is None else -found
        inverse = 1.0 / (self.ridge + damping)
        scaled, first = self.jacobian * inverse, -inverse * self.offset
        matrix = scaled @ self.jacobian.T
        matrix[np.diag_indices_from(matrix)] += 1.0
        found = _solved(matrix, self.residuals + self.jacobian @ first)
        return None if found is None else first - scaled.T @ found


@dataclass(frozen=True)
class _Point:
    """Weighted residuals as summed and as linearised `(R,)`, their Jacobian `(R, P)`, and what they come from."""

    theta: Floats
    residuals: Floats
    linear: Floats
    jacobian: Floats
    found: ResidualJacobian


class LeastSquares:
    """Sum over the terms of scale times mean square residual, plus a ridge on the network's parameters.

    Args:
        engine: gives the residual Jacobian.
        scales: factor of each named term `(L,)`.
        trained: which parameters it is a function of `(P,)`, None for all.
        huber: residuals of SOL beyond this size count linearly, by reweighting; infinite for plain squares.
        penalised: which parameters the ridge holds small `(P,)`, None for none.
        evidence: whether the ridge is to follow the evidence.

    Attributes:
        ridge: factor of the sum of the squared parameters `penalised`.
    """

    def __init__(
        self,
        engine: Engine,
        scales: Floats,
        trained: NDArray[np.bool_] | None = None,
        huber: float = math.inf,
        penalised: NDArray[np.bool_] | None = None,
        evidence: bool = False,
    ) -> None:
        self.engine, self.evidence = engine, evidence
        self.ridge = 0.0
        self._scales, self._trained, self._huber = scales, trained, huber
        self._penalised = penalised if trained is None or penalised is None else penalised & trained
        self._last: _Point | None = None

    def at(self, theta: Floats) -> Squares:
        """Return value and derivatives at `theta (P,)`; the residual Jacobian of the last point is remembered."""
        point = self._point(theta)
        ridge = np.zeros(theta.size)
        if self.ridge > 0.0 and self._penalised is not None:
            ridge[self._penalised] = self.ridge
        offset = ridge * theta
        gradient = point.jacobian.T @ point.linear + offset
        value = self._sum(point.found.status, point.residuals, theta)
        if not (np.isfinite(gradient).all() and np.isfinite(point.jacobian).all()):
            value = math.inf
        found = point.found
        return Squares(value, gradient, point.linear, point.jacobian, ridge, offset, found.status, found.values)

    def value(self, theta: Floats) -> float:
        """Return the value alone at `theta (P,)`, infinite where the solve fails."""
        found = self.engine.residual_jacobian(theta, differentiated=False)
        return self._sum(found.status, self._weighted(found)[0], theta)

    def evidence_ridge(self, theta: Floats) -> float:
        """Return the ridge under which noise and parameters explain the residuals of SOL best.

        The evidence of D. J. C. MacKay, Bayesian interpolation, Neural Computation 4, 1992, 415-447, with the
        Gauss-Newton matrix of F. D. Foresee, M. T. Hagan, Gauss-Newton approximation to Bayesian learning, ICNN 1997:
        `gamma E_D / ((N - gamma) E_W)` for N residuals with sum of squares E_D, penalised parameters with sum of
        squares E_W, and the number gamma of parameters that the data determine.
        """
        point = self._point(theta)
        rows = point.found.rows.get("sol")
        if rows is None or self._penalised is None:
            return self.ridge
        jacobian, residuals = point.jacobian[rows], point.residuals[rows]
        part = jacobian[:, self._penalised]
        matrix = part @ part.T if part.shape[0] <= part.shape[1] else part.T @ part
        if not np.isfinite(matrix).all():
            return self.ridge
        curvature = np.maximum(np.linalg.eigvalsh(matrix), 0.0)
        determined = float((curvature / (curvature + self.ridge)).sum()) if self.ridge > 0.0 else float(part.shape[0])
        others = int((~self._penalised).sum() if self._trained is None else (self._trained & ~self._penalised).sum())
        left = max(1.0, residuals.size - others - determined)
        size = max(float(theta[self._penalised] @ theta[self._penalised]), 1e-12)
        return min(determined, residuals.size) * float(residuals @ residuals) / (left * size)

    def _point(self, theta: Floats) -> _Point:
        if self._last is None or not np.array_equal(theta, self._last.theta):
            found = self.engine.residual_jacobian(theta)
            residuals, weights = self._weighted(found)
            jacobian = weights[:, None] * found.jacobian
            if self._trained is not None:
                jacobian[:, ~self._trained] = 0.0
            self._last = _Point(theta.copy(), residuals, weights * found.residuals, jacobian, found)
        return self._last

    def _weighted(self, found: ResidualJacobian) -> tuple[Floats, Floats]:
        """Return residuals whose squares are summed, and the factors `(R,)` that linearise them."""
        weights, residuals = np.empty(found.residuals.size), found.residuals.copy()
        for rows, scale in zip(found.rows.values(), self._scales, strict=True):
            weights[rows] = math.sqrt(scale / max(1, rows.stop - rows.start))
        sol = found.rows.get("sol")
        if sol is not None and math.isfinite(self._huber):
            size = np.abs(residuals[sol])
            far = size > self._huber
            residuals[sol] = np.where(far, np.sqrt(np.maximum(2.0 * self._huber * size - self._huber**2, 0.0)), size)
            residuals *= weights
            weights[sol] *= np.sqrt(self._huber / np.maximum(size, self._huber))
            return residuals, weights
        return residuals * weights, weights

    def _sum(self, status: Status, residuals: Floats, theta: Floats) -> float:
        if status is not Status.OK:
            return math.inf
        with np.errstate(over="ignore"):
            value = float(residuals @ residuals)
        if self.ridge > 0.0 and self._penalised is not None:
            value += self.ridge * float(theta[self._penalised] @ theta[self._penalised])
        return value if math.isfinite(value) else math.inf


class Iteration:
    """Levenberg-Marquardt with one damping for all parameters.

    D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11, 1963, 431-441,
    https://doi.org/10.1137/0111030; the damping follows the gain ratio as in H. B. Nielsen, Damping parameter in
    Marquardt's method, IMM-REP-1999-05, Technical University of Denmark, 1999. It is in units of the mean of the
    diagonal of `J^T J`.

    Args:
        damping: the first one of each stage.
        ridge: the first one.
        tolerance: it has converged where a step lowers the sum by less than this share, or is expected to.

    Attributes:
        memory: all that the next step depends on besides the parameters: damping, its growth, how it has ended
            (0 not yet), steps accepted and rejected so far, last gain ratio, norm of the gradient, ridge, whether the
            ridge follows the evidence by now `(9,)`.
    """

    def __init__(self, damping: float, tolerance: float, ridge: float = 0.0) -> None:
        self._first, self._tolerance = damping, tolerance
        self.memory = np.zeros(9)
        self.memory[RIDGE] = ridge
        self.restart()

    def restart(self) -> None:
        """Forget the damping: another function comes."""
        self.memory[:3] = self._first, 2.0, 0.0

    @property
    def ridge(self) -> float:
        """The ridge of the next step."""
        return float(self.memory[RIDGE])

    @property
    def ended(self) -> bool:
        """Whether it changes nothing any more until it is restarted."""
        return bool(self.memory[2] > 0.0)

    @property
    def converged(self) -> bool:
        """Whether the last step met the tolerance."""
        return bool(self.memory[2] == CONVERGED)

    @property
    def records(self) -> dict[str, float]:
        """What is recorded of it, by column."""
        return {"damping": self.memory[0], "gain_ratio": self.memory[5], "gradient_norm": self.memory[6]}

    def step(self, theta: Floats, here: Squares, value: Callable[[Floats], float]) -> None:
        """Change `theta (P,)` in place to a lower point if there is one.

        Args:
            theta: parameters.
            here: the sum of squares there, which must have a value.
            value: the sum at other parameters.
        """
        memory, size = self.memory, float(np.linalg.norm(here.gradient))
        memory[6] = size
        mean = float(here.curvature.mean())
        if self.ended:
            return
        if size == 0.0 or mean == 0.0:
            memory[2] = CONVERGED
            return
        for _ in range(TRIALS):
            damping = memory[0] * mean
            change = here.change(damping)
            expected = 0.0 if change is None else float(damping * (change @ change) - here.gradient @ change)
            reached = math.inf if change is None else value(theta + change)
            if change is not None and reached < here.value and expected > 0.0:
                self._accept(theta, change, here.value, reached, expected)
                return
            memory[4] += 1.0
            if change is not None and expected <= self._tolerance * here.value:
                memory[2] = CONVERGED
                return
            memory[0] *= memory[1]
            memory[1] *= 2.0
            if memory[0] > LARGEST:
                memory[2] = STUCK
                return

    def _accept(self, theta: Floats, change: Floats, before: float, reached: float, expected: float) -> None:
        memory, ratio = self.memory, (before - reached) / expected
        theta += change
        memory[0] = max(memory[0] * max(1.0 / LARGEST_CUT, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-15)
        memory[1] = 2.0
        memory[3] += 1.0
        memory[5] = ratio
        if before - reached <= self._tolerance * before:
            memory[2] = CONVERGED


def term_units(problem: Problem) -> dict[str, float]:
    """Return the square of each term's natural unit by name: what its scale is relative to in least squares.

    SOL is measured by the mean square of the data, FRQ by that of the targets' frequencies, STB and OSC by that of
    their angular frequencies, STF by that of the corridor's upper end, and DMP, a ratio, by 1. A unit that nothing
    tells is 1.
    """
    every = problem.trajectories
    values = np.concatenate([one.data.channels[one.data.channel_mask] for one in every])
    frequency = np.concatenate([one.targets.frequency[np.isfinite(one.targets.frequency)] for one in every])
    corridors = np.concatenate([one.targets.stiffness[:, 1] for one in every])
    ratio = corridors[np.isfinite(corridors)]
    hertz = _mean_square(frequency)
    angular = (2.0 * math.pi) ** 2 * hertz if frequency.size else 1.0
    units = {"data": _mean_square(values), "frequency": hertz, "angular": angular, "ratio": _mean_square(ratio)}
    return {name: units.get(term.unit or "", 1.0) for name, term in TERMS.items()}


def relative_scales(scales: Mapping[str, float], problem: Problem) -> dict[str, float]:
    """Return the scales of terms by name, each divided by its term's unit."""
    units = term_units(problem)
    return {name: scale / units.get(name, 1.0) for name, scale in scales.items()}


def _mean_square(values: Floats) -> float:
    size = float(np.mean(values**2)) if values.size else 0.0
    return size if size > 0.0 else 1.0


def _solved(matrix: Floats, right: Floats) -> Floats | None:
    """Solve `matrix x = right` of a positive definite matrix; None where rounding leaves it indefinite."""
    try:
        factor = cho_factor(matrix, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    return cho_solve(factor, right, check_finite=False)
