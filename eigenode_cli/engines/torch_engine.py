"""The reference engine: any torch vector field, torchdiffeq, autograd."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.data.dataset import Targets
from eigenode_cli.engines.base import Advance, Complexes, Evaluation, Floats, LossJacobian, single_step
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, load_flat
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.trajectory import Trajectory, solve
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import rounding_levels
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.torch_terms import solution_term, spectral_values
from eigenode_cli.terms.user import UserTerm
from eigenode_cli.training.update import Rule


@dataclass(frozen=True)
class _Spectra:
    """Eigenvalues `(T, n)` in 1/s with their graph, rounding levels `(T,)`, and firings of the guard."""

    eigenvalues: Tensor
    levels: Floats
    guard_count: int


@dataclass(frozen=True)
class _Forward:
    """One solve with its spectra and term values, still attached to the autograd graph."""

    values: dict[str, Tensor]
    trajectory: Trajectory
    spectra: Complexes
    guard_count: int


class TorchEngine:
    """Loss Jacobian by autograd, one backward pass a named term.

    Args:
        field: the vector field; its parameters are overwritten at each call.
        problem: everything else that a training depends on.
        user_terms: the user's own terms by name.
    """

    name = "torch"
    compile_seconds = 0.0

    def __init__(self, field: VectorField, problem: Problem, user_terms: dict[str, UserTerm]) -> None:
        self.field = field
        self.problem = problem
        self.user_terms = user_terms
        self._parameters = tuple(field.parameters())
        self._times = torch.from_numpy(problem.data.times)
        self._seen = torch.from_numpy(problem.data.seen)
        self._start = torch.from_numpy(problem.initial_state)
        self._sizes = torch.from_numpy(np.abs(problem.data.states).max(axis=0))

    def loss_jacobian(self, theta: Floats, steps: list[float] | None = None) -> LossJacobian:
        """See `Engine.loss_jacobian`; `steps` holds the solver to given step sizes."""
        load_flat(self.field, theta)
        forward = self._forward(self.problem.terms, steps)
        values = np.array([float(forward.values[term].detach()) for term in self.problem.terms])
        gradients = np.stack([self._gradient(term, forward.values[term]) for term in self.problem.terms])
        return LossJacobian(
            values=values,
            gradients=gradients,
            trajectory=forward.trajectory.padded(self._times.numel()),
            spectra=forward.spectra,
            status=forward.trajectory.status,
            n_accepted=forward.trajectory.n_accepted,
            n_rejected=forward.trajectory.n_rejected,
            guard_count=forward.guard_count,
        )

    def advance(self, theta: Floats, rule: Rule, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: one step."""
        return single_step(self, theta, rule, rates, halt)

    @torch.no_grad()
    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`."""
        load_flat(self.field, theta)
        forward = self._forward((*NAMES, *self.user_terms), None, recorded=True)
        outputs = torch.from_numpy(np.concatenate([self.problem.data.times[:1], times]))
        dense = solve(self.field, self._start, outputs, self.problem.solver).padded(outputs.numel())[1:]
        return Evaluation(
            values=np.array([float(value) for value in forward.values.values()]),
            trajectory=forward.trajectory.padded(self._times.numel()),
            spectra=forward.spectra,
            status=forward.trajectory.status,
            n_accepted=forward.trajectory.n_accepted,
            n_rejected=forward.trajectory.n_rejected,
            dense=dense,
        )

    def _forward(self, terms: tuple[str, ...], steps: list[float] | None, recorded: bool = False) -> _Forward:
        problem = self.problem
        trajectory = (
            solve(self.field, self._start, self._times, problem.solver, steps)
            if problem.solved
            else Trajectory(self._start.new_empty((0, self._start.numel())), Status.UNSOLVED, 0, 0, [])
        )
        index = problem.spectral_index
        reached = int(np.searchsorted(index, trajectory.states.shape[0]))
        along = np.full((index.size, self._start.numel()), np.nan, dtype=np.complex128)
        if terms == ("sol",):
            nothing = _Spectra(torch.empty((0, self._start.numel()), dtype=torch.complex128), np.empty(0), 0)
            return _Forward(self._values(terms, trajectory, nothing, problem.targets, recorded), trajectory, along, 0)
        spectra = self._spectra(trajectory.states[index[:reached]])
        along[:reached] = spectra.eigenvalues.detach().numpy()
        targets = problem.targets
        if trajectory.status is not Status.OK and problem.stabilise:
            row = problem.stabilising_rows(trajectory.states.detach().numpy())
            states = np.concatenate([trajectory.states.detach().numpy()[index[row]], problem.data.states[index]])
            spectra = self._spectra(torch.from_numpy(states))
            targets = targets.rows(np.concatenate([row, np.arange(index.size)]))
        values = self._values(terms, trajectory, spectra, targets, recorded)
        return _Forward(values, trajectory, along, spectra.guard_count)

    def _spectra(self, states: Tensor) -> _Spectra:
        matrices = jacobian(self.field, states, self.problem.jacobian, self._sizes)
        values, fired = eigvals(matrices, self.problem.max_condition)
        return _Spectra(values, rounding_levels(matrices.detach().numpy()), int(fired.sum()))

    def _values(
        self, terms: tuple[str, ...], trajectory: Trajectory, spectra: _Spectra, targets: Targets, recorded: bool
    ) -> dict[str, Tensor]:
        """The named terms, NaN where a failed solve leaves them undefined, or there is nothing to record."""
        problem = self.problem
        undefined = torch.tensor(np.nan, dtype=torch.float64)
        values = dict.fromkeys(terms, undefined)
        solved = trajectory.status is Status.OK
        if solved or problem.stabilise:
            spectral = [term for term in terms if term in NAMES[1:]]
            vector = spectral_values(
                spectra.eigenvalues,
                spectral,
                targets,
                problem.margin,
                problem.errors,
                problem.huber_delta,
                spectra.levels,
                recorded,
            )
            values.update(zip(spectral, vector, strict=True))
        if solved and "sol" in values:
            values["sol"] = solution_term(trajectory.states, problem.data, problem.errors[0], problem.huber_delta)
        for name, term in self.user_terms.items():
            if name in values and (solved or (problem.stabilise and not term.needs_solve)):
                values[name] = term(
                    trajectory=trajectory.states,
                    spectra=spectra.eigenvalues,
                    times=self._times,
                    data=self._seen,
                    field=self.field,
                )
        return values

    def _gradient(self, term: str, value: Tensor) -> Floats:
        """Parameter gradient `(P,)` of one term: zero where no parameter enters it, NaN where it is undefined."""
        if torch.isnan(value) or not value.requires_grad:
            blank = np.nan if torch.isnan(value) else 0.0
            return np.full(sum(p.numel() for p in self._parameters), blank)
        if term in self.user_terms:
            rows = self.user_terms[term].gradient(value, self._parameters)
        else:
            rows = torch.autograd.grad(value, self._parameters, retain_graph=True, materialize_grads=True)
        return torch.cat([row.reshape(-1) for row in rows]).numpy()
