"""Multilayer perceptron of any depth, with scaled input and output."""

from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn

from eigenode_cli.model.activations import ACTIVATIONS
from eigenode_cli.model.init import INITS


class Mlp(nn.Module):
    """`y = output_scale * (W_L act(... act(W_0 (input_scale * x) + b_0) ...) + b_L)`, float64.

    Args:
        inputs: dimension n.
        hidden: width of each hidden layer.
        outputs: dimension m.
        activation: of the hidden layers, one of `ACTIVATIONS`.
        init: initial weights, one of `INITS`.
        input_scale: factors `(n,)`, or None for none; kept in the state_dict where given.
        output_scale: factors `(m,)`, or None for none; kept in the state_dict where given.
        generator: source of the initial weights; torch's global one where it is None.
    """

    input_scale: Tensor | None
    output_scale: Tensor | None

    def __init__(
        self,
        inputs: int,
        hidden: Sequence[int] = (32,),
        outputs: int = 1,
        activation: str = "tanh",
        init: str = "glorot",
        input_scale: Tensor | None = None,
        output_scale: Tensor | None = None,
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__()
        sizes = [inputs, *hidden, outputs]
        self.layers = nn.ModuleList(nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes))
        self.activation = activation
        self._act, self._slope = ACTIVATIONS[activation]
        self.register_buffer("input_scale", input_scale)
        self.register_buffer("output_scale", output_scale)
        for layer in self._linear:
            INITS[init](layer, activation, generator)

    @property
    def _linear(self) -> list[nn.Linear]:
        return cast(list[nn.Linear], list(self.layers))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Dimensions of input, hidden layers and output."""
        return (self._linear[0].in_features, *(layer.out_features for layer in self._linear))

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs `(..., m)` at inputs `x (..., n)`."""
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
