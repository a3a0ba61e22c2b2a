"""How a run ends, and by which rule a training that took all its steps has diverged."""

import math
from dataclasses import dataclass

FINISHED, FAILED, STALLED, DIVERGED = "finished", "failed", "stalled", "diverged"
RUNNING, INTERRUPTED = "running", "interrupted"
UNSUCCESSFUL = (FAILED, STALLED, DIVERGED)
"""Statuses of runs that count as failures in every table."""
FINAL = (FINISHED, STALLED, DIVERGED)
"""Statuses that the same settings lead to again: such a run is not repeated, and there is nothing to resume."""
ENDED = (FINISHED, *UNSUCCESSFUL)
"""Statuses of runs that nobody works on any more."""
STATUSES = (RUNNING, FINISHED, FAILED, INTERRUPTED, STALLED, DIVERGED)
"""Every status in run.json."""

FACTOR = 100.0
"""A training has diverged where its last SOL is more than so many times the first one, and that of a model that stays
at zero. A bad fit ends at a few times the data, and a start far from them is no fault of the training."""
SMALLER = "try a smaller optimizer.lr"


@dataclass(frozen=True)
class Ending:
    """The status of a run, and why in one line where it is not `finished`."""

    status: str
    reason: str | None = None


def judge(first: float | None, last: float, failure: str | None, zero: float) -> Ending:
    """Return the ending of a training that took all its steps: finished or diverged.

    A field that can be solved neither at the start nor at the end has not diverged: it was wrong from the beginning.

    Args:
        first: SOL before the first step, None where that solve failed.
        last: SOL after the last step.
        failure: how the last solve failed, None where it did not.
        zero: SOL of a model that stays at zero, NaN where SOL does not train.
    """
    if failure is not None and first is not None:
        return Ending(DIVERGED, f"the solve fails at the end ({failure}), but not at the start; {SMALLER}")
    if not math.isnan(zero) and last > FACTOR * max(zero, first or 0.0):
        return Ending(DIVERGED, f"sol ends at {last:.3g}, that of a model that stays at zero is {zero:.3g}; {SMALLER}")
    return Ending(FINISHED)
