"""What the spectral terms compare the spectrum with: the truth's along its trajectory, or stated values."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from eigenode_cli.arrays import Complexes, Floats, Integers
from eigenode_cli.data.simulate import Truth
from eigenode_cli.spectra.pairs import (
    REAL,
    ROUNDING,
    find_partners,
    rounding_levels,
    target_eigenvalue,
    without_rounding,
)
from eigenode_cli.spectra.stiffness import stiffness_ratio


@dataclass(frozen=True)
class Targets:
    """Targets of T spectra, one row each; K is the most pairs of a row.

    Attributes:
        frequency: of each pair in Hz `(T, K)`, ascending in a row, NaN behind the last.
        damping: damping ratio of the same pairs `(T, K)`.
        pairs: number of pairs `(T,)`.
        stiffness: corridor of the stiffness ratio `(T, 2)`; infinite where the target's ratio is.
        frequency_tolerance, damping_tolerance: half-widths of ranges around the two `(T, K)`, by default zero: values
            to be met.
        region: what `stp` compares with, see `solve.stability.region_of`; empty for nothing.
    """

    frequency: Floats
    damping: Floats
    pairs: Integers
    stiffness: Floats
    frequency_tolerance: Floats = field(default_factory=lambda: np.empty(0))
    damping_tolerance: Floats = field(default_factory=lambda: np.empty(0))
    region: Floats = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Make values of what has no range."""
        for name in ("frequency_tolerance", "damping_tolerance"):
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros_like(self.frequency))

    @property
    def arrays(self) -> tuple[Floats, Floats, Integers, Floats, Floats, Floats, Floats]:
        """All of them, in this order."""
        return (
            self.frequency,
            self.damping,
            self.pairs,
            self.stiffness,
            self.frequency_tolerance,
            self.damping_tolerance,
            self.region,
        )

    def rows(self, index: Integers) -> "Targets":
        """Return the targets of the spectra with these indices, which may repeat."""
        return Targets(
            frequency=self.frequency[index],
            damping=self.damping[index],
            pairs=self.pairs[index],
            stiffness=self.stiffness[index],
            frequency_tolerance=self.frequency_tolerance[index],
            damping_tolerance=self.damping_tolerance[index],
            region=self.region,
        )


class Target(Protocol):
    """Where targets come from."""

    def spectra(self, times: Floats) -> Complexes:
        """Return the eigenvalues in 1/s to be compared with at `times (T,)` in s, `(T, .)`."""
        ...

    def rows(self, times: Floats) -> Targets:
        """Return the targets of the spectra at `times (T,)` in s."""
        ...

    def resting(self, times: Floats) -> tuple[Complexes, Targets]:
        """Return the eigenvalues in 1/s to be compared with at the equilibrium `(.,)`, and their targets, one row.

        Raises:
            ValueError: the truth has no equilibrium near its trajectory at `times (T,)` in s.
        """
        ...


@dataclass(frozen=True)
class TruthTarget:
    """The truth's spectrum along its own trajectory.

    Attributes:
        truth: the system and its initial state.
        frequency_factor: factor on its frequencies: anything but 1 trains on a wrong target, to see what that costs.
        stiffness: corridor of the stiffness ratio in place of its own, None for that.
    """

    truth: Truth
    frequency_factor: float = 1.0
    stiffness: tuple[float, float] | None = None

    def spectra(self, times: Floats) -> Complexes:
        """See `Target.spectra`."""
        return self._found(times)[0]

    def rows(self, times: Floats) -> Targets:
        """See `Target.rows`."""
        return _with_corridor(targets_of_spectra(*self._found(times)), self.stiffness)

    def resting(self, times: Floats) -> tuple[Complexes, Targets]:
        """See `Target.resting`."""
        from eigenode_cli.spectra.equilibrium import zero_of  # noqa: PLC0415  # torch, where it is needed

        system = self.truth.system
        rest = zero_of(system.dynamics, system.jacobian, self.truth.states(times))
        if rest is None:
            raise ValueError(f"{system.title} has no equilibrium near its trajectory")
        spectra, levels = self._at(rest[None])
        return spectra[0], _with_corridor(targets_of_spectra(spectra, levels), self.stiffness)

    def _found(self, times: Floats) -> tuple[Complexes, Floats]:
        return self._at(self.truth.states(times))

    def _at(self, states: Floats) -> tuple[Complexes, Floats]:
        """Return the spectra at `states (T, n)` and their rounding levels `(T,)`.

        With a frequency factor each pair has its frequency times the factor, and its damping ratio, so that it is
        scaled as a whole; real eigenvalues stay.
        """
        matrices = self.truth.system.jacobian(states)
        levels, factor = rounding_levels(matrices), self.frequency_factor
        spectra = without_rounding(np.linalg.eigvals(matrices).astype(np.complex128), levels)
        return np.where(spectra.imag == 0.0, spectra, factor * spectra), levels * min(factor, 1.0)


