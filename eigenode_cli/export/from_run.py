"""The exported model of a recorded run: weights of a checkpoint, range of the training, modes."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import torch

from eigenode_cli import __version__
from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.config.compose import restore
from eigenode_cli.config.plugins import CUSTOM, load_class
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.config.warm_start import empty_field, load_field, recorded_scaling, started_from
from eigenode_cli.data.scaling import Scaling
from eigenode_cli.data.targets import targets_of_spectra
from eigenode_cli.errors import UserError
from eigenode_cli.export.exported import ExportedModel, Layer, Monomials, Perceptron
from eigenode_cli.model import Mlp, Polynomial, VectorField
from eigenode_cli.model.scaled import ScaledField
from eigenode_cli.runs.checkpoints import checkpoint_path
from eigenode_cli.runs.paths import importable, run_folder
from eigenode_cli.runs.reader import Run, open_run
from eigenode_cli.runs.runfile import RecordError, config_dirs, read_record
from eigenode_cli.solve.settings import TIGHT
from eigenode_cli.solve.trajectory import solve
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.equilibrium import equilibrium
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import rounding_levels, without_rounding

SHARE, FEWEST_STEPS = 0.05, 200
"""A fixed step is at most this share of 1/|eigenvalue|, and there are at least so many in the training horizon."""


def exported_model(run: str | Path, step: int | None = None) -> ExportedModel:
    """Return what is exported of a run.

    Args:
        run: its folder, or its name under outputs/.
        step: of the checkpoint; None for that of the run's result.

    Raises:
        UserError: there is no such run or checkpoint, its network is none that can be exported, or a weight of it is
            not finite.
    """
    folder = run_folder(str(run))
    record = read_record(folder)
    opened = open_run(folder)
    with importable(".", *config_dirs(opened.command)):
        config = restore(opened.config, record.get("schemas"))
        if load_class(config.network.target) not in (Mlp, Polynomial):
            raise UserError(
                f"{run}: the network {config.network.target} is a class of your own; only"
                " network=mlp and network=polynomial can be exported"
            )
        field = empty_field(config)
        checkpoint = checkpoint_path(str(folder), step)
        try:
            trained = load_field(field, str(checkpoint))
        except ValueError as error:
            raise RecordError(f"{run}: the checkpoint does not go with run.json: {error}") from error
    try:
        scaling = recorded_scaling(record, config)
        model = _model(opened, config, ScaledField(field, scaling), scaling, trained)
    except ValueError as error:
        raise UserError(f"{run}: cannot be exported: {error}") from error
    return replace(model, trained_steps=int(checkpoint.stem.removeprefix("step-")))


def _model(
    run: Run, config: TrainConfig, field: ScaledField, scaling: Scaling, trained: Mapping[str, Floats]
) -> ExportedModel:
    if not run.states:
        raise ValueError(f"the run {run.status} before its system was built")
    initial = started_from(config, [state.name for state in run.states], trained, scaling)
    times = run.solution.times[~run.solution.beyond]
    start, end, path = float(times[0]), float(times[-1]), _trajectory(run, field, initial, times)
    inner = field.field
    lowest, highest = _range(run.data.seen[run.data.times <= end], path)
    modes, modes_at, fastest = _modes(run, field, path)
    return ExportedModel(
        name=_name(config, run),
        states=run.states,
        network=_network(inner),
        inputs=run.inputs,
        linear=None if inner.linear is None else inner.linear.weight.detach().numpy().copy(),
        structure=inner.structure,
        state_units=scaling.states,
        input_units=scaling.inputs,
        time_unit=scaling.time,
        initial_state=initial,
        start=start,
        end=end,
        lowest=lowest,
        highest=highest,
        modes=modes,
        modes_at=modes_at,
        step=min((end - start) / FEWEST_STEPS, SHARE / max(fastest, 1e-300)),
        command=run.command,
        run=run.folder.resolve().name,
        version=run.versions.get("eigenode", __version__),
    )


def _network(field: VectorField) -> Perceptron | Monomials:
    """Return the network's numbers, copied."""
    network = field.network
    if isinstance(network, Polynomial):
        return Monomials(network.exponents.numpy().copy(), network.coefficients.detach().numpy().copy())
    mlp = cast(Mlp, network)
    weights = {name: tensor.detach().numpy().copy() for name, tensor in mlp.state_dict().items()}
    return Perceptron(
        layers=tuple(
            Layer(weights[f"layers.{number}.weight"], weights[f"layers.{number}.bias"])
            for number in range(len(mlp.layers))
        ),
        activation=mlp.activation,
        input_scale=weights.get("input_scale"),
        output_scale=weights.get("output_scale"),
    )


