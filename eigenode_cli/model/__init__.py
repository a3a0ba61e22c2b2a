"""The learned vector field: networks, initial weights, scalings and structures."""

import numpy as np
import torch
from torch import nn

from eigenode_cli.arrays import Floats
from eigenode_cli.model.blocks import BLOCKS, block_slices, own_parameters, trained_mask, with_own_parameters
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.model.polynomial import Polynomial
from eigenode_cli.model.vector_field import VectorField, held


def flat_parameters(module: nn.Module) -> Floats:
    """All parameters in the module's order as one vector `(P,)`, a copy."""
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy().copy()


def scale_output(network: nn.Module, gain: float) -> None:
    """Multiply the last parameters of a network that is linear in them, weight and bias, by a factor.

    Raises:
        ValueError: it has no parameters.
    """
    layers = [module for module in network.modules() if next(module.parameters(recurse=False), None) is not None]
    if not layers:
        raise ValueError("the network has no parameters")
    with torch.no_grad():
        for parameter in layers[-1].parameters(recurse=False):
            parameter.mul_(gain)


def load_flat(module: nn.Module, theta: Floats) -> None:
    """Write the leading entries of the vector `theta (P,)`, as many as the module has, into its parameters."""
    torch.nn.utils.vector_to_parameters(torch.from_numpy(np.array(theta, dtype=np.float64)), module.parameters())


__all__ = [
    "BLOCKS",
    "Mlp",
    "Polynomial",
    "VectorField",
    "block_slices",
    "flat_parameters",
    "held",
    "load_flat",
    "own_parameters",
    "scale_output",
    "trained_mask",
    "with_own_parameters",
]
