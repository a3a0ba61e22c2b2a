"""Where a loss stood still: the local minima of a run, which the paper plots black-dashed."""

from dataclasses import dataclass

import numpy as np

from eigenode_cli.arrays import Floats

LENGTH = 0.1
"""Shortest plateau, as a fraction of all steps."""
CHANGE = 0.05
"""Largest relative change of the loss over a plateau."""
FEWEST = 5
"""Fewest records that show a plateau."""
SAME = 0.1
"""Two plateaus whose levels differ by no more than this fraction are one local minimum, visited twice."""


@dataclass(frozen=True)
class Plateau:
    """A stretch of steps over which the loss stood at one level."""

    start: float
    stop: float
    level: float


def plateaus(steps: Floats, values: Floats, solved: float) -> list[Plateau]:
    """Return the local minima of a loss, the longest stretch of each level, in order of the steps.

    A plateau lasts at least `LENGTH` of all steps and the loss changes over it by at most `CHANGE`. The level at which
    a run ends counts as well, as in the paper, where most runs end in a local minimum; but not a level at or below
    `solved`, which is the solution that was looked for. A record without a loss (a failed solve) ends a plateau.

    Args:
        steps: ascending `(R,)`.
        values: loss at those steps `(R,)`, NaN where not defined.
        solved: loss at or below which the training has reached what it was for.
    """
    if steps.size < FEWEST:
        return []
    shortest = LENGTH * (steps[-1] - steps[0])
    long = [(first, last) for first, last in _stretches(values, solved) if steps[last] - steps[first] >= shortest]
    found: list[Plateau] = []
    taken = np.zeros(steps.size, dtype=bool)
    for first, last in sorted(long, key=lambda stretch: steps[stretch[0]] - steps[stretch[1]]):
        level = float(np.median(values[first : last + 1]))
        if taken[first : last + 1].any() or any(abs(level - other.level) <= SAME * other.level for other in found):
            continue
        taken[first : last + 1] = True
        found.append(Plateau(float(steps[first]), float(steps[last]), level))
    return sorted(found, key=lambda plateau: plateau.start)


def _stretches(values: Floats, solved: float) -> list[tuple[int, int]]:
    """For each first record the last one up to which all losses lie within `CHANGE` of each other, above `solved`."""
    with np.errstate(invalid="ignore"):
        counts = np.isfinite(values) & (values > max(solved, 0.0))
    result: list[tuple[int, int]] = []
    stop = 0
    for first in np.flatnonzero(counts):
        # what holds from one record on holds from the next one on, so the end never moves back
        stop = max(stop, int(first) + 1)
        low, high = values[first:stop].min(), values[first:stop].max()
        while stop < values.size and counts[stop]:
            low, high = min(low, values[stop]), max(high, values[stop])
            if high - low > CHANGE * low:
                break
            stop += 1
        if stop - first >= FEWEST:
            result.append((int(first), stop - 1))
    return result