def _trajectory(run: Run, field: ScaledField, initial: Floats, times: Floats) -> Floats:
    """Return the model's states over the training horizon, as far as it can be solved `(D, n)`.

    With inputs they are the recorded ones, which belong to the result of the run.
    """
    if field.inputs:
        recorded = run.solution.model[: times.size]
        return recorded[np.isfinite(recorded).all(axis=1)]
    units = field.states
    with torch.no_grad():
        start = torch.from_numpy(initial) / units
        found = solve(field.field, start, torch.from_numpy((times - times[0]) / field.time), TIGHT)
        return (found.states * units).numpy()


def _name(config: TrainConfig, run: Run) -> str:
    """Return what the system is called: a table by its file, a class of the user's own by its name."""
    system = config.system
    if isinstance(system, TableConfig):
        return Path(system.file if isinstance(system.file, str) else str(system.file[0])).stem
    return system.target.partition(":")[2] if run.system == CUSTOM else run.system


def _range(measured: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Return the lowest and highest value `(n,)` of each state in training.

    Those of the measurements; where nothing was measured of a state, those of the trajectory that was trained.
    """
    known = np.isfinite(measured).any(axis=0)
    seen = np.where(known, measured, np.nan)
    low = np.where(known, np.nanmin(np.where(known, seen, 0.0), axis=0), path.min(axis=0))
    high = np.where(known, np.nanmax(np.where(known, seen, 0.0), axis=0), path.max(axis=0))
    return low, high


def _modes(run: Run, field: ScaledField, path: Floats) -> tuple[tuple[tuple[float, float], ...], str, float]:
    """Return the modes, where they are, and the largest modulus in 1/s of an eigenvalue along the trajectory."""
    spectra, levels = _spectra(field, path)
    fastest = float(np.abs(spectra).max(initial=0.0))
    rest = equilibrium(field, path)
    where = "median along the trajectory of the training"
    if rest is not None:
        spectra, levels = _spectra(field, rest[None])
        values = (f"{state.name} = {value:.6g}" for state, value in zip(run.states, rest, strict=True))
        where = f"at the equilibrium {', '.join(values)}"
    found = targets_of_spectra(without_rounding(spectra, levels), levels)
    count = int(np.median(found.pairs)) if found.pairs.size else 0
    rows = found.pairs == count
    if count == 0 or not rows.any():
        return (), where, fastest
    frequency, damping = (np.median(part[rows, :count], axis=0).tolist() for part in (found.frequency, found.damping))
    return tuple(zip(frequency, damping, strict=True)), where, fastest


def _spectra(field: ScaledField, states: Floats) -> tuple[Complexes, Floats]:
    """Return the eigenvalues `(D, n)` in 1/s where the Jacobian is finite, and their rounding levels `(D,)`."""
    with torch.no_grad():
        method = "symbolic" if field.has_symbolic_jacobian else "autodiff"
        matrices = jacobian(field, torch.from_numpy(states), method)
        matrices = matrices[torch.isfinite(matrices).all(dim=-1).all(dim=-1)]
        values = eigvals(matrices)[0].numpy()
    return values, rounding_levels(matrices.numpy())
