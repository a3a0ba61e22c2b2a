"""The learned vector field: how a network's output, and a linear part beside it, become dx/dt."""

import torch
from torch import Tensor, nn


class VectorField(nn.Module):
    """`dx/dt = f(x; theta)` for states `(..., n)`.

    Args:
        network: maps states `(..., n)` to outputs `(..., m)`: m = n/2 for the structure `second_order`, n for `full`.
        structure: `second_order`: the state is (positions, velocities), the velocities are passed through and the
            outputs are the accelerations; `full`: the outputs are every derivative.
        linear: initial matrix `(m, n)` of a learned linear part, whose product with the state is added to the network's
            output; None for none. Parameters: first those of the network, then this matrix row by row.
    """

    def __init__(self, network: nn.Module, structure: str = "second_order", linear: Tensor | None = None) -> None:
        super().__init__()
        self.network = network
        self.structure = structure
        self.linear: nn.Linear | None = None
        if linear is not None:  # a module of its own: its parameters then follow those of the network
            self.linear = nn.Linear(linear.shape[1], linear.shape[0], bias=False, dtype=torch.float64)
            with torch.no_grad():
                self.linear.weight[:] = linear

    def forward(self, x: Tensor) -> Tensor:
        """Return the state derivative `(..., n)` at the states `x (..., n)`."""
        outputs = self.network(x)
        if self.linear is not None:
            outputs = outputs + self.linear(x)
        if self.structure == "full":
            return outputs
        return torch.cat([x[..., x.shape[-1] // 2 :], outputs], dim=-1)

    @property
    def has_symbolic_jacobian(self) -> bool:
        """Whether the network offers its Jacobian in closed form."""
        return hasattr(self.network, "jacobian")

    def jacobian(self, x: Tensor) -> Tensor:
        """Return `A = df/dx (..., n, n)` in closed form; only where `has_symbolic_jacobian`."""
        rows = self.network.jacobian(x)  # type: ignore[operator]  # nn.Module attributes are untyped
        if self.linear is not None:
            rows = rows + self.linear.weight
        if self.structure == "full":
            return rows
        n = x.shape[-1]
        upper = torch.eye(n, dtype=x.dtype)[n // 2 :].expand(*x.shape[:-1], n // 2, n)
        return torch.cat([upper, rows], dim=-2)
