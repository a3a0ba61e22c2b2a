"""SINDy (pysindy) on a measured record, with what `eigenode train` knows of it.

Data, held-out part and internal units are those of the run. States that were not measured come from smoothing splines
(`eigenode_cli.data.reconstruct`), as do the rates that the polynomials of degree 3 in states and inputs are fitted to
(S. Brunton, J. Proctor, J. N. Kutz, PNAS 113, 2016, 3932-3937). The stated modes are given in a second family of
candidates: there the field starts as the linear system with these modes, as eigenode's does, and the polynomials are
fitted to what it leaves. Each quarter of the training is simulated from an initial state that is fitted to it; the
threshold and the family that fit best there are taken. The held-out part follows from the last quarter's initial state;
that of a file held out as a whole is the one that eigenode takes.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pysindy
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from eigenode_cli.arrays import Floats
from eigenode_cli.config.prediction import holdout_of
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.setup import Setup, build, initial_linear
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct

DEGREE = 3
THRESHOLDS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
QUARTERS = 4
BOUND, EVALUATIONS = 30.0, 20_000
"""A simulation diverges if a state in internal units exceeds the first, or if it takes more evaluations of the field."""
LOST = 1e3
"""Residual of a sample that a simulation does not reach."""


class _Diverged(Exception):
    """A simulation takes too long."""


@dataclass(frozen=True)
class Model:
    """A field of monomials in states and inputs.

    Attributes:
        powers: of each monomial `(F, n + k)`.
        coefficients: `(n, F)`; linear: added to it, `(n, n + k)`.
    """

    powers: Floats
    coefficients: Floats
    linear: Floats

    def simulate(self, series: Series, start: Floats, first: int, end: int) -> Floats:
        """Return the states `(end - first, n)` at these rows from the state `start (n,)`; NaN behind a divergence."""
        times, count = series.times[first:end], 0
        found = np.full((times.size, start.size), np.nan)

        def rate(t: float, x: Floats) -> Floats:
            nonlocal count
            count += 1
            if count > EVALUATIONS:
                raise _Diverged
            both = x if series.drive is None else np.concatenate([x, series.drive.at(np.array([t]))[0]])
            return self.coefficients @ np.prod(both**self.powers, axis=1) + self.linear @ both

        def escape(t: float, x: Floats) -> float:
            del t
            return BOUND - float(np.abs(x).max())

        escape.terminal = True  # type: ignore[attr-defined]
        longest = np.inf if series.drive is None else 4.0 * float(np.median(np.diff(series.drive.times)))
        ends = (float(times[0]), float(times[-1]))
        try:
            solved = solve_ivp(rate, ends, start, t_eval=times, rtol=1e-6, atol=1e-8, max_step=longest, events=escape)
        except _Diverged:
            return found
        found[: solved.y.shape[1]] = solved.y.T
        return found


def sindy(config: TrainConfig) -> dict[str, Any]:
    """Return the test error of the candidate that fits the training best, and all candidates."""
    setup = build(config, lambda _line: None)
    estimates = [reconstruct(one, config.network.structure) for one in setup.dataset.series]
    candidates = []
    for family, linear in _families(setup, estimates[0]).items():
        for threshold in THRESHOLDS:
            model = fitted(setup.dataset.series, estimates, linear, threshold)
            starts = [quarters(model, *both) for both in zip(setup.dataset.series, estimates, strict=True)]
            error = float(np.sqrt(np.mean([misfit for one in starts for _, _, misfit in one])))
            candidates.append(
                {
                    "family": family,
                    "threshold": threshold,
                    "monomials": int(np.count_nonzero(model.coefficients)),
                    "training": error,
                    "error": _test_error(setup, model, [one[-1][:2] for one in starts], estimates),
                }
            )
    best = min(candidates, key=lambda one: one["training"])
    return {**best, "candidates": candidates}


def _families(setup: Setup, estimate: Estimate) -> dict[str, Floats]:
    """Return the linear part `(n, n + k)` that each family starts from."""
    n, k = setup.problem.data.states, setup.problem.data.inputs
    families = {"plain": np.zeros((n, n + k))}
    matrix = initial_linear(setup.config, setup.problem, estimate) if setup.config.network.linear == "modes" else None
    if matrix is not None:
        upper = np.hstack([np.zeros((n // 2, n // 2)), np.eye(n // 2), np.zeros((n // 2, k))])
        families["modes"] = np.vstack([upper, matrix])
    return families


def fitted(every: Sequence[Series], estimates: Sequence[Estimate], linear: Floats, threshold: float) -> Model:
    """Return the sparse polynomials of the rates that `linear` leaves."""
    states = np.vstack([one.states for one in estimates])
    rates = np.vstack([one.rates for one in estimates])
    inputs = np.vstack([series.driven for series in every])
    left = rates - np.hstack([states, inputs]) @ linear.T
    known = np.isfinite(states).all(axis=1) & np.isfinite(left).all(axis=1)
    library = pysindy.PolynomialLibrary(degree=DEGREE)
    model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold), feature_library=library)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a threshold that leaves nothing says so
        given = {"u": inputs[known]} if inputs.size else {}
        model.fit(states[known], t=np.arange(known.sum(), dtype=float), x_dot=left[known], **given)
    return Model(np.asarray(library.powers_, dtype=float), np.asarray(model.coefficients()), linear)


def quarters(model: Model, series: Series, estimate: Estimate) -> list[tuple[int, Floats, float]]:
    """Return the first row of each quarter, the initial state fitted to it, and the mean square that is left."""
    bounds = np.linspace(0, series.times.size, QUARTERS + 1).astype(int)
    scale = np.nanmax(np.abs(series.values), axis=0)
    scale = np.where(np.isfinite(scale) & (scale > 0.0), scale, 1.0)
    found = []
    for first, end in zip(bounds[:-1], bounds[1:], strict=True):

        def residuals(start: Floats, first: int = int(first), end: int = int(end)) -> Floats:
            shown = model.simulate(series, start, first, end) + estimate.offsets[: series.states]
            wrong = np.nan_to_num(shown, nan=LOST) - series.values[first:end]
            return np.clip((wrong / scale)[series.mask[first:end]], -LOST, LOST)

        fit = least_squares(residuals, np.nan_to_num(estimate.states[first]), diff_step=1e-4, max_nfev=15)
        found.append((int(first), fit.x, float(np.mean(fit.fun**2))))
    return found


def _test_error(
    setup: Setup, model: Model, starts: Sequence[tuple[int, Floats]], estimates: Sequence[Estimate]
) -> float:
    """Return the error over what was held out, infinite where the simulation diverges."""
    holdout = holdout_of(setup)
    if holdout is None:
        return float("nan")
    predictions = []
    for number, part in enumerate(holdout.parts):
        first, start = starts[min(number, len(starts) - 1)]
        if part.trained == 0:
            first, start = 0, part.series.initial_state
        shown = np.full(part.series.channels.shape, np.nan)
        n, end = part.series.states, part.series.times.size
        offsets = estimates[min(number, len(estimates) - 1)].offsets[:n]
        shown[first:, :n] = model.simulate(part.series, start, first, end) + offsets
        predictions.append(shown)
    return holdout.error_of(predictions)
