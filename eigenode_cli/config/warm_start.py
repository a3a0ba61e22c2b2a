"""Warm start: a run that begins with the weights of another one."""

from collections.abc import Sequence

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import build_field
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.runs.checkpoints import checkpoint_path, load_checkpoint

LINEAR, INITIAL_STATE = "linear", "initial_state"


def empty_field(config: TrainConfig) -> VectorField:
    """Return a vector field with the shapes of the configuration, whose parameters and scales are yet to be loaded."""
    states = np.ones((1, len(config.system.initial_state)))
    return build_field(config.network, states, states, config.seed)


def load_field(field: VectorField, text: str, step: int | None = None) -> Floats | None:
    """Put the weights of a checkpoint into a field, in place; returns the trained entries of the initial state.

    Args:
        field: with the shapes of the checkpoint; a linear part that the checkpoint lacks stays as it is.
        text: a run or a checkpoint, as the user typed it.
        step: see `checkpoint_path`.

    Raises:
        UserError: there is no such checkpoint.
        ValueError: it does not go with the field; the message names what is different.
    """
    tensors = load_checkpoint(checkpoint_path(text, step))
    linear, initial = tensors.pop(LINEAR, None), tensors.pop(INITIAL_STATE, None)
    own = field.network.state_dict()
    for name in sorted({*own, *tensors}):
        there, here = (tuple(found[name].shape) if name in found else "none" for found in (tensors, own))
        if there != here:
            raise ValueError(f"{name} has the shape {there} there, {here} here")
    if linear is not None and (field.linear is None or field.linear.weight.shape != linear.shape):
        raise ValueError("it has a linear part; write network.linear=zero")
    field.network.load_state_dict(tensors)
    if linear is not None and field.linear is not None:
        field.linear.load_state_dict({"weight": linear})
    return None if initial is None else initial.numpy().copy()


def started_from(config: TrainConfig, states: Sequence[str], trained: Floats | None) -> Floats:
    """Return the state `(n,)` that a model starts from: what is known, and trained values of the rest.

    Args:
        config: of its run.
        states: their names.
        trained: values of the states that are not known, None where all are.
    """
    start, known = np.array(config.system.initial_state), config.system.initial_known
    if known is not None and trained is not None:
        start[[name not in known for name in states]] = trained
    return start


def warm_start(text: str, field: VectorField, theta: Floats) -> Floats:
    """Return parameters `(P,)` with the weights of `text` in place of the leading ones of `theta`, and in `field`."""
    initial = load_field(field, text)
    weights = flat_parameters(field)
    rest = theta[weights.size :]
    return np.concatenate([weights, initial if initial is not None and initial.shape == rest.shape else rest])
