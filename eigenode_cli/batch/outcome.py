"""What a run writes of its data before the training, and of its model behind it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.batch.baselines import baselines, summary
from eigenode_cli.batch.measured import recorded_units
from eigenode_cli.batch.stability import stability
from eigenode_cli.config.names import recorded_names
from eigenode_cli.config.setup import Setup
from eigenode_cli.engines.holdout import Holdout
from eigenode_cli.model import load_flat
from eigenode_cli.runs.final_outputs import write_eigenvalues, write_equilibrium, write_measured, write_solution
from eigenode_cli.runs.recorder import Recorder, write_data
from eigenode_cli.spectra.equilibrium import equilibrium
from eigenode_cli.terms import NAMES

DENSE = 1000
"""Number of equidistant times of the horizon at which dense_error compares."""


def dense_grid(setup: Setup) -> Floats:
    """Return the internal times at which `dense_error` compares `(DENSE,)`."""
    return setup.dataset.series[0].times[0] + np.linspace(0.0, setup.source.horizon, DENSE)


def build_recorder(setup: Setup, folder: Path, dense_times: Floats, monitored: Sequence[str]) -> Recorder:
    """Write data.csv, and return the recorder of a run.

    Args:
        setup: the parts of the run.
        folder: the run's.
        dense_times: see `dense_grid`.
        monitored: columns that the optimizer adds.
    """
    source = setup.source
    if source.measured is None:
        write_data(folder, setup.dataset)
    else:
        write_measured(folder, source)
    truth = None if source.truth is None else source.truth.states(dense_times)[:, 0]
    left_out = set(NAMES) - set(recorded_names(setup.config))
    return Recorder(folder, setup.names, truth, monitored, recorded_units(setup), sorted(left_out))


def write_outcome(setup: Setup, folder: Path, holdout: Holdout | None, theta: Floats) -> dict[str, Any]:
    """Write what the trained model says, and return what run.json adds: stability, and the errors of the baselines.

    Args:
        setup: the parts of the run, its field with the trained parameters.
        folder: the run's.
        holdout: predicts measured trajectories, None where the data were simulated.
        theta: trained parameters `(P,)`.
    """
    source, engine, times = setup.source, setup.engine, setup.problem.data.times
    write_solution(folder, source, engine, theta)
    along = engine.evaluate(theta, times)
    load_flat(setup.field, theta)
    rest = equilibrium(setup.field, along.dense)
    write_eigenvalues(folder, source, setup.field, along.dense, setup.problem, setup.target)
    write_equilibrium(folder, source, setup.field, rest, _targets_at_rest(setup))
    added: dict[str, Any] = {"stability": stability(setup, along, rest)}
    if holdout is None:
        return added
    found = baselines(setup, holdout)
    shown = {"model": holdout.predictions(theta)} | {name: one.predictions for name, one in found.items()}
    write_measured(folder, source, shown)
    return added | {"baselines": summary(found)}


def _targets_at_rest(setup: Setup) -> Complexes:
    """Return the eigenvalues to compare with at the equilibrium, none where the truth has no equilibrium."""
    try:
        return setup.target.resting(setup.problem.data.times)[0]
    except ValueError:
        return np.empty(0, dtype=np.complex128)
