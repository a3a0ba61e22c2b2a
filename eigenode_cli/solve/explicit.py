"""Steps of explicit Runge-Kutta methods on tensors, for a solve that changes its method on the way."""

import math

import torch
from torch import Tensor

from eigenode_cli.solve.rosenbrock import Attempt, Timed
from eigenode_cli.solve.switching import SQUARINGS
from eigenode_cli.solve.tableau import Tableau


def attempt_explicit(tableau: Tableau, field: Timed, time: Tensor, state: Tensor, size: float) -> Attempt:
    """Try a step of `size` in s from `state (n,)`; its last two stages must lie at the same time."""
    stages, states = field(time, state)[None], [state]
    a = torch.from_numpy(tableau.a)
    for i in range(1, tableau.error.size):
        states.append(state + size * (a[i, :i] @ stages))
        stages = torch.cat([stages, field(time + tableau.c[i] * size, states[-1])[None]])
    error, dense = torch.from_numpy(tableau.error), torch.from_numpy(tableau.dense)
    with torch.no_grad():
        apart = float((states[-1] - states[-2]).abs().max())
        fastest = float((stages[-1] - stages[-2]).abs().max()) / apart if apart > 0.0 else 0.0
    return Attempt(states[-1], size * (error @ stages), [state, *(size * (dense.T @ stages))], fastest)


@torch.no_grad()
def spectral_radius(jacobian: Tensor) -> float:
    """Return an upper estimate of the largest modulus of an eigenvalue, `|J^k|^(1/k)` (Gelfand's formula)."""
    power, logarithm, exponent = jacobian, 0.0, 1.0
    for turn in range(SQUARINGS + 1):
        norm = float(power.abs().sum(dim=1).max())
        if not 0.0 < norm < math.inf:
            return norm
        logarithm += math.log(norm) / exponent
        exponent *= 2.0
        if turn < SQUARINGS:
            power = power / norm
            power = power @ power
    return math.exp(logarithm)
