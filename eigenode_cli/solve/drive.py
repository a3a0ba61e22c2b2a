"""A known input `u(t)` that drives a system: its samples, held or interpolated between them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.solve.times import checked_times

HOLDS = ("linear", "zero")
STRAIGHT = 1e-9
"""Two pieces are one if their slopes differ by less, relative to the largest slope."""


@dataclass(frozen=True)
class Drive:
    """Samples of k inputs.

    Before the first sample and behind the last one an input keeps its first and last value.

    Attributes:
        times: of the samples in s `(M,)`, ascending.
        values: `(M, k)`.
        hold: between the samples: `linear` (straight lines) | `zero` (each value is held until the next sample).

    Raises:
        ValueError: shapes do not fit, a value is not finite, or there is no such hold.
    """

    times: Floats
    values: Floats
    hold: str = "linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", checked_times(self.times))
        object.__setattr__(self, "values", np.ascontiguousarray(self.values, dtype=np.float64))
        if self.values.ndim != 2 or self.values.shape[0] != self.times.size:
            raise ValueError(f"inputs have shape {self.values.shape}, there are {self.times.size} times")
        if not np.isfinite(self.values).all():
            raise ValueError(f"input {int(np.argwhere(~np.isfinite(self.values))[0][1])} is not finite everywhere")
        if self.hold not in HOLDS:
            raise ValueError(f"hold={self.hold}: choose from {', '.join(HOLDS)}")

    @property
    def inputs(self) -> int:
        """Number of inputs k."""
        return self.values.shape[1]

    @cached_property
    def pieces(self) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
        """Straight pieces: starts in s `(S,)`, values there and slopes `(S, k)`, whether an input jumps there `(S,)`.

        The first piece starts at the first sample and stands for all times before it as well.
        """
        first = np.concatenate([[True], np.diff(self.times) > 0.0])
        times, values = self.times[first], self.values[first]
        slopes = np.zeros_like(values)
        if self.hold == "linear" and times.size > 1:
            slopes[:-1] = np.diff(values, axis=0) / np.diff(times)[:, None]
        change = np.diff(slopes if self.hold == "linear" else values, axis=0)
        kept = np.concatenate([[True], (np.abs(change) > STRAIGHT * np.abs(slopes).max(initial=0.0)).any(axis=1)])
        if times.size > 1 and np.abs(slopes[0]).any():  # held before the first sample
            times, values = np.concatenate([times[:1] - 1.0, times]), np.concatenate([values[:1], values])
            slopes, kept = np.concatenate([np.zeros_like(slopes[:1]), slopes]), np.concatenate([[True], kept])
        jumps = np.full(int(kept.sum()), self.hold == "zero")
        jumps[0] = False
        return times[kept], values[kept], slopes[kept], jumps

    def at(self, times: Floats) -> Floats:
        """Return the inputs `(N, k)` at `times (N,)` in s; where one jumps its value behind the jump."""
        starts, values, slopes, _ = self.pieces
        piece = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, starts.size - 1)
        since = np.maximum(np.asarray(times) - starts[piece], 0.0)
        return values[piece] + slopes[piece] * since[:, None]


def steps_to_knots(sizes: Floats, start: float, drive: Drive) -> Floats:
    """Return steps cut so that none goes over the start of a piece, and a step of no length behind every jump.

    Args:
        sizes: of the steps in s, one after another from `start`.
        start: time of their start in s.
        drive: the input.
    """
    ends = start + np.cumsum(sizes)
    starts, _, _, jumps = drive.pieces
    inside = (starts > start) & (starts < ends[-1])
    near = 1e-9 * float(sizes.max(initial=0.0))
    far = [end for end in ends[:-1] if np.abs(starts[inside] - end).min(initial=np.inf) > near]
    points = sorted([(end, False) for end in [*far, ends[-1]]] + list(zip(starts[inside], jumps[inside], strict=True)))
    found, before = [], start
    for point, jumped in points:
        found += [point - before, *([0.0] if jumped else [])]
        before = point
    return np.array(found)
