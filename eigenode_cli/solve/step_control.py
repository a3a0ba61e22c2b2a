"""Steps of one adaptive solve: their sizes, counts and ends."""

from dataclasses import dataclass, field

from eigenode_cli.solve.control import SMALLEST_RATIO, SMALLEST_STEP, next_step
from eigenode_cli.solve.status import Status


class SolveStopped(Exception):
    """Raised inside a solve that cannot go on; `solve` turns it into the status of the trajectory."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.label)
        self.status = status


@dataclass
class StepControl:
    """Step sizes by the controller of all methods, or given ones.

    Attributes:
        end: last output time in s.
        max_attempts: accepted and rejected steps after which the solve stops.
        replay: step sizes to take, each accepted without a question; None to choose them.
        proposed: size of the next step in s; the first one is set from outside.
        steps: sizes of the accepted steps in s; n_rejected: number of the others.
    """

    end: float
    max_attempts: int
    replay: list[float] | None = None
    proposed: float = 0.0
    steps: list[float] = field(default_factory=list)
    n_rejected: int = 0
    _last_ratio: float = SMALLEST_RATIO
    _last_finite: bool = True

    def size(self, start: float) -> tuple[float, bool]:
        """Return the size of the step from `start` in s, and whether it ends at the last output time.

        Raises:
            SolveStopped: there have been too many, or it is too small.
        """
        if self.replay is not None:
            return self.replay[len(self.steps)], len(self.steps) + 1 == len(self.replay)
        if len(self.steps) + self.n_rejected >= self.max_attempts:
            raise SolveStopped(Status.MAX_STEPS)
        # the step as proposed: what clipping leaves at the very end may be as small as rounding makes it
        if not self.proposed > SMALLEST_STEP * abs(start) or start + self.proposed == start:
            raise SolveStopped(Status.UNDERFLOW if self._last_finite else Status.NON_FINITE)
        clipped = start + self.proposed >= self.end
        return (self.end - start if clipped else self.proposed), clipped

    def accepts(self, size: float, ratio: float, order: int) -> bool:
        """Return whether a step with this error over the tolerance is accepted, and choose the next one.

        Raises:
            SolveStopped: a given step leads to what is not finite.
        """
        self._last_finite = ratio < float("inf")
        self.proposed = next_step(size, ratio, self._last_ratio, order)
        if self.replay is None and not ratio <= 1.0:
            self.n_rejected += 1
            return False
        if not self._last_finite:
            raise SolveStopped(Status.NON_FINITE)
        self._last_ratio = max(ratio, SMALLEST_RATIO)
        self.steps.append(size)
        return True
