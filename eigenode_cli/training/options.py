"""How long a training lasts, when it ends before its last step, and which of its weights are kept."""

import math
from dataclasses import dataclass

from eigenode_cli.training.progress import Progress

LAST, BEST = "last", "best"


@dataclass(frozen=True)
class Stopping:
    """Rules that are asked at every record; None where one does not apply.

    Attributes:
        patience: records without a new lowest sum of the scaled terms.
        sol: SOL that is low enough.
        seconds: training time in s.
    """

    patience: int | None = None
    sol: float | None = None
    seconds: float | None = None

    def reason(self, progress: Progress, sol: float) -> str | None:
        """Return why a training stops at the record where it stands, with this SOL; None where it goes on."""
        if self.patience is not None and progress.records_since_best >= self.patience:
            return f"no lower sum of the terms in {self.patience} records, the lowest was at step {progress.best_step}"
        if self.sol is not None and sol <= self.sol:
            return f"sol is {sol:.3g}, at most {self.sol:g}"
        if self.seconds is not None and progress.train_seconds >= self.seconds:
            return f"{self.seconds:g} s of training are over"
        return None


RETRY = "retry"
"""What to do when a solve fails: half of the step, from the last parameters that could be solved."""


@dataclass(frozen=True)
class TrainerOptions:
    """Length of a training and what is written.

    Attributes:
        steps: training steps.
        record_every: steps between records.
        checkpoint_every: steps between checkpoints.
        on_unsolvable: what to do when a solve fails: stabilise | retry | skip | stop.
        keep: which weights are the result: those of the `last` step, or of the `best` record.
        stopping: when to end before the last step.
    """

    steps: int = 5000
    record_every: int = 25
    checkpoint_every: int = 500
    on_unsolvable: str = "stabilise"
    keep: str = LAST
    stopping: Stopping = Stopping()


def note_record(progress: Progress, total: float) -> bool:
    """Take note of the sum of the scaled terms at a record; returns whether it is the lowest so far."""
    lowest = math.inf if progress.best_total is None else progress.best_total
    if total < lowest:
        progress.best_step, progress.best_total, progress.records_since_best = progress.step, total, 0
        return True
    progress.records_since_best += 1
    return False
