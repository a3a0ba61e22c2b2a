"""Initial weights of a multilayer perceptron."""

import math
from collections.abc import Callable

import torch
from torch import nn

GAINS = {"tanh": 5.0 / 3.0, "relu": math.sqrt(2.0)}
"""Gain of the Kaiming initialisation for an activation (1 for the others), as in torch.nn.init.calculate_gain."""


def glorot(layer: nn.Linear, activation: str, generator: torch.Generator | None) -> None:
    """Uniform in +-sqrt(6 / (in + out)), zero biases (Glorot & Bengio 2010, Equ. 16); cited by the paper."""
    del activation
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)


def uniform01(layer: nn.Linear, activation: str, generator: torch.Generator | None) -> None:
    """Uniform in [0, 1), zero biases: what the authors' first code did."""
    del activation
    nn.init.uniform_(layer.weight, 0.0, 1.0, generator=generator)
    nn.init.zeros_(layer.bias)


def kaiming(layer: nn.Linear, activation: str, generator: torch.Generator | None) -> None:
    """Uniform in +-gain sqrt(3 / in) (He et al. 2015), biases uniform in +-1 / sqrt(in)."""
    fan_in = layer.in_features
    bound = GAINS.get(activation, 1.0) * math.sqrt(3.0 / fan_in)
    nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
    nn.init.uniform_(layer.bias, -1.0 / math.sqrt(fan_in), 1.0 / math.sqrt(fan_in), generator=generator)


INITS: dict[str, Callable[[nn.Linear, str, torch.Generator | None], None]] = {
    "glorot": glorot,
    "uniform01": uniform01,
    "kaiming": kaiming,
}
"""Initialisations by name; each fills one layer."""
