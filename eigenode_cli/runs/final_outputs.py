"""What a finished training says about the learned system: solution.csv and eigenvalues.csv."""

from pathlib import Path

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.data.simulate import Truth
from eigenode_cli.data.targets import Target
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField
from eigenode_cli.runs.recorder import write_table
from eigenode_cli.spectra.eig import eig
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import UNMATCHED, rounding_levels, without_rounding
from eigenode_cli.spectra.tracking import assign, track

INTERVALS = 1000
"""Intervals of the solution's grid in one training horizon."""


def write_solution(folder: Path, truth: Truth, engine: Engine, theta: Floats, horizon: float) -> None:
    """Write solution.csv: truth and model on a dense grid over twice the horizon."""
    times = np.linspace(0.0, 2.0 * horizon, 2 * INTERVALS + 1)
    model = engine.evaluate(theta, times).dense
    part = np.where(np.arange(times.size) <= INTERVALS, "train", "beyond")
    names = [state.name for state in truth.system.states]
    header = ["t", *(f"truth_{name}" for name in names), *(f"model_{name}" for name in names), "horizon"]
    numbers = np.column_stack([times, truth.states(times), model]).tolist()
    rows = [[*row, str(name)] for row, name in zip(numbers, part, strict=True)]
    write_table(folder / "solution.csv", header, rows)


def write_eigenvalues(
    folder: Path, field: VectorField, engine: Engine, theta: Floats, problem: Problem, target: Target
) -> None:
    """Write eigenvalues.csv: the model's at all data times along its trajectory, tracked, with their targets."""
    times, count = problem.data.times, problem.data.times.size
    states = engine.evaluate(theta, times).dense
    reached = np.isfinite(states).all(axis=1)
    n = states.shape[1]
    spectra = np.full((count, n), np.nan, dtype=np.complex128)
    vectors = np.full((count, n, n), np.nan, dtype=np.complex128)
    with torch.no_grad():
        method = "symbolic" if field.has_symbolic_jacobian else problem.jacobian
        matrices = jacobian(field, torch.from_numpy(states[reached]), method, torch.from_numpy(problem.sizes))
        result = eig(matrices, problem.max_condition)
    spectra[reached] = without_rounding(result.eigenvalues.numpy(), rounding_levels(matrices.numpy()))
    vectors[reached] = result.eigenvectors.numpy()
    order = track(spectra, vectors)
    spectra = np.take_along_axis(spectra, order, axis=1)
    targets = target.spectra(times)
    rows: list[list[float | int | str]] = []
    for time, spectrum, wanted in zip(times, spectra, targets, strict=True):
        mode_of = assign(spectrum, wanted)
        goals = np.full(n, complex(np.nan, np.nan))
        goals[mode_of[mode_of != UNMATCHED]] = wanted[mode_of != UNMATCHED]
        rows += [
            [float(time), mode, value.real, value.imag, goal.real, goal.imag]
            for mode, (value, goal) in enumerate(zip(spectrum.tolist(), goals.tolist(), strict=True))
        ]
    write_table(folder / "eigenvalues.csv", ["t", "mode", "re", "im", "target_re", "target_im"], rows)
