"""The learned vector field: how a network's output becomes dx/dt."""

import torch
from torch import Tensor, nn


class VectorField(nn.Module):
    """`dx/dt = f(x; theta)` for states `(..., n)`.

    Args:
        network: maps states `(..., n)` to outputs `(..., n/2)` for the structure `second_order`, `(..., n)` for `full`.
        structure: `second_order`: the state is (positions, velocities), the velocities are passed through and the
            network gives the accelerations; `full`: the network gives every derivative.
    """

    def __init__(self, network: nn.Module, structure: str) -> None:
        super().__init__()
        self.network = network
        self.structure = structure

    def forward(self, x: Tensor) -> Tensor:
        """State derivative `(..., n)` at the states `x (..., n)`."""
        outputs = self.network(x)
        if self.structure == "full":
            return outputs
        return torch.cat([x[..., x.shape[-1] // 2 :], outputs], dim=-1)

    @property
    def has_symbolic_jacobian(self) -> bool:
        """Whether the network offers its Jacobian in closed form."""
        return hasattr(self.network, "jacobian")

    def jacobian(self, x: Tensor) -> Tensor:
        """`A = df/dx (..., n, n)` in closed form; only where `has_symbolic_jacobian`."""
        rows = self.network.jacobian(x)  # type: ignore[operator]  # nn.Module attributes are untyped
        if self.structure == "full":
            return rows
        n = x.shape[-1]
        upper = torch.eye(n, dtype=x.dtype)[n // 2 :].expand(*x.shape[:-1], n // 2, n)
        return torch.cat([upper, rows], dim=-2)
