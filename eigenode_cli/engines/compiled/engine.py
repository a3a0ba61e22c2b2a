"""The compiled engine: buffers, compilation, and the way from a `Problem` to its loss Jacobian."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numba
import numpy as np

from eigenode_cli.engines.base import (
    Advance,
    Complexes,
    Evaluation,
    Floats,
    LossJacobian,
    ResidualJacobian,
    single_step,
    unheard,
)
from eigenode_cli.engines.compiled import kernel
from eigenode_cli.engines.compiled.buffers import (
    FIRST_CAPACITY,
    NO_STEPS,
    Room,
    build_core,
    given_steps,
    solver_method,
    term_codes,
)
from eigenode_cli.engines.compiled.integrate import FULL, OK, UNSOLVED
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.compiled.ready import Kernels
from eigenode_cli.engines.compiled.residuals import CompiledResiduals
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.times import checked_times
from eigenode_cli.terms import NAMES, SPECTRAL
from eigenode_cli.terms.array_term import ArrayTerm

SENSITIVITIES = ("auto", "adjoint", "forward")
EVERY_TERM = np.arange(len(NAMES))


class CompiledEngine:
    """Loss Jacobians of a multilayer perceptron without Python in the loop (see `engines.base.Engine`).

    One instance has one set of buffers: use it from one thread at a time, and one instance a thread. While a kernel
    runs the GIL is released.

    Args:
        shape: the vector field.
        problem: data, targets, terms, solver.
        user_terms: by name, those that `problem.terms` names beyond the six and any others to be evaluated.
        sensitivity: `adjoint`, `forward`, or `auto`, which is the adjoint: in no case that was measured were forward
            sensitivities faster by more than 2 %, and with many parameters they are several times slower.
        announce: called with one line before a compilation that takes a while.

    Raises:
        ValueError: problem, shape and options do not fit together.
    """

    name = "compiled"

    def __init__(
        self,
        shape: MlpShape,
        problem: Problem,
        user_terms: Mapping[str, ArrayTerm] | None = None,
        sensitivity: str = "auto",
        announce: Callable[[str], None] = unheard,
    ) -> None:
        self._terms = problem.terms
        self._user_terms = dict(user_terms or {})
        self._own = [name for name in problem.terms if name not in NAMES]
        _check(shape, problem, set(self._own) - set(self._user_terms), sensitivity)
        self._forward_way = sensitivity == "forward"
        self._owner = Owner()
        self._method, self._step = solver_method(self._owner, problem.solver)
        self._codes = term_codes(problem.terms)
        self._vectors = not set(problem.terms).isdisjoint({*SPECTRAL, *self._own})
        self._core, self._shared = build_core(
            self._owner, shape, problem, self._method, len(problem.terms), len(self._own), self._forward_way
        )
        self._times, self._drive = problem.data.times, problem.data.drive
        self._spectra_shape = (problem.spectral_index.size, shape.states)
        self._given = given_steps(self._step, self._times, problem.data.drive)
        self._room = self._make_room(self._given.size or min(FIRST_CAPACITY, self._method.max_steps))
        self._dense_room: Room | None = None
        self._kernels = Kernels(self._signature, announce)
        self._residuals: CompiledResiduals | None = None
        self._description = (shape, problem, announce)

    @property
    def compile_seconds(self) -> float:
        """Time of compiling or of loading machine code in s; 0 before the first call."""
        return self._kernels.seconds + (0.0 if self._residuals is None else self._residuals.compile_seconds)

    def residual_jacobian(
        self, theta: Floats, differentiated: bool = True, steps: Floats | None = None
    ) -> ResidualJacobian:
        """See `Engine.residual_jacobian`; `steps` as in `loss_jacobian`."""
        if self._residuals is None:
            self._residuals = CompiledResiduals(*self._description)
        return self._residuals.evaluate(theta, differentiated, steps)

    @property
    def steps(self) -> Floats:
        """Sizes of the accepted steps of the last solve over the data times in s; `loss_jacobian` can be given them."""
        return self._room.sizes[: self._shared.outcome[kernel.ACCEPTED]].copy()

    @property
    def in_threads(self) -> bool:
        """Whether several engines may work side by side: kernels release the interpreter's lock, own terms do not."""
        return not self._user_terms

    def loss_jacobian(self, theta: Floats, steps: Floats | None = None) -> LossJacobian:
        """Values and gradients of the named terms at `theta (P,)`.

        Args:
            theta: parameters.
            steps: sizes of the steps `(S,)` in s to be taken as they are, which must end at the last data time; None
                for the solver's own. With them the result is a smooth function of theta.

        Raises:
            ValueError: `theta` has another length, or `steps` end elsewhere.
        """
        self._load(theta)
        given = self._given if steps is None else self._checked(steps)
        if given.size > self._room.steps.capacity:
            self._room = self._make_room(given.size)
        values, gradients = np.empty(self._codes.size), np.empty((self._codes.size, self._shared.theta.size))
        states, spectra = self._outputs()
        self._kernels.ready(*(("forward", "pull_back") if self._own else ("loss_jacobian",)))
        run = self._run_split if self._own else self._run_fused
        while run(given, values, gradients, states, spectra) == FULL:
            self._grow()
        _, accepted, rejected, _, _, guarded = self._shared.outcome.tolist()
        return LossJacobian(
            values=values,
            gradients=gradients,
            trajectory=states,
            spectra=spectra,
            status=Status(self._shared.outcome[kernel.STATUS]),
            n_accepted=accepted,
            n_rejected=rejected,
            guard_count=guarded,
        )

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: all steps, or one if a user's term takes part."""
        if self._own:
            return single_step(self, theta, update, rates, halt)
        self._load(theta)
        self._kernels.ready("advance")
        values, statuses = np.empty((rates.size, self._codes.size)), np.empty(rates.size, dtype=np.int64)
        gradients = np.empty((self._codes.size, theta.size))
        states, spectra = self._outputs()
        done, guarded = 0, 0
        while True:
            taken, fired = kernel.advance(
                self._core,
                self._room.steps,
                self._given,
                self._codes,
                self._vectors,
                self._forward_way,
                update,
                rates[done:],
                halt,
                self._shared.theta,
                gradients,
                states,
                spectra,
                values[done:],
                statuses[done:],
            )
            done, guarded = done + taken, guarded + fired
            halted = halt and done > 0 and statuses[done - 1] not in (OK, UNSOLVED)
            if done == rates.size or halted:
                break
            self._grow()
        theta[:] = self._shared.theta
        return Advance(values[:done], statuses[:done], guarded)

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """Values of the six terms and then of the user's, and states at `times (D,)` in s, ascending.

        The terms are those of a solve over the data times, the same as in `loss_jacobian`; the states at `times`,
        which may go beyond them, are those of a solve of their own from the same initial state.

        Raises:
            ValueError: `theta` has another length, or `times` are not finite and ascending from the initial state's.
        """
        outputs = checked_times(np.concatenate([self._times[:1], times]))
        self._load(theta)
        self._kernels.ready(
            *(("forward", "pull_back") if self._own else ("advance",)), "evaluate"
        )  # compiled in one go
        values = np.empty(len(NAMES))
        states, spectra = self._outputs()
        status, dense = self._evaluate(outputs, values, states, spectra)
        own = [
            term.function(self._shared.theta, states, spectra)[0] if self._defined(term, status) else math.nan
            for term in self._user_terms.values()
        ]
        return Evaluation(
            values=np.concatenate([values, own]),
            trajectory=states,
            spectra=spectra,
            status=Status(status),
            n_accepted=int(self._shared.outcome[kernel.ACCEPTED]),
            n_rejected=int(self._shared.outcome[kernel.REJECTED]),
            dense=dense,
        )

    def _evaluate(self, outputs: Floats, values: Floats, states: Floats, spectra: Complexes) -> tuple[int, Floats]:
        """Fill the results of a solve over the data times.

        Returns how it ended, and the states `(D, n)` at `outputs (1 + D,)` but for the first, the initial state's.
        """
        given, dense = given_steps(self._step, outputs, self._drive), np.empty((outputs.size, self._core.net.n))
        while True:
            room = self._room_of(outputs.size, given.size)
            status, ending = kernel.evaluate(
                self._core,
                self._room.steps,
                self._given,
                EVERY_TERM,
                values,
                states,
                spectra,
                room.steps,
                given,
                outputs,
                dense,
            )
            if status == FULL:
                self._grow()
            elif ending == FULL:
                self._dense_room = self._make_dense_room(2 * room.steps.capacity, outputs.size)
            else:
                return status, dense[1:]

    def _room_of(self, outputs: int, given: int) -> Room:
        """Room for a solve with so many outputs and given steps; the last one is kept."""
        room = self._dense_room
        if room is None or room.outputs != outputs or room.steps.capacity < given:
            room = self._make_dense_room(given or FIRST_CAPACITY, outputs)
        self._dense_room = room
        return room

    def _run_fused(self, given: Floats, values: Floats, gradients: Floats, states: Floats, spectra: Complexes) -> int:
        return kernel.loss_jacobian(
            self._core,
            self._room.steps,
            given,
            self._codes,
            self._vectors,
            self._forward_way,
            values,
            gradients,
            states,
            spectra,
        )

    def _run_split(self, given: Floats, values: Floats, gradients: Floats, states: Floats, spectra: Complexes) -> int:
        """Return the same with the user's terms between forward kernel and pullback."""
        status = kernel.forward(self._core, self._room.steps, given, self._codes, True, values, states, spectra)
        if status == FULL:
            return status
        slopes = self._shared.slopes[: values.size * spectra.size].reshape(values.size, *spectra.shape)
        direct: dict[int, Floats | float] = {}
        for number, name in enumerate(self._own):
            term, row = self._user_terms[name], self._terms.index(name)
            if self._defined(term, status):
                value, in_states, in_spectra, direct[row] = term.function(self._shared.theta, states, spectra)
                values[row], self._shared.user_slopes[number] = value, in_states
                if status == OK:  # the slopes of a failed solve, which are zero here, are laid out in another way
                    slopes[row] = in_spectra
        kernel.pull_back(self._core, self._room.steps, self._codes, self._forward_way, values, gradients)
        for row, gradient in direct.items():
            gradients[row, : np.size(gradient)] += gradient
        return status

    def _defined(self, term: ArrayTerm, status: int) -> bool:
        """Whether a user's term has a value after a solve that ended like this."""
        return status == OK or (bool(self._core.setup.stabilise) and not term.needs_solve)

    def _make_dense_room(self, capacity: int, outputs: int) -> Room:
        return Room(self._core.net, self._method, capacity, outputs, recorded=False)

    def _outputs(self) -> tuple[Floats, Complexes]:
        """Return new arrays for a trajectory `(N, n)` and its spectra `(T, n)`."""
        n = self._core.net.n
        return np.empty((self._times.size, n)), np.empty(self._spectra_shape, dtype=np.complex128)

    def _make_room(self, capacity: int) -> Room:
        return Room(self._core.net, self._method, capacity, self._times.size, recorded=True)

    def _grow(self) -> None:
        self._room = self._make_room(min(2 * self._room.steps.capacity, self._method.max_steps))

    def _load(self, theta: Floats) -> None:
        if np.shape(theta) != self._shared.theta.shape:
            raise ValueError(f"theta has shape {np.shape(theta)}, there are {self._shared.theta.size} parameters")
        self._shared.theta[:] = theta

    def _checked(self, steps: Floats) -> Floats:
        given = np.array(steps, dtype=np.float64)
        horizon = self._times[-1] - self._times[0]
        smallest = np.nextafter(0.0, 1.0) if self._drive is None else 0.0  # none of no length, but behind jumps
        if given.ndim != 1 or not (given >= smallest).all() or not abs(given.sum() - horizon) <= 1e-9 * horizon:
            raise ValueError(f"steps must be positive and add up to the horizon of {horizon} s")
        return given

    def _signature(self, name: str) -> tuple[Any, ...]:
        """Types of the arguments of a kernel."""
        states, spectra = self._outputs()
        values, gradients = np.empty(1), np.empty((1, 1))
        solve = (self._core, self._room.steps, NO_STEPS)
        ways, results = (self._codes, True, True), (gradients, states, spectra)
        update = Update(0, values, 0, values, gradients, values, gradients, 1.0, values, values, self._codes, values)
        arguments = {
            "advance": (*solve, *ways, update, values, True, values, *results, gradients, self._codes),
            "loss_jacobian": (*solve, *ways, values, *results),
            "forward": (*solve, self._codes, True, values, states, spectra),
            "pull_back": (*solve[:2], self._codes, True, values, gradients),
            "evaluate": (*solve, self._codes, values, states, spectra, self._room.steps, NO_STEPS, values, states),
        }
        return tuple(numba.typeof(argument) for argument in arguments[name])


def _check(shape: MlpShape, problem: Problem, missing: set[str], sensitivity: str) -> None:
    """Raise a ValueError for what does not fit together."""
    if missing:
        raise ValueError(f"terms {', '.join(sorted(missing))}: not of {', '.join(NAMES)}, and no user terms")
    if sensitivity not in SENSITIVITIES:
        raise ValueError(f"sensitivity={sensitivity}: choose from {', '.join(SENSITIVITIES)}")
    if problem.data.states != shape.states:
        raise ValueError(f"the data has {problem.data.states} states, the network {shape.states}")
