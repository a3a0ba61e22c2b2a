"""The learned vector field: networks, initial weights, scalings and structures."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from eigenode_cli.config.schema import NetworkConfig
from eigenode_cli.field.mlp import Mlp
from eigenode_cli.field.polynomial import Polynomial
from eigenode_cli.field.vector_field import VectorField

Floats = NDArray[np.float64]

NETWORKS: dict[str, type[Any]] = {"mlp": Mlp, "polynomial": Polynomial}
"""Networks by the name that `network.name` holds; each is built from its own configuration class."""


def build_field(config: NetworkConfig, states: Floats, rates: Floats, seed: int) -> VectorField:
    """The vector field, its network's initial weights drawn from `seed`.

    Args:
        config: the configuration of one of the `NETWORKS`.
        states, rates: known states and their derivatives `(N, n)`; scalings are taken from them.
        seed: of the initial weights; nothing else enters the draw, so that runs of one seed are paired.
    """
    n = states.shape[1]
    outputs = n // 2 if config.structure == "second_order" else n
    generator = torch.Generator().manual_seed(seed)
    network = NETWORKS[config.name].build(config, states, rates[:, n - outputs :], generator)
    return VectorField(network, config.structure)


def flat_parameters(module: nn.Module) -> Floats:
    """All parameters in the module's order as one vector `(P,)`, a copy."""
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy().copy()


def load_flat(module: nn.Module, theta: Floats) -> None:
    """Write the vector `theta (P,)` into the module's parameters."""
    torch.nn.utils.vector_to_parameters(torch.from_numpy(np.array(theta, dtype=np.float64)), module.parameters())


__all__ = ["NETWORKS", "VectorField", "build_field", "flat_parameters", "load_flat"]
