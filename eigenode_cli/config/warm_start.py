"""Warm start: a run that begins with the weights of another one."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import build_field
from eigenode_cli.config.outline import shape_of
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.data.scaling import Scaling
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.runs.checkpoints import checkpoint_path, load_checkpoint

LINEAR, INITIAL_STATE, OFFSET = "linear", "initial_state", "offset"


def empty_field(config: TrainConfig) -> VectorField:
    """Return a vector field with the shapes of the configuration, whose parameters and scales are yet to be loaded."""
    n, k = shape_of(config.system)
    states, inputs = np.ones((1, n)), np.ones((1, k))
    return build_field(config.network, states, states, config.seed, inputs=inputs)


def load_field(field: VectorField, text: str, step: int | None = None) -> dict[str, Floats]:
    """Put the weights of a checkpoint into a field, in place; returns its other blocks: initial states, offsets.

    Args:
        field: with the shapes of the checkpoint; a linear part that the checkpoint lacks stays as it is.
        text: a run or a checkpoint, as the user typed it.
        step: see `checkpoint_path`.

    Raises:
        UserError: there is no such checkpoint.
        ValueError: it does not go with the field; the message names what is different.
    """
    tensors = load_checkpoint(checkpoint_path(text, step))
    linear = tensors.pop(LINEAR, None)
    own = {name: tensors.pop(name).numpy().copy() for name in (INITIAL_STATE, OFFSET) if name in tensors}
    expected = field.network.state_dict()
    for name in sorted({*expected, *tensors}):
        there, here = (tuple(found[name].shape) if name in found else "none" for found in (tensors, expected))
        if there != here:
            raise ValueError(f"{name} has the shape {there} there, {here} here")
    if linear is not None and (field.linear is None or field.linear.weight.shape != linear.shape):
        raise ValueError("it has a linear part; write network.linear=zero")
    field.network.load_state_dict(tensors)
    if linear is not None and field.linear is not None:
        field.linear.load_state_dict({"weight": linear})
    return own


def recorded_scaling(record: Mapping[str, Any], config: TrainConfig) -> Scaling:
    """Return the internal units of a run, from its run.json; ones where the data were simulated."""
    units = record.get("system", {}).get("scaling")
    if units is None:
        return Scaling.none(*shape_of(config.system))
    return Scaling(float(units["time"]), np.array(units["states"]), np.array(units["inputs"]))


def started_from(
    config: TrainConfig, states: Sequence[str], trained: Mapping[str, Floats], scaling: Scaling, trajectory: int = 0
) -> Floats:
    """Return the state `(n,)` that a model starts from: what is known, and trained values of the rest.

    Args:
        config: of its run.
        states: their names.
        trained: blocks beside the field's that `load_field` returned.
        scaling: internal units.
        trajectory: which one of several.

    Raises:
        ValueError: there is no such trajectory.
    """
    system, values = config.system, trained.get(INITIAL_STATE, np.empty(0))
    if isinstance(system, TableConfig):
        own = values[len(states) * trajectory : len(states) * (trajectory + 1)]
        if own.size != len(states):
            raise ValueError(f"trajectory {trajectory}: there are {values.size // len(states)}")
        return own * scaling.states
    start, known = np.array(system.initial_state), system.initial_known
    if known is not None and values.size:
        start[[name not in known for name in states]] = values
    return start


def warm_start(text: str, field: VectorField, theta: Floats) -> Floats:
    """Return parameters `(P,)` with the weights of `text` in place of the leading ones of `theta`, and in `field`."""
    own = load_field(field, text)
    weights = flat_parameters(field)
    rest, saved = theta[weights.size :], np.concatenate([np.empty(0), *own.values()])
    return np.concatenate([weights, saved if saved.shape == rest.shape else rest])
