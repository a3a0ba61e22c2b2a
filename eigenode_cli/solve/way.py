"""Which method takes the steps of a solve: a Rosenbrock method, or an explicit and an implicit one by turns."""

import torch
from torch import Tensor

from eigenode_cli.solve.explicit import attempt_explicit, spectral_radius
from eigenode_cli.solve.rosenbrock import Attempt, Start, Timed, attempt, start_of
from eigenode_cli.solve.rosenbrock_tableau import ROSENBROCK
from eigenode_cli.solve.switching import EXPLICIT, IMPLICIT, switched
from eigenode_cli.solve.tableau import TABLEAUS

AUTO = "auto"
STIFF = (*ROSENBROCK, AUTO)
"""The methods here by the name that `solver=` takes."""


class Way:
    """The method of the next step.

    Args:
        name: one of `STIFF`.

    Attributes:
        implicit: whether it is a Rosenbrock method.
        switches: how often that has changed.
    """

    def __init__(self, name: str) -> None:
        self._changes, self._count = name == AUTO, 0
        self._tableau = ROSENBROCK[IMPLICIT if self._changes else name]
        self._explicit = TABLEAUS[EXPLICIT]
        self.implicit, self.switches = not self._changes, 0

    @property
    def order(self) -> int:
        """Order for the step-size control."""
        return self._tableau.order if self.implicit else self._explicit.order

    def start(self, field: Timed, time: Tensor, state: Tensor) -> Start:
        """Return what all attempts at a step from `state (n,)` share; no derivatives where it is explicit."""
        if self.implicit:
            return start_of(field, time, state)
        none = torch.empty(0, dtype=state.dtype)
        return Start(time, state, none, none, none)

    def attempt(self, field: Timed, start: Start, size: float) -> Attempt | None:
        """Try a step of `size` in s; None where its matrix is singular."""
        if not self.implicit:
            return attempt_explicit(self._explicit, field, start.time, start.state, size)
        tried = attempt(self._tableau, field, start, size)
        if tried is None or not self._changes:
            return tried
        return Attempt(tried.end, tried.error, tried.dense, spectral_radius(start.jacobian))

    def decide(self, reach: float) -> None:
        """Choose the method of the next step after one with this `|h lambda|`."""
        if self._changes:
            before = self.implicit
            self.implicit, self._count = switched(self.implicit, self._count, reach)
            self.switches += self.implicit != before
