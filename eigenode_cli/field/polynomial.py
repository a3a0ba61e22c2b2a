"""Polynomial network: every monomial of the states up to a degree, with learned coefficients."""

from itertools import combinations_with_replacement
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from eigenode_cli.config.schema import PolynomialConfig


class Polynomial(nn.Module):
    """`y_k = sum_a c_ka x^a` over all multi-indices a with |a| <= degree, float64.

    It grows faster than linearly, so an unlucky draw blows up in finite time: no network shows the need for
    stabilisation more plainly.

    Args:
        config: degree and spread of the initial coefficients.
        inputs, outputs: dimensions n and m.
        generator: source of the initial coefficients.
    """

    exponents: Tensor

    def __init__(self, config: PolynomialConfig, inputs: int, outputs: int, generator: torch.Generator) -> None:
        super().__init__()
        rows = [
            [monomial.count(i) for i in range(inputs)]
            for degree in range(config.degree + 1)
            for monomial in combinations_with_replacement(range(inputs), degree)
        ]
        self.register_buffer("exponents", torch.tensor(rows, dtype=torch.int64), persistent=False)
        draw = torch.rand((outputs, len(rows)), generator=generator, dtype=torch.float64)
        self.coefficients = nn.Parameter((2.0 * draw - 1.0) * config.spread)

    @classmethod
    def build(
        cls,
        config: PolynomialConfig,
        states: NDArray[np.float64],
        outputs: NDArray[np.float64],
        generator: torch.Generator,
    ) -> Self:
        """The network for known inputs `states (N, n)` and `outputs (N, m)`, of which only the widths matter."""
        return cls(config, states.shape[1], outputs.shape[1], generator)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs `(..., m)` at inputs `x (..., n)`."""
        # repeated products, not x**k: the second derivative of the latter is NaN at 0
        powers = [torch.ones_like(x)]
        for _ in range(int(self.exponents.max())):
            powers.append(powers[-1] * x)
        by_state = torch.stack(powers, dim=-1)
        monomials = torch.ones_like(x[..., :1])
        for i in range(x.shape[-1]):
            monomials = monomials * by_state[..., i, :][..., self.exponents[:, i]]
        return monomials @ self.coefficients.T
