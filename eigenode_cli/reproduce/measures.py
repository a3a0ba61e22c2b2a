"""Measures: one number from the recorded files of one run; NaN where not defined, infinite where never reached."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.reproduce.planned_runs import Unit
from eigenode_cli.reproduce.schema import ClaimSpec
from eigenode_cli.runs.reader import Metrics, RecordError, Run, Solution, read_run
from eigenode_cli.training.ending import FINAL, FINISHED


@dataclass(frozen=True)
class Result:
    """A unit's folder as measures and figures read it."""

    unit: Unit

    @cached_property
    def finished(self) -> bool:
        """Whether there is an outcome at all; a training that stalled or diverged has one, too."""
        return self.unit.status in FINAL

    @property
    def failed(self) -> bool:
        """Whether it counts as a failure."""
        return self.unit.status != FINISHED

    @cached_property
    def run(self) -> Run:
        """Everything recorded."""
        return read_run(self.unit.folder)

    @property
    def metrics(self) -> Metrics:
        """Rows of metrics.csv."""
        return self.run.metrics

    @property
    def solution(self) -> Solution:
        """solution.csv."""
        return self.run.solution

    @cached_property
    def average(self) -> float:
        """SOL of a model that learned the average of the data, the local minimum that the paper warns of."""
        seen = self.run.data.values[:, self.run.data.mask.any(axis=0)]
        return float(np.nanmean(np.abs(seen - np.nanmedian(seen, axis=0))))

    @cached_property
    def amplitude(self) -> float:
        """Largest modulus of the truth's x1 over the training horizon."""
        return float(np.abs(self.solution.truth[~self.solution.beyond, 0]).max())

    def extra(self, name: str) -> dict[str, float]:
        """Return what was measured of the trained model afterwards, from a JSON file in its folder.

        Raises:
            RecordError: it was not measured.
        """
        path: Path = self.unit.folder / name
        if not path.is_file():
            raise RecordError(f"{name} is missing in {self.unit.folder}")
        return {key: float(value) for key, value in json.loads(path.read_text()).items() if value is not None}


def at_step(metrics: Metrics, values: Floats, step: int | None) -> float:
    """Return the recorded value at a training step, the last one for None; NaN where that step was not recorded."""
    if step is None:
        return float(values[-1])
    found = np.flatnonzero(metrics.step == step)
    return float(values[found[0]]) if found.size else float("nan")


def sol(result: Result, claim: ClaimSpec) -> float:
    """SOL, in the unit of x1."""
    return at_step(result.metrics, result.metrics.terms["sol"], claim.step)


def dense_error(result: Result, claim: ClaimSpec) -> float:
    """Mean error against the truth on a dense grid, in the unit of x1."""
    return at_step(result.metrics, result.metrics.dense_error, claim.step)


def relative_error(result: Result, claim: ClaimSpec) -> float:
    """Dense error over the amplitude of the truth."""
    return dense_error(result, claim) / result.amplitude


def sol_to_average(result: Result, claim: ClaimSpec) -> float:
    """SOL over that of the average of the data: 1 in the local minimum of Fig. 1, 0 for a perfect fit."""
    return sol(result, claim) / result.average


def max_real(result: Result, claim: ClaimSpec) -> float:
    """Largest real part along the trajectory in 1/s."""
    return at_step(result.metrics, result.metrics.max_real, claim.step)


def mean_sol(result: Result, claim: ClaimSpec) -> float:
    """SOL averaged over all records: small for a training that converges fast."""
    del claim
    values = result.metrics.terms["sol"]
    return float(np.mean(values[np.isfinite(values)])) if np.isfinite(values).any() else float("nan")


def stable_first(result: Result, claim: ClaimSpec) -> float:
    """First recorded step at which the system is stable within the tolerance; infinite if there is none."""
    steps = result.metrics.step[result.metrics.max_real <= (claim.tolerance or 0.0)]
    return float(steps[0]) if steps.size else float("inf")


def stable_from(result: Result, claim: ClaimSpec) -> float:
    """Return the recorded step from which on the system stays stable within the tolerance, else infinity."""
    unstable = np.flatnonzero(~(result.metrics.max_real <= (claim.tolerance or 0.0)))
    if not unstable.size:
        return float(result.metrics.step[0])
    return float(result.metrics.step[unstable[-1] + 1]) if unstable[-1] + 1 < result.metrics.step.size else float("inf")


def rebound(result: Result, claim: ClaimSpec) -> float:
    """Largest SOL inside the window of steps over the smallest before it: above 1 for a visit back."""
    first, last = claim.window or (0, 0)
    steps, values = result.metrics.step, result.metrics.terms["sol"]
    inside, before = values[(steps >= first) & (steps <= last)], values[steps < first]
    if not (np.isfinite(inside).any() and np.isfinite(before).any()):
        return float("nan")
    return float(np.nanmax(inside) / np.nanmin(before))


def parameters(result: Result, claim: ClaimSpec) -> float:
    """Return number of learned parameters."""
    del claim
    return float(result.run.parameters)


def gradient_cost(result: Result, claim: ClaimSpec) -> float:
    """Time of the loss Jacobian over that of the gradient of SOL alone, at the trained parameters."""
    del claim
    return result.extra(COST_FILE)["ratio"]


def test_sol(result: Result, claim: ClaimSpec) -> float:
    """SOL from the state at the last data point over one more horizon."""
    del claim
    return result.extra(TEST_FILE).get("test_sol", float("nan"))


def twice_error(result: Result, claim: ClaimSpec) -> float:
    """Mean error of x1 over twice the training horizon, over the amplitude of the truth."""
    del claim
    solution = result.solution
    return float(np.mean(np.abs(solution.model[:, 0] - solution.truth[:, 0]))) / result.amplitude


def tight_error(result: Result, claim: ClaimSpec) -> float:
    """Relative error of the trained field solved at a tight tolerance, whatever that of the training was."""
    del claim
    return result.extra(TIGHT_FILE).get("dense_error", float("nan")) / result.amplitude


COST_FILE = "gradient_cost.json"
TEST_FILE = "test.json"
TIGHT_FILE = "tight.json"
UNITS = {"stable_first": "steps", "stable_from": "steps", "max_real": "1/s"}
"""Units of the measures that have one whatever the system is."""
TIMED = ("gradient_cost",)
"""Measures that depend on the machine."""

MEASURES: dict[str, Callable[[Result, ClaimSpec], float]] = {
    function.__name__: function
    for function in (
        sol,
        dense_error,
        relative_error,
        sol_to_average,
        max_real,
        stable_first,
        stable_from,
        mean_sol,
        rebound,
        parameters,
        gradient_cost,
        test_sol,
        twice_error,
        tight_error,
    )
}
"""Measures by the name that a claim uses."""
