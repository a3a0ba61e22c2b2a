"""Multilayer perceptron of any depth, with scaled input and output."""

from itertools import pairwise
from typing import Self, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from eigenode_cli.config.schema import MlpConfig
from eigenode_cli.field.activations import ACTIVATIONS
from eigenode_cli.field.init import INITS


class Mlp(nn.Module):
    """`y = output_scale * (W_L act(... act(W_0 (input_scale * x) + b_0) ...) + b_L)`, float64.

    Args:
        config: hidden widths, activation, initialisation.
        inputs, outputs: dimensions n and m.
        input_scale, output_scale: factors `(n,)` and `(m,)`, or None for none; kept in the state_dict where given.
        generator: source of the initial weights.
    """

    input_scale: Tensor | None
    output_scale: Tensor | None

    def __init__(
        self,
        config: MlpConfig,
        inputs: int,
        outputs: int,
        input_scale: Tensor | None,
        output_scale: Tensor | None,
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        sizes = [inputs, *config.hidden, outputs]
        self.layers = nn.ModuleList(nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes))
        self.activation = config.activation
        self._act, self._slope = ACTIVATIONS[config.activation]
        self.register_buffer("input_scale", input_scale)
        self.register_buffer("output_scale", output_scale)
        for layer in self._linear:
            INITS[config.init](layer, config.activation, generator)

    @property
    def _linear(self) -> list[nn.Linear]:
        return cast(list[nn.Linear], list(self.layers))

    @classmethod
    def build(
        cls,
        config: MlpConfig,
        states: NDArray[np.float64],
        outputs: NDArray[np.float64],
        generator: torch.Generator,
    ) -> Self:
        """The network for known inputs `states (N, n)` and `outputs (N, m)`; their ranges give the scales."""
        return cls(
            config,
            states.shape[1],
            outputs.shape[1],
            1.0 / _largest(states) if config.input_scaling == "max_abs" else None,
            _largest(outputs) if config.output_scaling == "max_abs" else None,
            generator,
        )

    @property
    def sizes(self) -> tuple[int, ...]:
        """Dimensions of input, hidden layers and output."""
        return (self._linear[0].in_features, *(layer.out_features for layer in self._linear))

    def forward(self, x: Tensor) -> Tensor:
        """Outputs `(..., m)` at inputs `x (..., n)`."""
        u = x if self.input_scale is None else x * self.input_scale
        for layer in self._linear[:-1]:
            u = self._act(layer(u))
        y = self._linear[-1](u)
        return y if self.output_scale is None else y * self.output_scale

    def jacobian(self, x: Tensor) -> Tensor:
        """`dy/dx (..., m, n)` at inputs `x (..., n)` by the chain rule written out, differentiable."""
        u = x if self.input_scale is None else x * self.input_scale
        chain = torch.eye(x.shape[-1], dtype=x.dtype).expand(*x.shape, x.shape[-1])
        if self.input_scale is not None:
            chain = chain * self.input_scale
        for layer in self._linear[:-1]:
            z = layer(u)
            u = self._act(z)
            chain = self._slope(z).unsqueeze(-1) * (layer.weight @ chain)
        chain = self._linear[-1].weight @ chain
        return chain if self.output_scale is None else self.output_scale.unsqueeze(-1) * chain


def _largest(samples: NDArray[np.float64]) -> Tensor:
    """Largest modulus of each column of `samples (N, k)`; 1 for a column of zeros."""
    size = np.abs(samples).max(axis=0)
    return torch.from_numpy(np.where(size > 0.0, size, 1.0))
