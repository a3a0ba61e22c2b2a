"""Polynomial network: every monomial of the states up to a degree, with learned coefficients."""

from itertools import combinations_with_replacement

import torch
from torch import Tensor, nn


class Polynomial(nn.Module):
    """`y_k = sum_a c_ka x^a` over all multi-indices a with |a| <= degree, float64.

    It grows faster than linearly, so an unlucky draw blows up in finite time: no network shows the need for
    stabilisation more plainly.

    Args:
        inputs: dimension n.
        outputs: dimension m.
        degree: largest total degree of a monomial.
        spread: initial coefficients are uniform in [-spread, spread].
        generator: source of the initial coefficients; torch's global one where it is None.
    """

    exponents: Tensor

    def __init__(
        self, inputs: int, outputs: int, degree: int = 3, spread: float = 0.1, generator: torch.Generator | None = None
    ) -> None:
        super().__init__()
        rows = [
            [monomial.count(i) for i in range(inputs)]
            for degree in range(degree + 1)
            for monomial in combinations_with_replacement(range(inputs), degree)
        ]
        self.register_buffer("exponents", torch.tensor(rows, dtype=torch.int64), persistent=False)
        draw = torch.rand((outputs, len(rows)), generator=generator, dtype=torch.float64)
        self.coefficients = nn.Parameter((2.0 * draw - 1.0) * spread)

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs `(..., m)` at inputs `x (..., n)`."""
        # repeated products, not x**k: the second derivative of the latter is NaN at 0
        powers = [torch.ones_like(x)]
        for _ in range(int(self.exponents.max())):
            powers.append(powers[-1] * x)
        by_state = torch.stack(powers, dim=-1)
        monomials = torch.ones_like(x[..., :1])
        for i in range(x.shape[-1]):
            monomials = monomials * by_state[..., i, :][..., self.exponents[:, i]]
        return monomials @ self.coefficients.T
