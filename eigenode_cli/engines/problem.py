"""Everything about a training that both engines read, besides the vector field: plain arrays and numbers."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.data.dataset import Data, Floats, Targets
from eigenode_cli.solve.settings import Solver

REACH = 10.0
"""A failed solve stabilises with the states that it reached within this multiple of the data's range. Farther out the
field has left what the data speak of, and its gradients would be of a size that spoils the optimizer's memory."""


@dataclass(frozen=True)
class Problem:
    """One training problem.

    Attributes:
        data: observations; the trajectory starts at `data.states[0]` and is compared at `data.times`.
        targets: one row for every spectrum.
        every: spectra are taken at `data.times[::every]`.
        terms: names of the terms whose gradients are wanted, canonical order `(L,)`.
        errors: error function of each of the six terms `(6,)` (codes of `terms.errors`); `huber_delta` its threshold.
        margin: stability margin in 1/s.
        max_condition: guard on eigenvalue condition numbers.
        jacobian: autodiff | finite_difference | symbolic (the compiled engine computes the exact one).
        solver: method and tolerances.
        stabilise: whether a failed solve still gives the spectral terms, on the part that was reached and on the data
            states together, both held constant; otherwise all terms of a failed solve are NaN.
        solved: whether anything is solved at all. If not, every loss Jacobian has the status `UNSOLVED` and gives the
            spectral terms, at the data states alone.
    """

    data: Data
    targets: Targets
    every: int
    terms: tuple[str, ...]
    errors: NDArray[np.int64]
    huber_delta: float
    margin: float
    max_condition: float
    jacobian: str
    solver: Solver
    stabilise: bool
    solved: bool = True

    @cached_property
    def spectral_index(self) -> NDArray[np.int64]:
        """Indices of the data times at which spectra are taken `(T,)`."""
        return np.arange(0, self.data.times.size, self.every)

    @property
    def initial_state(self) -> Floats:
        """State at the first data time `(n,)`."""
        return self.data.states[0]

    def until(self, fraction: float) -> "Problem":
        """The same problem over the leading `fraction` of the horizon, at least three data times of it."""
        times = self.data.times
        end = times[0] + fraction * (times[-1] - times[0])
        count = max(3, int(np.searchsorted(times, end * (1.0 + 1e-12), side="right")))
        data = Data(times[:count], self.data.states[:count], self.data.mask[:count])
        return replace(self, data=data, targets=self.targets.rows(np.arange(-(-count // self.every))))

    def unsolved(self) -> "Problem":
        """The spectral terms of the same problem at the data states, without a solve."""
        return replace(self, solved=False, stabilise=True)

    def stabilising_rows(self, reached: Floats) -> NDArray[np.int64]:
        """Which spectra a failed solve that reached these states `(R, n)` still contributes, as rows of `targets`.

        The leading ones, up to the first state that lies farther out than `REACH` times the data.
        """
        index = self.spectral_index
        rows = np.arange(np.searchsorted(index, reached.shape[0]))
        limit = REACH * np.abs(self.data.states).max(axis=0)
        inside = (np.abs(reached[index[rows]]) <= limit).all(axis=1)
        return rows[np.logical_and.accumulate(inside)]
