"""The terms as torch functions: the compiled kernels with their slopes, differentiable in reverse and forward mode."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import Targets
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.sol import sol
from eigenode_cli.terms.spectral import spectral_terms


class _Linearised(torch.autograd.Function):
    """A vector of values whose slopes were computed along with them: `values (L,)`, `slopes (L, *shape of x)`.

    The derivative of value l in direction dx is `Re sum conj(slopes[l]) dx`.
    """

    @staticmethod
    def forward(x: Tensor, values: Tensor, slopes: Tensor) -> Tensor:
        del x, slopes
        return values.clone()

    @staticmethod
    def setup_context(ctx: FunctionCtx, inputs: tuple[Any, ...], output: Tensor) -> None:
        del output
        ctx.save_for_backward(inputs[2])
        ctx.save_for_forward(inputs[2])

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *grad_outputs: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        (slopes,), (grad,) = ctx.saved_tensors, grad_outputs
        return torch.tensordot(grad.to(slopes.dtype), slopes, dims=1), None, None

    @staticmethod
    def jvp(ctx: Any, *grad_inputs: Tensor | None) -> Tensor:
        (slopes,), dx = ctx.saved_tensors, grad_inputs[0]
        return (slopes.conj() * dx).flatten(1).sum(1).real.clone()


def solution_term(shown: Tensor, data: Series, error: int, huber_delta: float) -> Tensor:
    """SOL of what the model says of the channels `(N, C)`, a scalar."""
    trajectory = shown.detach().numpy()
    slope = np.empty_like(trajectory)
    value = sol(trajectory, data.channels, data.channel_mask, error, huber_delta, slope)
    return _Linearised.apply(shown, torch.tensor([value], dtype=torch.float64), torch.from_numpy(slope[None]))[0]


def spectral_values(
    spectra: Tensor,
    terms: Sequence[str],
    targets: Targets,
    margin: float,
    errors: np.ndarray,
    huber_delta: float,
    levels: np.ndarray | None = None,
    recorded: bool = False,
) -> Tensor:
    """Return the named spectral terms `(L,)` of `spectra (T, n)` in 1/s; arguments as in `spectral_terms`.

    Args:
        levels: rounding levels `(T,)` in 1/s; None for spectra that are exact.
        recorded: whether a term that has nothing to compare is NaN, as it is recorded, not zero, as it trains.
    """
    eigenvalues = np.ascontiguousarray(spectra.detach().resolve_conj().numpy())
    count, n = eigenvalues.shape
    values = np.empty(len(terms))
    slopes = np.empty((len(terms), count, n), dtype=np.complex128)
    compared = np.empty(len(terms), dtype=np.int64)
    space = np.empty((2, n), dtype=np.int64)
    counted = spectral_terms(
        np.array([NAMES.index(term) for term in terms], dtype=np.int64),
        eigenvalues,
        np.zeros(count) if levels is None else levels,
        targets.arrays,
        margin,
        errors,
        huber_delta,
        values,
        slopes,
        compared,
        (space[0], space[1]),
    )
    if counted == 0:
        values[:] = np.nan
    elif recorded:
        values[compared == 0] = np.nan
    return _Linearised.apply(spectra, torch.from_numpy(values), torch.from_numpy(slopes))
