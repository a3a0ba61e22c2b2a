"""What a run writes of its data before the training, and of its model behind it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.batch.baselines import baselines, summary
from eigenode_cli.batch.measured import recorded_units
from eigenode_cli.config.setup import Setup
from eigenode_cli.engines.holdout import Holdout
from eigenode_cli.runs.final_outputs import write_eigenvalues, write_equilibrium, write_measured, write_solution
from eigenode_cli.runs.recorder import Recorder, write_data

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
    return Recorder(folder, setup.names, truth, monitored, recorded_units(setup))


def write_outcome(setup: Setup, folder: Path, holdout: Holdout | None, theta: Floats) -> dict[str, Any]:
    """Write what the trained model says, and return what run.json adds: the errors of the baselines.

    Args:
        setup: the parts of the run, its field with the trained parameters.
        folder: the run's.
        holdout: predicts measured trajectories, None where the data were simulated.
        theta: trained parameters `(P,)`.
    """
    source, engine = setup.source, setup.engine
    write_solution(folder, source, engine, theta)
    write_eigenvalues(folder, source, setup.field, engine, theta, setup.problem, setup.target)
    along = engine.evaluate(theta, setup.problem.data.times).dense
    write_equilibrium(folder, source, setup.field, along, setup.target)
    if holdout is None:
        return {}
    found = baselines(setup, holdout)
    shown = {"model": holdout.predictions(theta)} | {name: one.predictions for name, one in found.items()}
    write_measured(folder, source, shown)
    return {"baselines": summary(found)}
