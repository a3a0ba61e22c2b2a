"""Steps of Rosenbrock methods on tensors.

All of it is differentiable, the Jacobian included: sensitivities are those of the discrete solution.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from eigenode_cli.solve.rosenbrock_tableau import RosenbrockTableau

Timed = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Attempt:
    """A step that was tried.

    Attributes:
        end: the state at its end `(n,)`.
        error: the estimate of its error `(n,)`.
        dense: coefficients of the solution inside of it in ascending powers of the fraction of the step, each `(n,)`.
        fastest: an estimate of the largest modulus of the spectrum in 1/s.
    """

    end: Tensor
    error: Tensor
    dense: list[Tensor]
    fastest: float = float("nan")


@dataclass(frozen=True)
class Start:
    """Where a step begins: time in s, state `(n,)`, its derivative, Jacobian `(n, n)`, derivative in time `(n,)`."""

    time: Tensor
    state: Tensor
    rate: Tensor
    jacobian: Tensor
    drift: Tensor


def start_of(field: Timed, time: Tensor, state: Tensor) -> Start:
    """Return what all attempts at a step from `state (n,)` share."""
    rate = field(time, state)
    return Start(time, state, rate, _jacobian(field, time, state), _drift(field, time, state))


def attempt(tableau: RosenbrockTableau, field: Timed, start: Start, size: float) -> Attempt | None:
    """Try a step of `size` in s; None where M is singular."""
    n, x = start.state.numel(), start.state
    matrix = torch.eye(n, dtype=x.dtype) / tableau.gamma - size * start.jacobian
    factors, pivots, info = torch.linalg.lu_factor_ex(matrix)
    if int(info):
        return None
    stages = torch.zeros(0, n, dtype=x.dtype)
    a, c = torch.from_numpy(tableau.a), torch.from_numpy(tableau.c)
    for i in range(tableau.nodes.size):
        state = x + size * (a[i, :i] @ stages)
        rate = start.rate if i == 0 else field(start.time + tableau.nodes[i] * size, state)
        right = rate + c[i, :i] @ stages + size * tableau.drift[i] * start.drift
        stages = torch.cat([stages, torch.linalg.lu_solve(factors, pivots, right[:, None]).T])
    end, error, dense = (torch.from_numpy(one) for one in (tableau.end, tableau.error, tableau.dense))
    return Attempt(x + size * (end @ stages), size * (error @ stages), [x, *(size * (dense.T @ stages))])


def _jacobian(field: Timed, time: Tensor, state: Tensor) -> Tensor:
    """Return `df/dx (n, n)` by reverse mode, one copy of the state a row; differentiable where gradients are on."""
    n, wanted = state.numel(), torch.is_grad_enabled()
    with torch.enable_grad():
        copies = state.expand(n, n)
        copies = copies if copies.requires_grad else copies.clone().requires_grad_()
        units = torch.eye(n, dtype=state.dtype)
        (rows,) = torch.autograd.grad(field(time, copies), copies, units, create_graph=wanted)
    return rows


def _drift(field: Timed, time: Tensor, state: Tensor) -> Tensor:
    """Return `df/dt (n,)` at a fixed state; zero where the field does not look at the time."""
    wanted = torch.is_grad_enabled()
    with torch.enable_grad():
        copies = time.detach().expand(state.numel(), 1).clone().requires_grad_()
        rates = field(copies, state.expand(state.numel(), state.numel()))
        if not rates.requires_grad:
            return torch.zeros_like(state)
        diagonal = torch.diagonal(rates).sum()
        (slopes,) = torch.autograd.grad(diagonal, copies, create_graph=wanted, materialize_grads=True)
    return slopes[:, 0]
