"""What an engine is: parameters in, loss Jacobian out. Trainer, combinations and recorder know nothing else of it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.solve.status import Status

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

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """Values of all terms at `theta (P,)`, and the states at `times (D,)` in s, ascending, from 0."""
        ...
