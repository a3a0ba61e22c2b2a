"""Everything about a training that both engines read, besides the vector field: plain arrays and numbers."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import Targets
from eigenode_cli.solve.settings import AdaptiveSolver, Solver
from eigenode_cli.terms import NAMES, PAPER_TERMS, SPECTRAL

REACH = 10.0
"""A failed solve stabilises with the states that it reached within this multiple of the data's range. Farther out the
field has left what the data speak of, and its gradients would be of a size that spoils the optimizer's memory."""


@dataclass(frozen=True)
class Problem:
    """One training problem: a measured trajectory with its targets, and what is asked of it.

    Attributes:
        data: measurements; the model starts from `data.initial_state`, whose unknown entries are the last parameters.
        targets: one row for every spectrum.
        terms: names of the terms whose gradients are wanted, canonical order `(L,)`.
        every: spectra are taken at `data.times[::every]`.
        states: states at the data times `(N, n)`, measured or reconstructed, at which spectra are taken where nothing
            is solved; None where they are not known.
        errors: error function of each term of the registry, codes of `terms.errors` `(len(NAMES),)`; `huber_delta` its
            threshold.
        margin: stability margin in 1/s.
        max_condition: guard on eigenvalue condition numbers.
        jacobian: autodiff | finite_difference | symbolic (the compiled engine computes the exact one).
        solver: method and tolerances.
        stabilise: whether a failed solve still gives the spectral terms, on the part that was reached and on `states`
            together, both held constant; otherwise all terms of a failed solve are NaN.
        solved: whether anything is solved at all. If not, every loss Jacobian has the status `UNSOLVED` and gives the
            spectral terms, at `states` alone.
        resting: targets of the spectrum at the equilibrium, one row, where the terms that compare with a target are
            taken there and not along the trajectory; None for that.
        others: further trajectories, each with the same settings, and none with others of its own.

    Raises:
        ValueError: spectra are to be taken at `states` that are not known, or there is no error function for each term.
    """

    data: Series
    targets: Targets
    terms: tuple[str, ...] = PAPER_TERMS
    every: int = 1
    states: Floats | None = None
    errors: Integers = field(default_factory=lambda: np.zeros(len(NAMES), dtype=np.int64))
    huber_delta: float = 1.0
    margin: float = 0.0
    max_condition: float = 1e4
    jacobian: str = "autodiff"
    solver: Solver = field(default_factory=AdaptiveSolver)
    stabilise: bool = True
    solved: bool = True
    resting: Targets | None = None
    others: "tuple[Problem, ...]" = ()

    def __post_init__(self) -> None:
        """Take measured states where all are; check that there are any where they are needed."""
        if self.errors.shape != (len(NAMES),):
            raise ValueError(f"errors has shape {self.errors.shape}; give one code for each of {', '.join(NAMES)}")
        if self.states is None and np.isfinite(self.data.seen).all():
            object.__setattr__(self, "states", self.data.seen)
        known = self.states is not None and np.isfinite(self.states).all()
        needed = not self.solved or (self.stabilise and not set(SPECTRAL).isdisjoint(self.terms))
        if needed and not known:
            raise ValueError(
                "spectra at the data times need all states there: measure them, let them be reconstructed"
                " (data.reconstruct), or set stabilise=False"
            )

    @cached_property
    def spectral_index(self) -> Integers:
        """Indices of the data times at which spectra are taken `(T,)`."""
        return np.arange(0, self.data.times.size, self.every)

    @property
    def measured(self) -> int:
        """Number of measured values, which SOL compares."""
        return int(self.data.channel_mask.sum())

    @property
    def sizes(self) -> Floats:
        """Largest known modulus of each state `(n,)`; 1 where nothing is known."""
        sizes = self.data.sizes if self.states is None else np.nan_to_num(np.abs(self.states)).max(axis=0)
        return np.where(sizes > 0.0, sizes, 1.0)

    @property
    def trajectories(self) -> "tuple[Problem, ...]":
        """Each trajectory as a problem of its own."""
        return (replace(self, others=()), *self.others)

    def changed(self, **changes: Any) -> "Problem":
        """Return the same problem with settings changed, for all trajectories."""
        return replace(self, **changes, others=tuple(replace(other, **changes) for other in self.others))

    def until(self, fraction: float) -> "Problem":
        """Return the same problem over the leading `fraction` of the horizon, at least three data times of it."""
        times = self.data.times
        end = times[0] + fraction * (times[-1] - times[0])
        count = min(times.size, max(3, int(np.searchsorted(times, end * (1.0 + 1e-12), side="right"))))
        states = None if self.states is None else self.states[:count]
        targets = self.targets.rows(np.arange(-(-count // self.every)))
        others = tuple(other.until(fraction) for other in self.others)
        return replace(self, data=self.data.leading(count), states=states, targets=targets, others=others)

    def unsolved(self) -> "Problem":
        """Return the spectral terms of the same problem at `states`, without a solve."""
        return self.changed(solved=False, stabilise=True)

    def stabilising_rows(self, reached: Floats) -> Integers:
        """Return which spectra a failed solve that reached these states `(R, n)` still contributes, rows of `targets`.

        They are the leading ones, up to the first state that lies farther out than `REACH` times the data.
        """
        index = self.spectral_index
        rows = np.arange(np.searchsorted(index, reached.shape[0]))
        inside = (np.abs(reached[index[rows]]) <= REACH * self.sizes).all(axis=1)
        return rows[np.logical_and.accumulate(inside)]
