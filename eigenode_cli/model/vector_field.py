"""The learned vector field: how a network's output, and a linear part beside it, become dx/dt."""

from collections.abc import Callable

import torch
from torch import Tensor, nn


class VectorField(nn.Module):
    """`dx/dt = f(x, u; theta)` for states `(..., n)` and inputs `(..., k)`.

    Args:
        network: maps states and inputs `(..., n + k)` to outputs `(..., m)`: m = n/2 for the structure `second_order`,
            n for `full`.
        structure: `second_order`: the state is (positions, velocities), the velocities are passed through and the
            outputs are the accelerations; `full`: the outputs are every derivative.
        linear: initial matrix `(m, n + k)` of a learned linear part, whose product with states and inputs is added to
            the network's output; None for none. Parameters: first those of the network, then this matrix row by row.
        inputs: number k of the inputs.
    """

    def __init__(
        self, network: nn.Module, structure: str = "second_order", linear: Tensor | None = None, inputs: int = 0
    ) -> None:
        super().__init__()
        self.inputs = inputs
        self.network = network
        self.structure = structure
        self.linear: nn.Linear | None = None
        if linear is not None:  # a module of its own: its parameters then follow those of the network
            self.linear = nn.Linear(linear.shape[1], linear.shape[0], bias=False, dtype=torch.float64)
            with torch.no_grad():
                self.linear.weight[:] = linear

    def forward(self, x: Tensor, u: Tensor | None = None) -> Tensor:
        """Return the derivative `(..., n)` at the states `x (..., n)` and the inputs `u (..., k)`, None for zero."""
        z = self._arguments(x, u)
        outputs = self.network(z)
        if self.linear is not None:
            outputs = outputs + self.linear(z)
        if self.structure == "full":
            return outputs
        return torch.cat([x[..., x.shape[-1] // 2 :], outputs], dim=-1)

    @property
    def has_symbolic_jacobian(self) -> bool:
        """Whether the network offers its Jacobian in closed form."""
        return hasattr(self.network, "jacobian")

    def _arguments(self, x: Tensor, u: Tensor | None) -> Tensor:
        if self.inputs == 0:
            return x
        return torch.cat([x, x.new_zeros(*x.shape[:-1], self.inputs) if u is None else u], dim=-1)

    def jacobian(self, x: Tensor, u: Tensor | None = None) -> Tensor:
        """Return `A = df/dx (..., n, n)` in closed form; only where `has_symbolic_jacobian`."""
        rows = self.network.jacobian(self._arguments(x, u))  # type: ignore[operator]  # nn.Module attributes are untyped
        if self.linear is not None:
            rows = rows + self.linear.weight
        rows = rows[..., : x.shape[-1]]
        if self.structure == "full":
            return rows
        n = x.shape[-1]
        upper = torch.eye(n, dtype=x.dtype)[n // 2 :].expand(*x.shape[:-1], n // 2, n)
        return torch.cat([upper, rows], dim=-2)


class _Held:
    """A field of the states alone: the inputs stay as they are."""

    def __init__(self, field: VectorField, inputs: Tensor) -> None:
        self._field, self._inputs = field, inputs
        self.has_symbolic_jacobian = field.has_symbolic_jacobian

    def _beside(self, x: Tensor) -> Tensor:
        u = self._inputs
        while u.dim() < x.dim():  # several copies of each state
            u = u.unsqueeze(-2)
        return u.expand(*x.shape[:-1], u.shape[-1])

    def __call__(self, x: Tensor) -> Tensor:
        return self._field(x, self._beside(x))

    def jacobian(self, x: Tensor) -> Tensor:
        return self._field.jacobian(x, self._beside(x))


def held(field: VectorField, inputs: Tensor) -> Callable[[Tensor], Tensor]:
    """Return `x -> f(x, u)` with the inputs `u (..., k)` of each state held; the field itself where there are none."""
    return field if field.inputs == 0 else _Held(field, inputs)
