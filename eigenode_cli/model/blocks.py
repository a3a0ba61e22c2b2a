"""The parameter vector `theta`: named blocks, one behind the other."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from torch import nn

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.reconstruct import Estimate
from eigenode_cli.model.vector_field import VectorField

NETWORK, LINEAR, INITIAL_STATE, OFFSET = "network", "linear", "initial_state", "offset"
BLOCKS = (NETWORK, LINEAR, INITIAL_STATE, OFFSET)
"""Names of the blocks in the order of theta."""


def block_slices(field: VectorField, series: Sequence[Series]) -> dict[str, slice]:
    """Return where each block that there is stands in theta.

    Args:
        field: the vector field: blocks `network` and, where it has one, `linear`.
        series: measured trajectories: block `initial_state`, the unknown entries of the initial states of one after
            another, and block `offset`, the offsets of their channels in the same order.
    """
    sizes = {
        NETWORK: _size(field.network),
        LINEAR: 0 if field.linear is None else _size(field.linear),
        INITIAL_STATE: sum(one.unknown.size for one in series),
        OFFSET: sum(one.offsets.size for one in series),
    }
    slices, start = {}, 0
    for name, size in sizes.items():
        if size > 0:
            slices[name] = slice(start, start + size)
        start += size
    return slices


def trained_mask(slices: Mapping[str, slice], names: Sequence[str]) -> NDArray[np.bool_]:
    """Return which parameters `(P,)` the blocks of these names hold.

    Raises:
        ValueError: a name is none of the blocks that there are.
    """
    if absent := [name for name in names if name not in slices]:
        raise ValueError(f"{', '.join(absent)}: not of the blocks {', '.join(slices)}")
    mask = np.zeros(max(part.stop for part in slices.values()), dtype=np.bool_)
    for name in names:
        mask[slices[name]] = True
    return mask


def _size(module: nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def own_parameters(size: int, series: Sequence[Series]) -> list[tuple[Integers, Integers]]:
    """Return where in theta `(P,)` each trajectory has its unknown initial values, and where its offsets.

    Args:
        size: P, the parameters of the field and of all trajectories.
        series: all trajectories, in order.
    """
    unknown, offsets = [one.unknown.size for one in series], [one.offsets.size for one in series]
    first = size - sum(unknown) - sum(offsets)
    initial = np.split(np.arange(first, first + sum(unknown)), np.cumsum(unknown)[:-1])
    offset = np.split(np.arange(first + sum(unknown), size), np.cumsum(offsets)[:-1])
    return list(zip(initial, offset, strict=True))


def with_own_parameters(theta: Floats, series: Sequence[Series], estimates: Sequence[Estimate]) -> Floats:
    """Return the parameters of a vector field with first guesses of those of the trajectories behind them.

    Args:
        theta: parameters of the field.
        series: measured trajectories, one after another.
        estimates: what is known of the states of each.

    Returns:
        Parameters `(P,)`: those of the field, all unknown initial values, all offsets.
    """
    guesses = [np.nan_to_num(found.states[0])[one.unknown] for one, found in zip(series, estimates, strict=True)]
    offsets = [found.offsets[one.offsets] for one, found in zip(series, estimates, strict=True)]
    return np.concatenate([theta, *guesses, *offsets])
