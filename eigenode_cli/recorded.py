"""Recorded runs in Python: start one, read its tables, use its model, draw its figures."""

import copy
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import torch

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.batch import run as runner
from eigenode_cli.config.build import build_source, build_truth
from eigenode_cli.config.check import examine, normalise
from eigenode_cli.config.compose import restore, run_config, typed
from eigenode_cli.config.composer import Composer, keep_composition
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.config.warm_start import empty_field, load_field, recorded_scaling, started_from
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.scaling import Scaling
from eigenode_cli.data.source import Source
from eigenode_cli.model import VectorField
from eigenode_cli.model.scaled import ScaledField
from eigenode_cli.reporting.figures import draw_figure, figures_of
from eigenode_cli.runs.paths import claim_folder, importable, new_folder, run_folder
from eigenode_cli.runs.reader import Run, open_run
from eigenode_cli.runs.runfile import RUN, RecordError, config_dirs, read_record
from eigenode_cli.solve.drive import Drive
from eigenode_cli.solve.settings import TIGHT, Solver
from eigenode_cli.solve.trajectory import solve
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.systems.base import State
from eigenode_cli.training.ending import INTERRUPTED

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Comparison:
    """A model beside the truth.

    Attributes:
        table: `t` in s, then `truth_<state>` and `model_<state>`; NaN where the model could not be solved.
        errors: one row a state: mean and largest modulus of the error, and the mean as a share of the truth's largest
            modulus.
    """

    table: pd.DataFrame
    errors: pd.DataFrame


@dataclass(frozen=True)
class RecordedRun:
    """A run, from its folder.

    Attributes:
        folder: where it lies.
        record: run.json.
        config: what it was started with.
    """

    folder: Path
    record: dict[str, Any]
    config: TrainConfig

    @property
    def status(self) -> str:
        """How it ended: finished, failed, interrupted, stalled, diverged; or running."""
        return str(self.record["status"])

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(state.name for state in self._run.states)

    @property
    def described_states(self) -> tuple[State, ...]:
        """The states with unit and symbol."""
        return tuple(self._run.states)

    @property
    def internal_field(self) -> VectorField:
        """The learned vector field in internal units, with the weights of the result."""
        return self._model[0]

    @cached_property
    def _run(self) -> Run:
        return open_run(self.folder)

    @cached_property
    def _model(self) -> tuple[VectorField, dict[str, Floats]]:
        """The learned field in internal units with the weights of the result, and what else was trained."""
        field = empty_field(self.config)
        return field, load_field(field, str(self.folder))

    @cached_property
    def scaling(self) -> Scaling:
        """Internal units of the run; ones where the data were simulated."""
        return recorded_scaling(self.record, self.config)

    @cached_property
    def source(self) -> Source:
        """Where its data come from; tables are read again.

        Raises:
            UserError: a table is gone, or can't be read any more.
        """
        return build_source(self.config)

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """One row a record: step, losses, largest real part in 1/s, dense error (metrics.csv)."""
        return self._table("metrics.csv")

    @cached_property
    def solution(self) -> pd.DataFrame:
        """Truth and model over twice the horizon (solution.csv)."""
        return self._table("solution.csv")

    @cached_property
    def eigenvalues(self) -> pd.DataFrame:
        """Tracked eigenvalues along the trajectory with their targets, in 1/s (eigenvalues.csv)."""
        return self._table("eigenvalues.csv")

    @cached_property
    def data(self) -> pd.DataFrame:
        """What SOL compares; empty where nothing was measured (data.csv)."""
        return self._table("data.csv")

    def _table(self, name: str) -> pd.DataFrame:
        try:
            return pd.read_csv(self.folder / name)
        except (OSError, ValueError) as error:
            raise RecordError(f"{self.folder / name}: cannot be read ({error})") from error

    def field(self, step: int | None = None) -> VectorField | ScaledField:
        """Return the learned vector field in the user's units.

        Args:
            step: of the checkpoint whose weights it has; None for those of the result.

        Raises:
            UserError: there is no such checkpoint.
        """
        field = empty_field(self.config)
        load_field(field, str(self.folder), step)
        return ScaledField(field, self.scaling) if isinstance(self.config.system, TableConfig) else field

    def initial_state(self, trajectory: int = 0) -> Floats:
        """Return the state `(n,)` that the model starts from: what is known, and trained values of the rest.

        Args:
            trajectory: which one of several.
        """
        return started_from(self.config, self.states, self._model[1], self.scaling, trajectory)

    def simulate(
        self,
        times: Sequence[float] | Floats,
        initial_state: Sequence[float] | None = None,
        drive: Drive | None = None,
        solver: Solver = TIGHT,
    ) -> Floats:
        """Return the model's states `(D, n)` at ascending `times (D,)` in s, the first one that of the initial state.

        Args:
            times: output times.
            initial_state: state `(n,)` at the first of them, by default that of the training.
            drive: the inputs, by default those of the first trajectory of the training.
            solver: method and tolerances, in the internal units of measured data.

        Raises:
            ValueError: the times are not finite and ascending, or the initial state has another length.
        """
        start = self.initial_state() if initial_state is None else np.asarray(initial_state, dtype=np.float64)
        if start.shape != (len(self.states),):
            raise ValueError(
                f"initial_state has shape {start.shape}; give one value for each of {', '.join(self.states)}"
            )
        instants, scaling, field = np.array(times, dtype=np.float64), self.scaling, self._model[0]
        if drive is None and field.inputs and self.source.measured is not None:
            drive = self.source.measured.trajectories[0].series.drive
        plain = Series(instants, np.tile(start, (instants.size, 1)), start, drive=drive)
        scaled = scaling.scaled(plain) if isinstance(self.config.system, TableConfig) else plain
        with torch.no_grad():
            found = solve(
                field,
                torch.from_numpy(scaled.initial_state),
                torch.from_numpy(scaled.times),
                solver,
                drive=scaled.drive,
            )
        return found.padded(instants.size) * scaling.states

    def spectra(self, states: Floats) -> Complexes:
        """Return the eigenvalues `(D, n)` in 1/s of the learned field at the states `(D, n)`; NaN where one is NaN."""
        known = np.isfinite(states).all(axis=1)
        values = np.full(states.shape, np.nan, dtype=np.complex128)
        field = self.field()
        method = "symbolic" if field.has_symbolic_jacobian else "autodiff"
        with torch.no_grad():
            values[known] = eigvals(jacobian(field, torch.from_numpy(states[known]), method))[0].numpy()
        return values

    def evaluate(
        self, initial_state: Sequence[float] | None = None, horizon: float | None = None, points: int = 1001
    ) -> Comparison:
        """Simulate the model and the truth, from another initial state or over another horizon.

        Args:
            initial_state: of both, by default that of the training.
            horizon: time in s, by default that of the training.
            points: number of equidistant times.

        Raises:
            ValueError: the truth cannot be solved, or the initial state has another length.
        """
        system = self.config.system
        if isinstance(system, TableConfig):
            raise ValueError("measured data have no truth to compare with; see `predictions`")
        start = list(system.initial_state if initial_state is None else map(float, initial_state))
        times = np.linspace(0.0, system.horizon if horizon is None else horizon, points)
        model = self.simulate(times, None if initial_state is None else start)
        truth = build_truth(replace(system, initial_state=start)).states(times)
        columns = {"t": times}
        columns |= {f"truth_{name}": truth[:, i] for i, name in enumerate(self.states)}
        columns |= {f"model_{name}": model[:, i] for i, name in enumerate(self.states)}
        error, size = np.abs(model - truth), np.abs(truth).max(axis=0)
        rows = {"mean": error.mean(axis=0), "largest": error.max(axis=0), "relative": error.mean(axis=0) / size}
        return Comparison(pd.DataFrame(columns), pd.DataFrame(rows, index=pd.Index(self.states, name="state")))

    @property
    def figures(self) -> list[str]:
        """Names of the figures that can be drawn of it."""
        return figures_of(self._run)

    def figure(self, name: str) -> "Figure":
        """Draw one of its `figures`.

        Raises:
            ValueError: there is no such figure.
            RecordError: a file that it is drawn from is missing or damaged.
        """
        if name not in self.figures:
            raise ValueError(f"figure {name}: choose from {', '.join(self.figures)}")
        return draw_figure(self._run, name)


