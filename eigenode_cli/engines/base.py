"""What an engine is: parameters in, loss Jacobian out. Trainer, combinations and recorder know nothing else of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update, train_step
from eigenode_cli.solve.status import SOLVED, Status
from eigenode_cli.terms import NAMES, SPECTRAL


@dataclass(frozen=True)
class LossJacobian:
    """Values and parameter gradients of the named terms from one solve (the paper's Equ. 13).

    Attributes:
        values: of the L named terms `(L,)`, unscaled; NaN where a failed solve leaves a term undefined.
        gradients: their derivatives in the P parameters `(L, P)`; a row of NaN where undefined.
        trajectory: states at the data times `(N, n)`; NaN where the solve did not arrive.
        spectra: eigenvalues in 1/s at every `eigen.every`-th data time `(T, n)`; NaN where not reached, and everywhere
            if no term but SOL is named.
        status: how the solve ended.
        n_accepted, n_rejected: solver steps.
        guard_count: eigenvalue sensitivities that the condition guard bounded.
    """

    values: Floats
    gradients: Floats
    trajectory: Floats
    spectra: Complexes
    status: Status
    n_accepted: int
    n_rejected: int
    guard_count: int


@dataclass(frozen=True)
class Evaluation:
    """All six terms (and the user's own) without gradients, for the record.

    Attributes:
        values: of every term the engine knows, canonical order `(6 + user's,)`; NaN where undefined.
        trajectory, spectra, status, n_accepted, n_rejected: as in `LossJacobian`.
        dense: states at the times asked for `(D, n)`; NaN where not reached.
    """

    values: Floats
    trajectory: Floats
    spectra: Complexes
    status: Status
    n_accepted: int
    n_rejected: int
    dense: Floats

    @property
    def max_real(self) -> float:
        """Largest real part of any eigenvalue along the trajectory in 1/s; NaN where there is no spectrum."""
        real = self.spectra.real
        return float(np.nanmax(real)) if np.isfinite(real).any() else float("nan")


@dataclass(frozen=True)
class Advance:
    """Training steps that an engine took by itself.

    Attributes:
        values: of the named terms at each step `(K, L)`, unscaled.
        statuses: how each solve ended `(K,)`, codes of `Status`.
        guard_count: eigenvalue sensitivities that the condition guard bounded.
    """

    values: Floats
    statuses: NDArray[np.int64]
    guard_count: int


@dataclass(frozen=True)
class ResidualJacobian:
    """Residuals of the named terms and their derivatives in the parameters, as least squares needs them.

    SOL has one residual for every measured value, the difference itself. A spectral term has one for every spectrum:
    the root of the term's value there with squares as errors, zero where nothing is compared.

    Attributes:
        residuals: of all terms one behind the other `(R,)`; meaningless unless the solve succeeded.
        jacobian: their derivatives `(R, P)`; `(0, P)` where they were not asked for.
        rows: which residuals are those of a term, by its name.
        values: of the named terms `(L,)`, unscaled, with their own error functions.
        status: how the solve ended.
        n_accepted: solver steps.
    """

    residuals: Floats
    jacobian: Floats
    rows: Mapping[str, slice]
    values: Floats
    status: Status
    n_accepted: int


def residual_rows(problem: Problem) -> dict[str, slice]:
    """Return which residuals are those of each named term.

    Raises:
        ValueError: nothing is solved, or a term is none of the six.
    """
    if not problem.solved or not set(problem.terms) <= set(NAMES):
        raise ValueError("residuals are those of the six terms along a solution")
    rows, start = {}, 0
    for term in problem.terms:
        count = problem.spectral_index.size if term in SPECTRAL else problem.measured
        rows[term] = slice(start, start + count)
        start += count
    return rows


class Engine(Protocol):
    """What an engine offers; `engine=` names the two that there are."""

    name: str
    """As in `engine=`."""

    @property
    def compile_seconds(self) -> float:
        """Time spent on compilation so far."""
        ...

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        """Values and gradients of the named terms at the parameters `theta (P,)`."""
        ...

    def residual_jacobian(self, theta: Floats, differentiated: bool = True) -> ResidualJacobian:
        """Return residuals of the named terms and, where they are `differentiated`, their derivatives at `theta (P,)`.

        Raises:
            ValueError: nothing is solved, or a named term is none of the six.
        """
        ...

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """Take training steps with the learning rates `rates (K,)`, at least one, and all that need no Python between.

        Args:
            theta: parameters `(P,)`, changed in place.
            update: how the gradients change them.
            rates: learning rate of each step.
            halt: end behind a solve that failed, and leave the parameters as they were for it.
        """
        ...

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """Values of all terms at `theta (P,)`, and the states at `times (D,)` in s.

        Raises:
            ValueError: the times are not finite and ascending from that of the initial state.
        """
        ...


def unheard(_message: str) -> None:
    """Announce nothing, where nobody is told that an engine compiles."""


def single_step(engine: Engine, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
    """`Engine.advance` by one step, for engines that need Python in each."""
    jacobian = engine.loss_jacobian(theta)
    if jacobian.status in SOLVED or not halt:
        train_step(update, theta, jacobian.gradients, rates[0], jacobian.status in SOLVED)
    return Advance(jacobian.values[None], np.array([jacobian.status]), jacobian.guard_count)
