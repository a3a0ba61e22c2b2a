"""A vector field in the user's units around one in internal units."""

import torch
from torch import Tensor, nn

from eigenode_cli.data.scaling import Scaling
from eigenode_cli.model.vector_field import VectorField


class ScaledField(nn.Module):
    """`dx/dt = X/T f(x/X, u/U)` for a field f in internal units: X of the states, U of the inputs, T of the time in s.

    Args:
        field: in internal units.
        scaling: these units.
    """

    def __init__(self, field: VectorField, scaling: Scaling) -> None:
        super().__init__()
        self.field = field
        self.inputs, self.has_symbolic_jacobian = field.inputs, field.has_symbolic_jacobian
        self.time = scaling.time
        self.register_buffer("states", torch.from_numpy(scaling.states), persistent=False)
        self.register_buffer("driven", torch.from_numpy(scaling.inputs), persistent=False)

    states: Tensor
    driven: Tensor

    def forward(self, x: Tensor, u: Tensor | None = None) -> Tensor:
        """Return the derivative `(..., n)` at the states `x (..., n)` and the inputs `u (..., k)`, None for zero."""
        rates = self.field(x / self.states, None if u is None else u / self.driven)
        return rates * (self.states / self.time)

    def jacobian(self, x: Tensor, u: Tensor | None = None) -> Tensor:
        """Return `A = df/dx (..., n, n)` in 1/s in closed form; only where `has_symbolic_jacobian`."""
        matrix = self.field.jacobian(x / self.states, None if u is None else u / self.driven)
        return matrix * self.states[:, None] / self.states / self.time