def load_run(run: str | os.PathLike[str]) -> RecordedRun:
    """Return the run in a folder, or of a name under outputs/.

    Raises:
        UserError: there is none, or its record is damaged; the message names file and key.
    """
    folder = run_folder(os.fspath(run))
    record = read_record(folder)
    with importable(".", *config_dirs(str(record.get("command", "")))):
        settings = record.get("config")
        if not isinstance(settings, dict):
            raise RecordError(f"{RUN}: config is missing")
        return RecordedRun(folder, record, restore(settings, record.get("schemas")))


def train(
    *overrides: str, folder: str | os.PathLike[str] | None = None, config_dir: str | os.PathLike[str] | None = None
) -> RecordedRun:
    """Train as `eigenode train` does, without printing, and return the run.

    Args:
        overrides: settings, `KEY=VALUE` each.
        folder: where the run is written; by default a new folder under outputs/.
        config_dir: a folder of your own configs and code.

    Raises:
        UserError: with all faults of the settings, or the folder holds a run already.
        KeyboardInterrupt: it was interrupted; `eigenode resume` goes on with it.
    """
    dirs = [] if config_dir is None else [os.fspath(config_dir)]
    threads, random_state = torch.get_num_threads(), torch.get_rng_state()
    try:
        with importable(".", *dirs):
            words = normalise(overrides)
            found = examine(Composer(*dirs), words)
            composed = copy.deepcopy(found.checked())
            config = typed(run_config(found))
            place = (
                claim_folder(f"{config.system.name}_{config.grads}_seed{config.seed}")
                if folder is None
                else Path(folder)
            )
            new_folder(place, str(place))
            if (place / RUN).exists():
                raise RecordError(f"{place}: holds a run already; name another folder")
            keep_composition(composed, place, words)
            own = [f"--config-dir={Path(name).resolve()}" for name in dirs]
            status = runner.train(config, place, [*own, *words], quiet=True)
    finally:
        torch.set_num_threads(threads)
        torch.set_rng_state(random_state)
    if status == runner.EXIT[INTERRUPTED]:
        raise KeyboardInterrupt
    return load_run(place)
