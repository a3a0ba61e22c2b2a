"""Terms that compare the spectrum at the equilibrium with its target, beside others from a solve."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.engines.base import Advance, Engine, Evaluation, LossJacobian, ResidualJacobian, single_step
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update
from eigenode_cli.model import VectorField, load_flat
from eigenode_cli.solve.status import SOLVED, Status
from eigenode_cli.spectra.eig import eigvals
from eigenode_cli.spectra.equilibrium import equilibrium, followed
from eigenode_cli.spectra.jacobian import jacobian
from eigenode_cli.spectra.pairs import rounding_levels
from eigenode_cli.terms import AT_TARGET, NAMES
from eigenode_cli.terms.errors import MSE
from eigenode_cli.terms.torch_terms import spectral_values

TINY = 1e-300
"""Below this a term at the equilibrium counts as met."""


@dataclass(frozen=True)
class _Rest:
    """Spectrum at the equilibrium `(1, n)` in 1/s with its graph, its rounding level `(1,)`, firings of the guard."""

    spectrum: Tensor
    level: Floats
    guard_count: int


class EquilibriumEngine:
    """The terms that compare with a target at the equilibrium, the others as another engine takes them.

    The equilibrium is the one of the field without inputs that is found from the middle of the data at every call, so
    that a resumed training sees the same one; its dependence on the parameters is differentiated through. Where none
    is found these terms are NaN and the status is `NO_EQUILIBRIUM`.

    Args:
        field: the vector field; its parameters, the leading ones, are overwritten at each call.
        problem: everything else; its first trajectory and all others.
        along: engine of the other terms, and of whatever stands in `filler`.
        filler: how many terms `along` has that were not asked for.
    """

    def __init__(self, field: VectorField, problem: Problem, along: Engine, filler: int) -> None:
        assert problem.resting is not None
        self.name = along.name
        self._field, self._problem, self._along, self._filler = field, problem, along, filler
        self._targets = problem.resting
        self._terms = tuple(term for term in problem.terms if term in AT_TARGET)
        self._rows = np.array([term in AT_TARGET for term in problem.terms])
        self._parameters = tuple(field.parameters())
        self._size = sum(parameter.numel() for parameter in self._parameters)
        self._states = np.concatenate([_known(one) for one in problem.trajectories])
        self._sizes = torch.from_numpy(problem.sizes)
        closed = problem.jacobian == "autodiff" and field.has_symbolic_jacobian  # exact as well, and faster
        self._jacobian = "symbolic" if closed else problem.jacobian

    @property
    def compile_seconds(self) -> float:
        """See `Engine.compile_seconds`."""
        return self._along.compile_seconds

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        """See `Engine.loss_jacobian`; trajectory, spectra and solver steps are those of the solve."""
        found, rest = self._along.loss_jacobian(theta), self._at_rest(theta)
        values = np.full(self._rows.size, np.nan)
        gradients = np.full((self._rows.size, theta.size), np.nan)
        asked = slice(0, found.values.size - self._filler)
        values[~self._rows], gradients[~self._rows] = found.values[asked], found.gradients[asked]
        if rest is None:
            return replace(found, values=values, gradients=gradients, status=_status(found.status, rest))
        if found.status in SOLVED or self._problem.stabilise:
            own = self._values(rest, self._terms, self._problem.errors)
            values[self._rows], gradients[self._rows] = own.detach().numpy(), self._gradients(own, theta.size)
        return replace(found, values=values, gradients=gradients, guard_count=found.guard_count + rest.guard_count)

    def residual_jacobian(self, theta: Floats, differentiated: bool = True) -> ResidualJacobian:
        """See `Engine.residual_jacobian`; each of these terms has one residual, zero where nothing is compared."""
        found = self._along.residual_jacobian(theta, differentiated)
        with torch.set_grad_enabled(differentiated):
            rest = self._at_rest(theta)
        values = np.full(self._rows.size, np.nan)
        values[~self._rows] = found.values[: found.values.size - self._filler]
        own = torch.zeros(len(self._terms), dtype=torch.float64)
        if rest is not None:
            values[self._rows] = self._values(rest, self._terms, self._problem.errors).detach().numpy()
            squares = self._values(rest, self._terms, np.full(len(NAMES), MSE))
            own = torch.where(squares > 0.0, torch.sqrt(squares.clamp_min(TINY)), 0.0)  # the root of 0 has no slope
        slopes = self._gradients(own, theta.size) if differentiated else np.empty((0, theta.size))
        rows, residuals, parts, start = {}, [], [], 0
        for term in self._problem.terms:
            at_rest = term in self._terms
            part = slice(number := self._terms.index(term), number + 1) if at_rest else found.rows[term]
            residuals.append((own.detach().numpy() if at_rest else found.residuals)[part])
            parts.append((slopes if at_rest else found.jacobian)[part if differentiated else slice(0)])
            rows[term], start = slice(start, start + residuals[-1].size), start + residuals[-1].size
        status = _status(found.status, rest)
        return ResidualJacobian(
            np.concatenate(residuals), np.concatenate(parts), rows, values, status, found.n_accepted
        )

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: one step."""
        return single_step(self, theta, update, rates, halt)

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`; without an equilibrium a solve that succeeded has the status `NO_EQUILIBRIUM`."""
        found = self._along.evaluate(theta, times)
        with torch.no_grad():
            rest = self._at_rest(theta)
        values, numbers = found.values.copy(), [NAMES.index(term) for term in AT_TARGET]
        values[numbers] = np.nan
        if rest is not None:
            values[numbers] = self._values(rest, AT_TARGET, self._problem.errors, recorded=True).detach().numpy()
        return replace(found, values=values, status=_status(found.status, rest))

    def _at_rest(self, theta: Floats) -> _Rest | None:
        """Return the spectrum at the equilibrium, None where there is none."""
        load_flat(self._field, theta)
        rest = equilibrium(self._field, self._states)
        state = None if rest is None else followed(self._field, rest)
        if state is None:
            return None
        matrices = jacobian(self._field, state[None], self._jacobian, self._sizes)
        spectrum, fired = eigvals(matrices, self._problem.max_condition)
        return _Rest(spectrum, rounding_levels(matrices.detach().numpy()), int(fired.sum()))

    def _values(self, rest: _Rest, terms: tuple[str, ...], errors: Integers, recorded: bool = False) -> Tensor:
        """Return the named terms there `(L,)`."""
        margin, delta = self._problem.margin, self._problem.huber_delta
        return spectral_values(rest.spectrum, terms, self._targets, margin, errors, delta, rest.level, recorded)

    def _gradients(self, values: Tensor, size: int) -> Floats:
        """Return the derivatives of `values (L,)` in all parameters `(L, P)`, zero in those not of the field."""
        gradients = np.zeros((values.numel(), size))
        for row, value in zip(gradients, values, strict=True):
            if value.requires_grad:
                found = torch.autograd.grad(value, self._parameters, retain_graph=True, materialize_grads=True)
                row[: self._size] = torch.cat([part.reshape(-1) for part in found]).numpy()
        return gradients


def _status(solve: Status, rest: _Rest | None) -> Status:
    """Return how a solve ended, or that there is no equilibrium where it succeeded."""
    return Status.NO_EQUILIBRIUM if rest is None and solve in SOLVED else solve


def _known(problem: Problem) -> Floats:
    """Return the states of one trajectory `(N, n)` as far as they are known, zero where they are not."""
    return np.nan_to_num(problem.data.seen if problem.states is None else problem.states)
