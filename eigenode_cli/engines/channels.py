"""What a trajectory of the model shows of the measured channels."""

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.model import VectorField, held, load_flat


def shown_channels(field: VectorField, series: Series, states: Floats, offsets: Floats, theta: Floats) -> Floats:
    """Return the channels `(N, C)` at the model's states.

    Args:
        field: the vector field, whose parameters become those of `theta`.
        series: says which channels there are, and has the inputs.
        states: of the model at the data times `(N, n)`.
        offsets: of the channels `(C,)`.
        theta: parameters `(P,)`.
    """
    if series.rates is None:
        return states + offsets
    load_flat(field, theta)
    with torch.no_grad():
        rates = held(field, torch.from_numpy(series.driven))(torch.from_numpy(np.nan_to_num(states))).numpy()
    rates = np.where(np.isfinite(states).all(axis=1, keepdims=True), rates, np.nan)
    return np.hstack([states, rates]) + offsets
