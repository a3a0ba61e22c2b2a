"""The reference solution of a system, and what is sampled from it: data, targets, the truth of a figure."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.integrate import OdeSolution, solve_ivp

from eigenode_cli.data.dataset import Data, Floats, Targets
from eigenode_cli.engines.base import Complexes
from eigenode_cli.spectra.pairs import (
    REAL,
    ROUNDING,
    find_partners,
    rounding_levels,
    target_eigenvalue,
    without_rounding,
)
from eigenode_cli.systems.base import System
from eigenode_cli.terms.stf import stiffness_ratio

TOLERANCE = 1e-10
"""Relative and absolute tolerance of the reference solution."""


def reference_solution(system: System, initial_state: Floats, times: Floats) -> Floats:
    """States `(D, n)` of the system at `times (D,)` in s, ascending from 0, by SciPy's DOP853 at 1e-10.

    Raises:
        ValueError: the system itself cannot be solved over these times.
    """
    return np.ascontiguousarray(_solved(system, tuple(initial_state.tolist()), float(times[-1]))(times).T)


@lru_cache(maxsize=16)
def _solved(system: System, initial_state: tuple[float, ...], end: float) -> OdeSolution:
    """The solution from 0 to `end`, which a run asks for at several grids, and many seeds in one process again."""
    solution = solve_ivp(
        lambda _t, x: system.dynamics(x),
        (0.0, end),
        initial_state,
        method="DOP853",
        dense_output=True,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    if not solution.success or solution.sol is None:
        raise ValueError(f"{system.title}: the reference solution stops before {end} s: {solution.message}")
    return solution.sol


def sample(system: System, initial_state: Floats, horizon: float, points: int, observed: list[str]) -> Data:
    """Data `(N, n)` at `points` equidistant times from 0 to `horizon` in s; `observed` names the states SOL sees."""
    times = np.linspace(0.0, horizon, points)
    states = reference_solution(system, initial_state, times)
    seen = np.array([state.name in observed for state in system.states])
    return Data(times=times, states=states, mask=np.broadcast_to(seen, states.shape).copy())


def with_noise(data: Data, share: float, seed: int) -> Data:
    """The data with Gaussian noise on what is observed, but for the initial state; the same for all runs of a seed.

    Args:
        data: of the truth.
        share: standard deviation as a share of each state's largest modulus; 0 gives the data as it is.
        seed: of the draw.
    """
    if share == 0.0:
        return data
    noise = share * np.abs(data.states).max(axis=0) * np.random.default_rng(seed).standard_normal(data.states.shape)
    noise[0] = 0.0
    return replace(data, states=np.where(data.mask, data.states + noise, data.states))


def targets_of_spectra(spectra: Complexes, levels: Floats | None = None) -> Targets:
    """Targets as they follow from given spectra `(T, n)` in 1/s: pairs, their frequency and damping, stiffness.

    `levels (T,)` are their rounding levels in 1/s, None for spectra that are exact.
    """
    levels = np.zeros(spectra.shape[0]) if levels is None else levels
    count, n = spectra.shape
    frequency = np.full((count, max(1, n // 2)), np.nan)
    damping = np.full_like(frequency, np.nan)
    pairs = np.zeros(count, dtype=np.int64)
    stiffness = np.zeros((count, 2))
    partner = np.empty(n, dtype=np.int64)
    for t, (spectrum, level) in enumerate(zip(np.ascontiguousarray(spectra), levels.tolist(), strict=True)):
        pairs[t] = find_partners(spectrum, level, partner)
        upper = spectrum[(partner != REAL) & (spectrum.imag > 0.0)]
        upper = upper[np.argsort(upper.imag, kind="stable")]
        frequency[t, : upper.size] = upper.imag / (2.0 * np.pi)
        damping[t, : upper.size] = -upper.real / np.abs(upper)
        stiffness[t] = stiffness_ratio(spectrum, level)
    return Targets(frequency=frequency, damping=damping, pairs=pairs, stiffness=stiffness)


def truth_spectra(system: System, states: Floats, frequency_factor: float) -> Complexes:
    """Spectra `(T, n)` of the truth in 1/s at the states `(T, n)` of its own trajectory.

    With a `frequency_factor` other than 1 they are wrong on purpose: each pair has its frequency times the factor, and
    its damping ratio, so that it is scaled as a whole; real eigenvalues stay.
    """
    return _truth(system, states, frequency_factor)[0]


def truth_targets(system: System, states: Floats, frequency_factor: float = 1.0) -> Targets:
    """Targets of `truth_spectra`."""
    return targets_of_spectra(*_truth(system, states, frequency_factor))


def _truth(system: System, states: Floats, frequency_factor: float) -> tuple[Complexes, Floats]:
    """`truth_spectra` and their rounding levels `(T,)`, which scale with a spectrum's pairs."""
    matrices = system.jacobian(states)
    levels = rounding_levels(matrices)
    spectra = without_rounding(np.linalg.eigvals(matrices).astype(np.complex128), levels)
    return np.where(spectra.imag == 0.0, spectra, frequency_factor * spectra), levels * min(frequency_factor, 1.0)


def stated_spectrum(frequency: list[float], damping: list[float]) -> tuple[Complexes, float]:
    """Eigenvalues `(2 K,)` in 1/s of stated pairs, upper members first, and their rounding level in 1/s.

    The size behind that level is that of the normal matrix with these eigenvalues: their 2-norm.
    """
    pairs = zip(frequency, damping, strict=True)
    upper = np.array([target_eigenvalue(*pair) for pair in pairs], dtype=np.complex128)
    spectrum = np.concatenate([upper, upper.conj()])
    return spectrum, ROUNDING * float(np.linalg.norm(spectrum))


def stated_targets(frequency: list[float], damping: list[float], count: int) -> Targets:
    """Targets stated by the user, the same for `count` spectra: damped frequencies in Hz and damping ratios.

    The stiffness ratio is that of the stated pairs, `max|Re| / min|Re|`; there is none without a pair.
    """
    order = np.argsort(frequency, kind="stable")
    damped = np.asarray(frequency, dtype=np.float64)[order]
    ratio = np.asarray(damping, dtype=np.float64)[order]
    stiffness = stiffness_ratio(*stated_spectrum(frequency, damping)) if frequency else np.inf
    return Targets(
        frequency=np.tile(damped, (count, 1)),
        damping=np.tile(ratio, (count, 1)),
        pairs=np.full(count, damped.size, dtype=np.int64),
        stiffness=np.full((count, 2), stiffness),
    )
