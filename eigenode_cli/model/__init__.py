"""The learned vector field: networks, initial weights, scalings and structures."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from eigenode_cli.model.mlp import Mlp
from eigenode_cli.model.polynomial import Polynomial
from eigenode_cli.model.vector_field import VectorField

Floats = NDArray[np.float64]


def flat_parameters(module: nn.Module) -> Floats:
    """All parameters in the module's order as one vector `(P,)`, a copy."""
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy().copy()


def load_flat(module: nn.Module, theta: Floats) -> None:
    """Write the vector `theta (P,)` into the module's parameters."""
    torch.nn.utils.vector_to_parameters(torch.from_numpy(np.array(theta, dtype=np.float64)), module.parameters())


__all__ = ["Mlp", "Polynomial", "VectorField", "flat_parameters", "load_flat"]
