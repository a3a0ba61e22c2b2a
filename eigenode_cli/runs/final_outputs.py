"""What a finished training says about the learned system: solution.csv, eigenvalues.csv, equilibrium.csv, data.csv."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.data.source import Source
from eigenode_cli.data.targets import Target
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, held
from eigenode_cli.runs.recorder import write_table
from eigenode_cli.spectra.eig import eig
from eigenode_cli.spectra.equilibrium import spectrum_at
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import UNMATCHED, rounding_levels, without_rounding
from eigenode_cli.spectra.tracking import assign, track

INTERVALS = 1000
"""Intervals of the solution's grid in one training horizon."""


def write_solution(folder: Path, source: Source, engine: Engine, theta: Floats) -> None:
    """Write solution.csv: truth, where there is one, and model on a dense grid over twice the horizon.

    With inputs it ends where they do. Of several trajectories it is the first.
    """
    series, horizon = source.dataset.series[0], source.horizon
    times = series.times[0] + np.linspace(0.0, 2.0 * horizon, 2 * INTERVALS + 1)
    if series.drive is not None:
        times = times[times <= max(series.drive.times[-1], series.times[-1])]
    model = engine.evaluate(theta, times).dense * source.scaling.states
    part = np.where(np.arange(times.size) <= INTERVALS, "train", "beyond")
    names = [state.name for state in source.states]
    header = ["t", *(f"truth_{name}" for name in names), *(f"model_{name}" for name in names), "horizon"]
    truth = np.full_like(model, np.nan) if source.truth is None else source.truth.states(times)
    numbers = np.column_stack([source.seconds(times), truth, model]).tolist()
    rows = [[*row, str(name)] for row, name in zip(numbers, part, strict=True)]
    write_table(folder / "solution.csv", header, rows)


def write_measured(folder: Path, source: Source, predictions: Mapping[str, Sequence[Floats]] | None = None) -> None:
    """Write data.csv of measured trajectories: channels, predictions beside them, and whether a row was held out.

    Args:
        folder: of the run.
        source: with what was measured.
        predictions: by the name that stands before their columns, `model` first: channels of each trajectory `(N, C)`
            in internal units; None while there are none.
    """
    measured, found = source.measured, dict(predictions or {})
    if measured is None:
        raise ValueError("the data were simulated")
    names, scaling = [state.name for state in source.states], source.scaling
    derivatives = any(one.series.rates is not None for one in measured.trajectories)
    channels = [*names, *(f"rate_{name}" for name in names)] if derivatives else names
    units = np.concatenate([scaling.states, scaling.rates])[: len(channels)]
    rows: list[list[Any]] = []
    for number, one in enumerate(measured.trajectories):
        shown = [every[number] * units for every in found.values()]
        numbers = np.column_stack([one.series.times, one.series.channels, *shown]).tolist()
        rows += [[*row, "train" if i < one.trained else "test", number] for i, row in enumerate(numbers)]
    beside = [f"{kind}_{name}" for kind in found for name in channels]
    write_table(folder / "data.csv", ["t", *channels, *beside, "part", "trajectory"], rows)


def write_eigenvalues(
    folder: Path,
    source: Source,
    field: VectorField,
    states: Floats,
    problem: Problem,
    target: Target,
) -> None:
    """Write eigenvalues.csv: the model's at all data times along its trajectory, tracked, with their targets.

    Args:
        folder: of the run.
        source: with the internal units.
        field: with the trained parameters.
        states: at the data times `(N, n)`, NaN where not reached.
        problem: with the inputs.
        target: what they are compared with, where it holds along the trajectory.
    """
    times, count = problem.data.times, problem.data.times.size
    reached = np.isfinite(states).all(axis=1)
    n = states.shape[1]
    spectra = np.full((count, n), np.nan, dtype=np.complex128)
    vectors = np.full((count, n, n), np.nan, dtype=np.complex128)
    with torch.no_grad():
        method = "symbolic" if field.has_symbolic_jacobian else problem.jacobian
        here = held(field, torch.from_numpy(problem.data.driven[reached]))
        matrices = jacobian(here, torch.from_numpy(states[reached]), method, torch.from_numpy(problem.sizes))
        result = eig(matrices, problem.max_condition)
    spectra[reached] = without_rounding(result.eigenvalues.numpy(), rounding_levels(matrices.numpy()))
    vectors[reached] = result.eigenvectors.numpy()
    order = track(spectra, vectors)
    spectra = source.scaling.eigenvalues(np.take_along_axis(spectra, order, axis=1))
    targets = source.scaling.eigenvalues(target.spectra(times))
    if problem.resting is not None:
        targets = np.full_like(targets, np.nan)
    rows: list[list[float | int | str]] = []
    for time, spectrum, wanted in zip(source.seconds(times), spectra, targets, strict=True):
        mode_of = assign(spectrum, wanted)
        goals = np.full(n, complex(np.nan, np.nan))
        goals[mode_of[mode_of != UNMATCHED]] = wanted[mode_of != UNMATCHED]
        rows += [
            [float(time), mode, value.real, value.imag, goal.real, goal.imag]
            for mode, (value, goal) in enumerate(zip(spectrum.tolist(), goals.tolist(), strict=True))
        ]
    write_table(folder / "eigenvalues.csv", ["t", "mode", "re", "im", "target_re", "target_im"], rows)


def write_equilibrium(folder: Path, source: Source, field: VectorField, rest: Floats | None, wanted: Complexes) -> None:
    """Write equilibrium.csv: the eigenvalues where the field without inputs is zero, with targets; no rows without one.

    Args:
        folder: of the run.
        source: with the internal units.
        field: with the trained parameters.
        rest: the equilibrium `(n,)`, None where there is none.
        wanted: eigenvalues that they are compared with, in internal units.
    """
    header = ["mode", "re", "im", "target_re", "target_im", "frequency", "damping_ratio"]
    header += [f"equilibrium_{state.name}" for state in source.states]
    rows = []
    if rest is not None:
        spectrum = source.scaling.eigenvalues(spectrum_at(field, rest))
        wanted = source.scaling.eigenvalues(wanted)
        goals, mode_of = np.full(spectrum.size, complex(np.nan, np.nan)), assign(spectrum, wanted)
        goals[mode_of[mode_of != UNMATCHED]] = wanted[mode_of != UNMATCHED]
        place = (rest * source.scaling.states).tolist()
        for mode, (value, goal) in enumerate(zip(spectrum.tolist(), goals.tolist(), strict=True)):
            numbers = [value.real, value.imag, goal.real, goal.imag, abs(value.imag) / (2.0 * np.pi)]
            rows.append([mode, *numbers, -value.real / abs(value) if value != 0.0 else np.nan, *place])
    write_table(folder / "equilibrium.csv", header, rows)
