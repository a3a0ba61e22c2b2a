"""Residual Jacobians of the compiled engine."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.base import ResidualJacobian, residual_rows, unheard
from eigenode_cli.engines.compiled.buffers import (
    FIRST_CAPACITY,
    NO_STEPS,
    Room,
    build_core,
    given_steps,
    solver_method,
    term_codes,
)
from eigenode_cli.engines.compiled.core import ACCEPTED
from eigenode_cli.engines.compiled.integrate import FULL
from eigenode_cli.engines.compiled.memory import LINE
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.compiled.ready import Kernels
from eigenode_cli.engines.compiled.residual_kernel import residual_jacobian
from eigenode_cli.engines.problem import Problem
from eigenode_cli.solve.status import Status


class CompiledResiduals:
    """Residuals and their Jacobian of a multilayer perceptron (see `engines.base.ResidualJacobian`).

    Args:
        shape: the vector field.
        problem: data, targets, terms of the six, solver.
        announce: called with one line before a compilation that takes a while.

    Raises:
        ValueError: the problem is not solved, or has other terms than the six.
    """

    def __init__(self, shape: MlpShape, problem: Problem, announce: Callable[[str], None] = unheard) -> None:
        self.rows = residual_rows(problem)
        self._problem = problem
        self._owner = Owner()
        self._method, step = solver_method(self._owner, problem.solver)
        self._given = given_steps(step, problem.data.times, problem.data.drive)
        self._codes = term_codes(problem.terms)
        self._core, self._shared = build_core(
            self._owner, shape, problem, self._method, len(problem.terms), 0, True, columns=LINE
        )
        self._room = self._make_room(self._given.size or min(FIRST_CAPACITY, self._method.max_steps))
        self._kernels = Kernels(self._signature, announce)
        self._size = max((part.stop for part in self.rows.values()), default=0)

    @property
    def compile_seconds(self) -> float:
        """Time of compiling or of loading machine code in s."""
        return self._kernels.seconds

    @property
    def steps(self) -> Floats:
        """Sizes of the accepted steps of the last solve in s."""
        return self._room.sizes[: self._shared.outcome[ACCEPTED]].copy()

    def evaluate(self, theta: Floats, differentiated: bool = True, steps: Floats | None = None) -> ResidualJacobian:
        """Return residuals and, where they are `differentiated`, their derivatives at `theta (P,)`.

        Args:
            theta: parameters.
            differentiated: whether the Jacobian is computed.
            steps: sizes of the steps `(S,)` in s to be taken as they are; None for the solver's own.
        """
        self._shared.theta[:] = theta
        given = self._given if steps is None else np.array(steps, dtype=np.float64)
        if given.size > self._room.steps.capacity:
            self._room = self._make_room(given.size)
        results = self._results(differentiated)
        self._kernels.ready("residual_jacobian")
        while True:
            status = residual_jacobian(self._core, self._room.steps, given, self._codes, differentiated, *results)
            if status != FULL:
                break
            self._room = self._make_room(min(2 * self._room.steps.capacity, self._method.max_steps))
        values, _, _, residuals, jacobian = results
        accepted = int(self._shared.outcome[ACCEPTED])
        return ResidualJacobian(residuals, jacobian, self.rows, values, Status(status), accepted)

    def _results(self, differentiated: bool) -> tuple[Floats, Floats, Any, Floats, Floats]:
        """Arrays to be filled: values, trajectory, spectra, residuals, Jacobian."""
        n, times, spectra = self._core.net.n, self._problem.data.times.size, self._problem.spectral_index.size
        return (
            np.empty(self._codes.size),
            np.empty((times, n)),
            np.empty((spectra, n), dtype=np.complex128),
            np.zeros(self._size),
            np.zeros((self._size if differentiated else 0, self._shared.theta.size)),
        )

    def _signature(self, name: str) -> tuple[Any, ...]:
        del name  # there is one kernel
        arguments = (self._core, self._room.steps, NO_STEPS, self._codes, True, *self._results(True))
        return tuple(numba.typeof(argument) for argument in arguments)

    def _make_room(self, capacity: int) -> Room:
        return Room(self._core.net, self._method, capacity, self._problem.data.times.size, recorded=True)
