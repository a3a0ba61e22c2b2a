"""The loss Jacobian as a user of torchdiffeq or torchode would write it: plain torch, nothing of this package.

The terms are transcriptions of the equations (Sec. 2.3 of the paper), with MAE, on all spectra at once.
"""

from collections.abc import Callable
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from eigenode_cli.bench.case import Case
from eigenode_cli.bench.contestants import Result, Runner


class PlainField(nn.Module):
    """`dx/dt = f(x)` as an ordinary module."""

    def __init__(self, case: Case) -> None:
        super().__init__()
        sizes = case.shape.sizes
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [nn.Linear(inputs, outputs, dtype=torch.float64), nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self.second_order = case.shape.structure == "second_order"
        self.evaluations = 0
        nn.utils.vector_to_parameters(torch.from_numpy(case.theta.copy()), self.parameters())

    def forward(self, _t: Tensor, x: Tensor) -> Tensor:
        """State derivative `(..., n)` at `x (..., n)`."""
        self.evaluations += 1
        outputs = self.network(x)
        return torch.cat([x[..., x.shape[-1] // 2 :], outputs], -1) if self.second_order else outputs


Solver = Callable[[PlainField], tuple[Tensor, Callable[[], int]]]
"""Vector field in; trajectory `(N, n)` out, and what gives the number of steps that it took."""


class PlainTerms:
    """The terms of a case on torch tensors."""

    def __init__(self, case: Case) -> None:
        problem = case.problem
        self.names = problem.terms
        self.index = torch.from_numpy(problem.spectral_index)
        self.data = torch.from_numpy(problem.data.values)
        self.mask = torch.from_numpy(problem.data.mask)
        # descending, as the model's pairs are sorted below; NaN for a pair that the target does not have
        self.frequency = torch.from_numpy(problem.targets.frequency[:, ::-1].copy())
        self.damping = torch.from_numpy(problem.targets.damping[:, ::-1].copy())
        self.pairs = torch.from_numpy(problem.targets.pairs)

    def values(self, field: PlainField, states: Tensor) -> list[Tensor]:
        """Values of the named terms for a trajectory `(N, n)`."""
        values: dict[str, Tensor] = {"sol": (states - self.data)[self.mask].abs().mean()}
        if self.names != ("sol",):
            time = states.new_zeros(())
            matrices = torch.func.vmap(torch.func.jacrev(lambda x: field(time, x)))(states[self.index])
            values |= self._spectral(torch.linalg.eigvals(matrices))
        return [values[name] for name in self.names]

    def _spectral(self, spectra: Tensor) -> dict[str, Tensor]:
        """FRQ, DMP, STB and, for two states, OSC of spectra `(T, n)`."""
        n = spectra.shape[1]
        imag, order = torch.sort(spectra.imag, dim=1, descending=True)
        imag, order = imag[:, : self.frequency.shape[1]], order[:, : self.frequency.shape[1]]
        upper = torch.gather(spectra, 1, order)
        both = (imag > 0.0) & ~torch.isnan(self.frequency)
        terms = {
            # both members of a pair count
            "frq": 2.0 * (imag / (2.0 * torch.pi) - self.frequency)[both].abs().sum() / spectra.numel(),
            "dmp": 2.0 * (-upper.real / upper.abs() - self.damping)[both].abs().sum() / spectra.numel(),
            "stb": torch.relu(spectra.real).mean(),
        }
        if n == 2:
            gap = (spectra.real[:, 0] - spectra.real[:, 1]).abs()
            missing = (self.pairs > 0) & (spectra.imag == 0.0).all(dim=1)
            terms["osc"] = gap[missing].sum() / spectra.numel()
        return terms


def plain_runner(case: Case, solver: Solver, detail: str) -> Runner:
    """Return the loss Jacobian of a case: one solve, one backward pass a term."""
    field, terms = PlainField(case), PlainTerms(case)
    parameters = tuple(field.parameters())

    def call() -> Result:
        states, steps = solver(field)
        values = terms.values(field, states)
        gradients = [
            torch.cat([row.reshape(-1) for row in torch.autograd.grad(v, parameters, retain_graph=True)])
            for v in values
        ]
        return Result(np.array([v.item() for v in values]), torch.stack(gradients).numpy(), steps())

    return Runner(call, lambda result: result, detail)


def torchdiffeq_solver(case: Case) -> Solver:
    """`torchdiffeq.odeint` with dopri5, through which autograd goes."""
    odeint: Any = import_module("torchdiffeq").odeint
    start, times = torch.from_numpy(case.problem.data.initial_state.copy()), torch.from_numpy(case.times)
    solver = case.solver

    def solve(field: PlainField) -> tuple[Tensor, Callable[[], int]]:
        before = field.evaluations
        states = odeint(field, start, times, rtol=solver.rtol, atol=solver.atol, method="dopri5")
        # two evaluations choose the first step, six make a trial, accepted or not
        steps = (field.evaluations - before - 2) // 6
        return states, lambda: steps

    return solve


def torchode_solver(case: Case) -> Solver:
    """`torchode.AutoDiffAdjoint` with Tsit5 and the same step-size control as ours."""
    torchode: Any = import_module("torchode")  # its own annotations contradict each other
    start = torch.from_numpy(case.problem.data.initial_state.copy())[None]
    times = torch.from_numpy(case.times)[None]
    solver = case.solver

    def solve(field: PlainField) -> tuple[Tensor, Callable[[], int]]:
        term = torchode.ODETerm(field)
        method = torchode.Tsit5(term=term)
        controller = torchode.PIDController(
            atol=solver.atol, rtol=solver.rtol, pcoeff=0.4, icoeff=0.3, dcoeff=0.0, term=term
        )
        adjoint = torchode.AutoDiffAdjoint(method, controller)
        solution = adjoint.solve(torchode.InitialValueProblem(y0=start, t_eval=times))
        return solution.ys[0], lambda: int(solution.stats["n_accepted"])

    return solve
