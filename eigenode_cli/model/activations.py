"""Activations of a multilayer perceptron by name, with the derivative that the symbolic Jacobian needs."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional


def _sigmoid_slope(z: Tensor) -> Tensor:
    s = torch.sigmoid(z)
    return s * (1.0 - s)


def _softplus(z: Tensor) -> Tensor:
    return functional.softplus(z, threshold=700.0)  # by default it becomes the identity beyond 20


def _silu_slope(z: Tensor) -> Tensor:
    s = torch.sigmoid(z)
    return s * (1.0 + z * (1.0 - s))


def _elu_slope(z: Tensor) -> Tensor:
    return torch.where(z > 0.0, torch.ones_like(z), torch.exp(torch.clamp(z, max=0.0)))


ACTIVATIONS: dict[str, tuple[Callable[[Tensor], Tensor], Callable[[Tensor], Tensor]]] = {
    "tanh": (torch.tanh, lambda z: 1.0 - torch.tanh(z) ** 2),
    "sigmoid": (torch.sigmoid, _sigmoid_slope),
    "relu": (torch.relu, lambda z: (z > 0.0).to(z)),
    "softplus": (_softplus, torch.sigmoid),
    "silu": (functional.silu, _silu_slope),
    "elu": (functional.elu, _elu_slope),
    "sin": (torch.sin, torch.cos),
    "identity": (lambda z: z, torch.ones_like),
}
"""Name to (value, derivative)."""
