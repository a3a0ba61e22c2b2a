"""What is known of a system: observed states, and what its spectrum is compared with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.solve.times import checked_times

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Data:
    """Observations of a system.

    Attributes:
        times: data times in s `(N,)`, ascending, the first is that of the initial state.
        states: states at those times `(N, n)`.
        mask: which entries of `states` are observed, so that SOL compares them `(N, n)`.

    Raises:
        ValueError: the times are not finite and ascending.
    """

    times: Floats
    states: Floats
    mask: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Check the times and make them float64."""
        object.__setattr__(self, "times", checked_times(self.times))

    @property
    def seen(self) -> Floats:
        """What is known of the states `(N, n)`: NaN where nothing is observed, but for the initial state."""
        seen = np.where(self.mask, self.states, np.nan)
        seen[0] = self.states[0]
        return seen


@dataclass(frozen=True)
class Targets:
    """What the spectral terms compare the spectra with, one row a spectrum (T rows, K the most pairs of a row).

    Attributes:
        frequency: of each pair in Hz `(T, K)`, ascending in a row, NaN behind the last.
        damping: damping ratio of the same pairs `(T, K)`.
        pairs: number of pairs `(T,)`.
        stiffness: corridor of the stiffness ratio `(T, 2)`; infinite where the target's ratio is.
    """

    frequency: Floats
    damping: Floats
    pairs: NDArray[np.int64]
    stiffness: Floats

    def rows(self, index: NDArray[np.int64]) -> "Targets":
        """The targets of the spectra with these indices, which may repeat."""
        return Targets(self.frequency[index], self.damping[index], self.pairs[index], self.stiffness[index])
