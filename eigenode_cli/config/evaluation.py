"""How a recorded model does on measured data: those of its training, or other tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from eigenode_cli.config.build import build_solver
from eigenode_cli.config.prediction import holdout_of
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.setup import build
from eigenode_cli.config.table import measured_of
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.config.warm_start import load_field
from eigenode_cli.engines.base import unheard
from eigenode_cli.model import flat_parameters


def predictions(folder: Path, config: TrainConfig, changed: TrainConfig) -> pd.DataFrame:
    """Return the errors of a run's model, a row for each trajectory, channel and part.

    Args:
        folder: of the run.
        config: of the run.
        changed: the same with other tables, rows or another solver. Trajectories from other tables are held out as a
            whole: the model starts from the state that their first rows tell.

    Raises:
        UserError: a table cannot be read.
    """
    setup = build(config, unheard)
    own = load_field(setup.field, str(folder))
    theta = np.concatenate([flat_parameters(setup.field), *own.values()])
    solver = build_solver(changed.solver, setup.source.scaling.time)
    measured = setup.source.measured
    if isinstance(changed.system, TableConfig) and changed.system != config.system and measured is not None:
        others = measured_of(replace(changed.system, test=0.0))
        measured = replace(others, trajectories=tuple(replace(one, trained=0) for one in others.trajectories))
    setup = replace(
        setup, problem=setup.problem.changed(solver=solver), source=replace(setup.source, measured=measured)
    )
    holdout = holdout_of(setup)
    if holdout is None:
        raise ValueError("the data were simulated")
    rows, scaling, names = [], setup.source.scaling, [state.name for state in setup.source.states]
    units = np.concatenate([scaling.states, scaling.rates])
    channels = [*names, *(f"rate of {name}" for name in names)]
    for part, shown, trajectory in zip(
        holdout.parts,
        holdout.predictions(theta),
        setup.source.measured.trajectories if setup.source.measured else (),
        strict=True,
    ):
        wrong = (shown - part.series.channels) * units[: shown.shape[1]]
        for label, chosen in (("train", slice(None, part.trained)), ("test", slice(part.trained, None))):
            for channel in np.flatnonzero(part.series.channel_mask[chosen].any(axis=0)):
                error = wrong[chosen, channel][part.series.channel_mask[chosen, channel]]
                size = np.nanmax(np.abs(part.series.channels[:, channel])) * units[channel]
                mean = float(np.sqrt(np.mean(error**2)))
                rows.append(
                    {
                        "trajectory": trajectory.label,
                        "part": label,
                        "channel": channels[channel],
                        "rows": float(error.size),
                        "rms error": mean,
                        "relative": mean / size,
                        "largest error": float(np.abs(error).max()),
                    }
                )
    return pd.DataFrame(rows)
