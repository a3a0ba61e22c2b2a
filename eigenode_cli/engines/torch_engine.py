"""The reference engine: any torch vector field, torchdiffeq, autograd."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.arrays import Complexes, Floats, Integers
from eigenode_cli.data.targets import Targets
from eigenode_cli.engines.base import Advance, Evaluation, LossJacobian, ResidualJacobian, residual_rows, single_step
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update
from eigenode_cli.model import VectorField, held, load_flat
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.trajectory import Trajectory, solve
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import rounding_levels
from eigenode_cli.terms import NAMES, SPECTRAL
from eigenode_cli.terms.errors import MSE
from eigenode_cli.terms.torch_terms import solution_term, spectral_values
from eigenode_cli.terms.user import UserTerm


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
    spectral: _Spectra


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
        self._unknown = torch.from_numpy(problem.data.unknown)
        self._initial = torch.zeros(self._unknown.numel(), dtype=torch.float64, requires_grad=True)
        self._sizes = torch.from_numpy(problem.sizes)
        self._n = problem.data.states
        self._offsets = torch.from_numpy(problem.data.offsets)
        self._offset = torch.zeros(self._offsets.numel(), dtype=torch.float64, requires_grad=True)
        self._driven = torch.from_numpy(problem.data.driven)

    @property
    def _leaves(self) -> tuple[Tensor, ...]:
        """All parameters, in the order of theta."""
        return (*self._parameters, *(leaf for leaf in (self._initial, self._offset) if leaf.numel()))

    def _load(self, theta: Floats) -> None:
        """Take over the parameters.

        Raises:
            ValueError: `theta` has another length.
        """
        size = sum(leaf.numel() for leaf in self._leaves)
        if theta.shape != (size,):
            raise ValueError(f"theta has shape {theta.shape}, there are {size} parameters")
        load_flat(self.field, theta)
        with torch.no_grad():
            initial, offset = self._unknown.numel(), self._offsets.numel()
            at = theta.size - initial - offset
            self._initial[:] = torch.from_numpy(theta[at : at + initial])
            self._offset[:] = torch.from_numpy(theta[at + initial :])

    def _start(self) -> Tensor:
        """Return the initial state `(n,)` with its trained entries."""
        start = torch.from_numpy(self.problem.data.initial_state.copy())
        return start.index_put((self._unknown,), self._initial) if self._unknown.numel() else start

    def loss_jacobian(self, theta: Floats, steps: list[float] | None = None) -> LossJacobian:
        """See `Engine.loss_jacobian`; `steps` holds the solver to given step sizes."""
        self._load(theta)
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

    def residual_jacobian(
        self, theta: Floats, differentiated: bool = True, steps: list[float] | None = None
    ) -> ResidualJacobian:
        """See `Engine.residual_jacobian`: one backward pass for every residual."""
        problem, rows = self.problem, residual_rows(self.problem)
        self._load(theta)
        forward = self._forward(problem.terms, steps)
        residuals = torch.zeros(max(part.stop for part in rows.values()), dtype=torch.float64)
        if forward.trajectory.status is Status.OK:
            residuals = torch.cat([self._residuals(term, forward) for term in problem.terms])
        jacobian = np.zeros((residuals.numel() if differentiated else 0, theta.size))
        for number, row in enumerate(jacobian):
            if residuals[number].requires_grad:
                found = torch.autograd.grad(residuals[number], self._leaves, retain_graph=True, materialize_grads=True)
                row[:] = torch.cat([part.reshape(-1) for part in found]).numpy()
        values = np.array([float(forward.values[term].detach()) for term in problem.terms])
        trajectory = forward.trajectory
        return ResidualJacobian(
            residuals.detach().numpy(), jacobian, rows, values, trajectory.status, trajectory.n_accepted
        )

    def _residuals(self, term: str, forward: _Forward) -> Tensor:
        """Return the residuals of one term."""
        problem = self.problem
        if term not in SPECTRAL:
            mask = torch.from_numpy(problem.data.channel_mask)
            return self._channels(forward.trajectory.states)[mask] - torch.from_numpy(problem.data.channels)[mask]
        spectra, squares = forward.spectral, np.full(len(NAMES), MSE)
        rows = []
        for t in range(problem.spectral_index.size):
            at = slice(t, t + 1)
            value = spectral_values(
                spectra.eigenvalues[at],
                [term],
                problem.targets.rows(np.array([t])),
                problem.margin,
                squares,
                problem.huber_delta,
                spectra.levels[at],
            )[0]
            rows.append(torch.sqrt(value) if value > 0.0 else torch.zeros((), dtype=torch.float64))
        return torch.stack(rows)

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: one step."""
        return single_step(self, theta, update, rates, halt)

    @torch.no_grad()
    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`."""
        self._load(theta)
        forward = self._forward((*NAMES, *self.user_terms), None, recorded=True)
        outputs = torch.from_numpy(np.concatenate([self.problem.data.times[:1], times]))
        drive = self.problem.data.drive
        dense = solve(self.field, self._start(), outputs, self.problem.solver, drive=drive).padded(outputs.numel())[1:]
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
            solve(self.field, self._start(), self._times, problem.solver, steps, problem.data.drive)
            if problem.solved
            else Trajectory(self._times.new_empty((0, self._n)), Status.UNSOLVED, 0, 0, [])
        )
        index = problem.spectral_index
        reached = int(np.searchsorted(index, trajectory.states.shape[0]))
        along = np.full((index.size, self._n), np.nan, dtype=np.complex128)
        if terms == ("sol",):
            nothing = _Spectra(torch.empty((0, self._n), dtype=torch.complex128), np.empty(0), 0)
            return _Forward(
                self._values(terms, trajectory, nothing, problem.targets, recorded), trajectory, along, 0, nothing
            )
        spectra = self._spectra(trajectory.states[index[:reached]], index[:reached])
        along[:reached] = spectra.eigenvalues.detach().numpy()
        targets = problem.targets
        if trajectory.status is not Status.OK and problem.stabilise and problem.states is not None:
            row = problem.stabilising_rows(trajectory.states.detach().numpy())
            states = np.concatenate([trajectory.states.detach().numpy()[index[row]], problem.states[index]])
            rows = np.concatenate([row, np.arange(index.size)])
            spectra = self._spectra(torch.from_numpy(states), index[rows])
            targets = targets.rows(rows)
        values = self._values(terms, trajectory, spectra, targets, recorded)
        return _Forward(values, trajectory, along, spectra.guard_count, spectra)

    def _spectra(self, states: Tensor, outputs: Integers) -> _Spectra:
        """Return the spectra at states `(T, n)`, with the inputs at these data times."""
        field = held(self.field, self._driven[torch.from_numpy(outputs)])
        matrices = jacobian(field, states, self.problem.jacobian, self._sizes)
        values, fired = eigvals(matrices, self.problem.max_condition)
        return _Spectra(values, rounding_levels(matrices.detach().numpy()), int(fired.sum()))

    def _values(
        self, terms: tuple[str, ...], trajectory: Trajectory, spectra: _Spectra, targets: Targets, recorded: bool
    ) -> dict[str, Tensor]:
        """Return the named terms, NaN where a failed solve leaves them undefined, or there is nothing to record."""
        problem = self.problem
        undefined = torch.tensor(np.nan, dtype=torch.float64)
        values = dict.fromkeys(terms, undefined)
        solved = trajectory.status is Status.OK
        if solved or problem.stabilise:
            spectral = [term for term in terms if term in SPECTRAL]
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
            shown = self._channels(trajectory.states)
            values["sol"] = solution_term(shown, problem.data, problem.errors[0], problem.huber_delta)
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

    def _channels(self, states: Tensor) -> Tensor:
        """Return what the model says of the measured channels `(N, C)` at the trajectory `(N, n)`."""
        data = self.problem.data
        shown = states if data.rates is None else torch.cat([states, held(self.field, self._driven)(states)], dim=-1)
        if self._offsets.numel():
            added = shown.new_zeros(shown.shape[-1]).index_put((self._offsets,), self._offset)
            shown = shown + added
        return shown

    def _gradient(self, term: str, value: Tensor) -> Floats:
        """Parameter gradient `(P,)` of one term: zero where no parameter enters it, NaN where it is undefined."""
        if torch.isnan(value) or not value.requires_grad:
            blank = np.nan if torch.isnan(value) else 0.0
            return np.full(sum(leaf.numel() for leaf in self._leaves), blank)
        if term in self.user_terms:
            rows = self.user_terms[term].gradient(value, self._leaves)
        else:
            rows = torch.autograd.grad(value, self._leaves, retain_graph=True, materialize_grads=True)
        return torch.cat([row.reshape(-1) for row in rows]).numpy()
