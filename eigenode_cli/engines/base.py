"""What an engine is: parameters in, loss Jacobian out. Trainer, combinations and recorder know nothing else of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.solve.status import SOLVED, Status
from eigenode_cli.training.update import Rule, learn

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class LossJacobian:
    """Values and parameter gradients of the named terms from one solve (the paper's Equ. multigrad).

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
class ArrayTerm:
    """A user's own term on arrays, with its derivatives, as the compiled engine takes it.

    Attributes:
        function: `(theta (P,), trajectory (N, n), spectra (T, n))` to value, `dl/dx (N, n)`, `dl/dRe + i dl/dIm
            (T, n)`, and the derivative in theta at constant trajectory and spectra `(P,)`, 0 where it has none.
        needs_solve: whether it looks at trajectory or spectra, so that it is undefined where a solve fails.
    """

    function: Callable[[Floats, Floats, Complexes], tuple[float, Floats, Complexes, Floats | float]]
    needs_solve: bool = True


class Engine(Protocol):
    """Both engines implement this and nothing more."""

    name: str
    """As in `engine=`."""

    @property
    def compile_seconds(self) -> float:
        """Time spent on compilation so far."""
        ...

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        """Values and gradients of the named terms at the parameters `theta (P,)`."""
        ...

    def advance(self, theta: Floats, rule: Rule, rates: Floats, halt: bool) -> Advance:
        """Take training steps with the learning rates `rates (K,)`, at least one, and all that need no Python between.

        Args:
            theta: parameters `(P,)`, changed in place.
            rule: how the gradients change them.
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


def single_step(engine: Engine, theta: Floats, rule: Rule, rates: Floats, halt: bool) -> Advance:
    """`Engine.advance` by one step, for engines that need Python in each."""
    jacobian = engine.loss_jacobian(theta)
    if jacobian.status in SOLVED or not halt:
        learn(rule, theta, jacobian.gradients, rates[0])
    return Advance(jacobian.values[None], np.array([jacobian.status]), jacobian.guard_count)
