"""Whether two contestants compute the same thing: only then are their times compared."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.bench.contestants import Result

VALUES = 1e-6
"""Largest relative difference of a value at tight tolerance."""
GRADIENTS = 1e-4
"""Largest relative difference of a gradient at tight tolerance; near the merge of a pair it is steep."""

LOOSE_REASON = (
    "at the tolerances that are timed every contestant chooses its own steps and interpolation, so trajectories differ "
    "by the tolerance; a gradient of absolute errors also jumps where a difference changes its sign"
)
"""What differs at the tolerances that are timed."""


@dataclass(frozen=True)
class Agreement:
    """Relative differences of one contestant from ours.

    Attributes:
        values: of each term's value `(L,)`.
        gradients: norm of the difference over the norm, of each term's gradient `(L,)`.
        steps: accepted solver steps of the contestant.
    """

    values: Floats
    gradients: Floats
    steps: int

    @property
    def holds(self) -> bool:
        """Whether both compute the same, to be asked at tight tolerance."""
        return bool((self.values <= VALUES).all() and (self.gradients <= GRADIENTS).all())

    def as_json(self) -> dict[str, Any]:
        """As it stands in bench.json."""
        return {"values": self.values.tolist(), "gradients": self.gradients.tolist(), "steps": self.steps}


def agreement(result: Result, ours: Result) -> Agreement:
    """How far `result` is from `ours`; infinitely where it is not a number."""
    tiny = np.finfo(np.float64).tiny  # a term may be exactly zero in both
    values = np.abs(result.values - ours.values) / np.maximum(np.abs(ours.values), tiny)
    sizes = np.linalg.norm(ours.gradients, axis=1)
    gradients = np.linalg.norm(result.gradients - ours.gradients, axis=1) / np.maximum(sizes, tiny)
    return Agreement(*(np.where(np.isnan(part), np.inf, part) for part in (values, gradients)), steps=result.steps)
