"""Rosenbrock methods: linearly implicit, one factorisation a step, for stiff fields.

Each stage solves with `W = I / (h gamma) - J`, the Jacobian J that of the field at the start of the step, so that
nothing is iterated. E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Sec. IV.7. All of it is
differentiable, J included: sensitivities are those of the discrete solution.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Timed = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Attempt:
    """A step that was tried.

    Attributes:
        end: the state at its end `(n,)`.
        error: the estimate of its error `(n,)`.
        dense: coefficients of the solution inside of it in ascending powers of the fraction of the step, each `(n,)`.
    """

    end: Tensor
    error: Tensor
    dense: list[Tensor]


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


@dataclass(frozen=True, eq=False)
class Rodas5P:
    """Order 5, stiffly accurate, L-stable, dense output of order 4, in the form without products with J.

    G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia
    Differential Equations package, BIT Numer. Math. 63 (2023) 27, https://doi.org/10.1007/s10543-023-00967-x. The
    seventh and the eighth stage, and the end, each add the solution of the stage before.
    """

    name: str = "rodas5p"
    order: int = 5
    gamma: float = 0.21193756319429014

    def attempt(self, field: Timed, start: Start, size: float) -> Attempt | None:
        """Try a step of `size` in s; None where W is singular."""
        n, x = start.state.numel(), start.state
        factors, pivots, info = torch.linalg.lu_factor_ex(
            torch.eye(n, dtype=x.dtype) / (size * self.gamma) - start.jacobian
        )
        if int(info):
            return None
        solved: list[Tensor] = []
        y = x
        for i in range(STAGES):
            if i < len(_A):
                y = x + sum((a * u for a, u in zip(_A[i], solved, strict=True)), torch.zeros_like(x))
            else:
                y = y + solved[-1]
            rate = start.rate if i == 0 else field(start.time + _NODES[i] * size, y)
            right = rate + sum(
                (c / size * u for c, u in zip(_C[i], solved, strict=True)), size * _DRIFT[i] * start.drift
            )
            solved.append(torch.linalg.lu_solve(factors, pivots, right[:, None])[:, 0])
        end = y + solved[-1]
        first, second, third = (torch.from_numpy(_DENSE) @ torch.stack(solved)).unbind()
        dense = [x, end - x + first, second - first, third - second, -third]
        return Attempt(end, solved[-1], dense)


STAGES = 8
_A = (
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946),
)
_C = (
    (),
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
    (
        30.91273214028599,
        -3.1208243349937974,
        77.79954646070892,
        34.28646028294783,
        -19.097331116725623,
        -28.087943162872662,
    ),
    (
        37.80277123390563,
        -3.2571969029072276,
        112.26918849496327,
        66.9347231244047,
        -40.06618937091002,
        -54.66780262877968,
        -9.48861652309627,
    ),
)
_NODES = (0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0)
_DRIFT = (
    0.21193756319429014,
    -0.42387512638858027,
    -0.3384627126235924,
    1.8046452872882734,
    2.325825639765069,
    0.0,
    0.0,
    0.0,
)
_DENSE: NDArray[np.float64] = np.array(
    [
        [
            25.948786856663858,
            -2.5579724845846235,
            10.433815404888879,
            -2.3679251022685204,
            0.524948541321073,
            1.1241088310450404,
            0.4272876194431874,
            -0.17202221070155493,
        ],
        [
            -9.91568850695171,
            -0.9689944594115154,
            3.0438037242978453,
            -24.495224566215796,
            20.176138334709044,
            15.98066361424651,
            -6.789040303419874,
            -6.710236069923372,
        ],
        [
            11.419903575922262,
            2.8879645146136994,
            72.92137995996029,
            80.12511834622643,
            -52.072871366152654,
            -59.78993625266729,
            -0.15582684282751913,
            4.883087185713722,
        ],
    ]
)


@dataclass(frozen=True, eq=False)
class Rosenbrock23:
    """Order 2 with an error estimate of third order, L-stable, dense output of order 2.

    L. F. Shampine, M. W. Reichelt, The MATLAB ODE suite, SIAM J. Sci. Comput. 18 (1997) 1-22, `ode23s`.
    """

    name: str = "rosenbrock23"
    order: int = 3
    gamma: float = 1.0 / (2.0 + 2.0**0.5)

    def attempt(self, field: Timed, start: Start, size: float) -> Attempt | None:
        """Try a step of `size` in s; None where W is singular."""
        n, x, d = start.state.numel(), start.state, self.gamma
        factors, pivots, info = torch.linalg.lu_factor_ex(torch.eye(n, dtype=x.dtype) - size * d * start.jacobian)
        if int(info):
            return None

        def solved(right: Tensor) -> Tensor:
            return torch.linalg.lu_solve(factors, pivots, right[:, None])[:, 0]

        drift = size * d * start.drift
        first = solved(start.rate + drift)
        middle = field(start.time + 0.5 * size, x + 0.5 * size * first)
        second = solved(middle - first) + first
        end = x + size * second
        last = field(start.time + size, end)
        third = solved(last - (6.0 + 2.0**0.5) * (second - middle) - 2.0 * (first - start.rate) + drift)
        scale = size / (1.0 - 2.0 * d)
        dense = [x, scale * (first - 2.0 * d * second), scale * (second - first)]
        return Attempt(end, size / 6.0 * (first - 2.0 * second + third), dense)


ROSENBROCK = {method.name: method for method in (Rodas5P(), Rosenbrock23())}
"""The methods by the name that `solver=` takes."""
