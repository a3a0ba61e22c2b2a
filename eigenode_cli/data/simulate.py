"""The truth: a system with its initial state, solved tightly, and measurements sampled from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.systems.base import System

TOLERANCE = 1e-10
"""Relative and absolute tolerance of the reference solution."""
LOOK, STAGES, BOUND = 100_000, 12, 2.0
"""After so many evaluations, 12 a step, the reference is looked at: it is stiff where a mean step times the largest
eigenvalue is beyond the bound. Accuracy alone keeps it below 1; the region of stability ends at about 6."""


@dataclass(frozen=True)
class Truth:
    """A ground truth: reference curves, dense errors and, where asked for, targets come from it; training sees none.

    Attributes:
        system: dynamics and Jacobian.
        initial_state: state at time 0, one value a state.
    """

    system: System
    initial_state: tuple[float, ...]

    def states(self, times: Floats) -> Floats:
        """Return the states `(D, n)` at `times (D,)` in s, ascending from 0, by SciPy's DOP853 at 1e-10, or Radau.

        Raises:
            ValueError: the system itself cannot be solved over these times.
        """
        return np.ascontiguousarray(_solved(self.system, self.initial_state, float(times[-1]))(times).T)


class _StabilityBound(Exception):
    """Stability, not accuracy, limits the steps of the explicit method."""


@lru_cache(maxsize=16)
def _solved(system: System, initial_state: tuple[float, ...], end: float) -> OdeSolution:
    """Return the solution from 0 to `end`; a run asks for it at several grids, many seeds in one process again.

    By DOP853; a stiff system by Radau, which takes seconds where the explicit method takes minutes.
    """
    evaluations = 0

    def watched(time: float, state: Floats) -> Floats:
        nonlocal evaluations
        evaluations += 1
        if evaluations == LOOK:
            step = STAGES * time / evaluations
            if step * np.abs(np.linalg.eigvals(system.jacobian(state))).max() > BOUND:
                raise _StabilityBound
        return system.dynamics(state)

    span, options = (0.0, end), {"dense_output": True, "rtol": TOLERANCE, "atol": TOLERANCE}
    try:
        solution = solve_ivp(watched, span, initial_state, method="DOP853", **options)
    except _StabilityBound:
        solution = solve_ivp(
            lambda _t, x: system.dynamics(x),
            span,
            initial_state,
            method="Radau",
            jac=lambda _t, x: system.jacobian(x),
            **options,
        )
    if not solution.success or solution.sol is None:
        raise ValueError(f"{system.title}: the reference solution stops before {end} s: {solution.message}")
    return solution.sol


def simulate(
    truth: Truth,
    times: Floats,
    observed: Sequence[str],
    noise: float = 0.0,
    seed: int = 0,
    known: Sequence[str] | None = None,
) -> Dataset:
    """Return what would be measured of a truth.

    Args:
        truth: system and initial state.
        times: data times in s `(N,)`, ascending from 0.
        observed: names of the measured states.
        noise: standard deviation of Gaussian noise, as a share of each state's largest modulus.
        seed: of the noise.
        known: names of the states whose initial value is known, without noise; None for all.

    Raises:
        ValueError: a name is none of the system's states, or the system cannot be solved.
    """
    names = [state.name for state in truth.system.states]
    if unknown := [name for name in (*observed, *(known or ())) if name not in names]:
        raise ValueError(f"{', '.join(unknown)}: not of the states {', '.join(names)}")
    states = truth.states(times)
    certain = np.array([known is None or name in known for name in names])
    values = states
    if noise > 0.0:
        errors = noise * np.abs(states).max(axis=0) * np.random.default_rng(seed).standard_normal(states.shape)
        errors[0, certain] = 0.0
        values = states + errors
    seen = np.array([name in observed for name in names])
    start = np.where(certain, np.array(truth.initial_state), np.nan)
    return Dataset(Series(times, np.where(seen, values, np.nan), start), names)