Stated = float | tuple[float, float]
"""A value to be met, or the ends of a range to be kept to."""


@dataclass(frozen=True)
class StatedTarget:
    """Pairs that the user states, the same at all times.

    Attributes:
        frequency: damped frequency |Im|/2 pi of each pair in Hz: a value, or a range (low, high).
        damping: damping ratio of each, in the same order: a value, or a range.
        stiffness: corridor of the stiffness ratio, None for that of the stated pairs.
    """

    frequency: Sequence[Stated] = ()
    damping: Sequence[Stated] = ()
    stiffness: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check that each pair has both numbers."""
        if len(self.frequency) != len(self.damping):
            raise ValueError(f"{len(self.frequency)} frequencies and {len(self.damping)} damping ratios")

    def spectrum(self) -> tuple[Complexes, float]:
        """Return the eigenvalues `(2 K,)` in 1/s, upper members first, and their rounding level in 1/s.

        Of a range they are those of its middle. The size behind that level is that of the normal matrix with these
        eigenvalues: their 2-norm.
        """
        pairs = zip(_middles(self.frequency)[0], _middles(self.damping)[0], strict=True)
        upper = np.array([target_eigenvalue(*pair) for pair in pairs], dtype=np.complex128)
        spectrum = np.concatenate([upper, upper.conj()])
        return spectrum, ROUNDING * float(np.linalg.norm(spectrum))

    def spectra(self, times: Floats) -> Complexes:
        """See `Target.spectra`."""
        return np.tile(self.spectrum()[0], (times.size, 1))

    def rows(self, times: Floats) -> Targets:
        """See `Target.rows`; the stiffness ratio is that of the stated pairs, and there is none without a pair."""
        count = times.size
        (frequency, wide), (damping, broad) = _middles(self.frequency), _middles(self.damping)
        order = np.argsort(frequency, kind="stable")
        stiffness = stiffness_ratio(*self.spectrum()) if frequency.size else np.inf
        targets = Targets(
            frequency=np.tile(frequency[order], (count, 1)),
            damping=np.tile(damping[order], (count, 1)),
            pairs=np.full(count, frequency.size, dtype=np.int64),
            stiffness=np.full((count, 2), stiffness),
            frequency_tolerance=np.tile(wide[order], (count, 1)),
            damping_tolerance=np.tile(broad[order], (count, 1)),
        )
        return _with_corridor(targets, self.stiffness)

    def resting(self, times: Floats) -> tuple[Complexes, Targets]:
        """See `Target.resting`."""
        del times
        return self.spectrum()[0], self.rows(np.zeros(1))


def _middles(stated: Sequence[Stated]) -> tuple[Floats, Floats]:
    """Return the middle of each stated value or range `(K,)`, and half of its width."""
    ends = np.array([(one, one) if isinstance(one, float | int) else one for one in stated], dtype=np.float64)
    low, high = ends.reshape(-1, 2).T
    return np.where(low == high, low, 0.5 * (low + high)), 0.5 * (high - low)


def _with_corridor(targets: Targets, stiffness: tuple[float, float] | None) -> Targets:
    if stiffness is not None:
        targets.stiffness[:] = stiffness
    return targets


def targets_of_spectra(spectra: Complexes, levels: Floats | None = None) -> Targets:
    """Return the targets that follow from given spectra `(T, n)` in 1/s: pairs, frequency and damping, stiffness.

    `levels (T,)` are their rounding levels in 1/s, None for spectra that are exact.
    """
    levels = np.zeros(spectra.shape[0]) if levels is None else levels
    count, n = spectra.shape
    frequency = np.full((count, max(1, n // 2)), np.nan)
    damping = np.full_like(frequency, np.nan)
    pairs = np.zeros(count, dtype=np.int64)
    stiffness = np.zeros((count, 2))
    partner = np.empty(n, dtype=np.int64)
    for t, (spectrum, level) in enumerate(zip(np.ascontiguousarray(spectra), levels.tolist(), strict=True)):
        pairs[t] = find_partners(spectrum, level, partner)
        upper = spectrum[(partner != REAL) & (spectrum.imag > 0.0)]
        upper = upper[np.argsort(upper.imag, kind="stable")]
        frequency[t, : upper.size] = upper.imag / (2.0 * np.pi)
        damping[t, : upper.size] = -upper.real / np.abs(upper)
        stiffness[t] = stiffness_ratio(spectrum, level)
    return Targets(frequency=frequency, damping=damping, pairs=pairs, stiffness=stiffness)
