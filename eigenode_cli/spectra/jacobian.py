"""`A = df/dx` of a vector field, by three methods, each differentiable in the states and the field's parameters."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.func import vjp

Field = Callable[[Tensor], Tensor]
"""A vector field `(..., n) -> (..., n)`, a torch module as a rule, that takes each state by itself."""


def jacobian(field: Field, states: Tensor, method: str, sizes: Tensor | None = None) -> Tensor:
    """Jacobian `A = df/dx (..., n, n)` in 1/s at the states `(..., n)`.

    Args:
        field: the vector field.
        states: where to take the Jacobian, any batch.
        method: `autodiff`, `finite_difference` or `symbolic`.
        sizes: typical modulus of each state `(n,)`, from which `finite_difference` takes its steps; None for 1.

    Raises:
        ValueError: the method is unknown, or it is `symbolic` and the field offers no `jacobian(states)`.
    """
    if method not in METHODS:
        raise ValueError(f"eigen.jacobian={method}: has to be one of {', '.join(METHODS)}")
    return METHODS[method](field, states, torch.ones_like(states) if sizes is None else sizes)


def _autodiff(field: Field, states: Tensor, sizes: Tensor) -> Tensor:
    """Reverse mode: n copies of each state, each pulling back another row of A, in one evaluation of the field."""
    del sizes
    n = states.shape[-1]
    copies = states[..., None, :].expand(*states.shape, n)
    pull = vjp(field, copies)[1]
    # states do not interact, so the cotangents may all be pulled back at once
    units = torch.eye(n, dtype=states.dtype, device=states.device).expand(copies.shape)
    return pull(units)[0]


def _finite_difference(field: Field, states: Tensor, sizes: Tensor) -> Tensor:
    """Central differences of fourth order: those over the step and over twice the step, extrapolated.

    The step is `eps^(1/5)` of the state's size, or of its modulus where that is larger. Then rounding and truncation
    errors are of one size, `eps^(4/5)`, for a field that varies by itself over such a size; and one that hardly varies
    over it (small states, weights of order 1), whose differences are mostly rounding, still has a wide enough step.
    """
    width = torch.finfo(states.dtype).eps ** (1.0 / 5.0)
    size = torch.maximum(states.detach().abs(), torch.where(sizes > 0.0, sizes, 1.0))
    shift = torch.diag_embed(width * size)

    def quotient(reach: float) -> Tensor:
        forth, back = states[..., None, :] + reach * shift, states[..., None, :] - reach * shift
        # what lies between the rounded points, not what was asked for
        span = torch.diagonal((forth - back).detach(), dim1=-2, dim2=-1)
        return ((field(forth) - field(back)) / span[..., :, None]).mT

    return (4.0 * quotient(1.0) - quotient(2.0)) / 3.0


def _symbolic(field: Field, states: Tensor, sizes: Tensor) -> Tensor:
    """Ask the field for its closed form. A field whose network may lack one says so in `has_symbolic_jacobian`."""
    del sizes
    closed_form = getattr(field, "jacobian", None)
    if closed_form is None or not getattr(field, "has_symbolic_jacobian", True):
        raise ValueError(
            f"eigen.jacobian=symbolic: {type(field).__name__} offers no jacobian(states); "
            "use autodiff or finite_difference"
        )
    return closed_form(states)


METHODS: dict[str, Callable[[Field, Tensor, Tensor], Tensor]] = {
    "autodiff": _autodiff,
    "finite_difference": _finite_difference,
    "symbolic": _symbolic,
}
"""Methods by the name that `eigen.jacobian` holds."""
