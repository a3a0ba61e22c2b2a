"""Which method takes the steps of a solve: a Rosenbrock method, or an explicit and an implicit one by turns."""

from dataclasses import replace

import torch
from torch import Tensor

from eigenode_cli.solve.explicit import attempt_explicit, spectral_radius
from eigenode_cli.solve.rosenbrock import Attempt, Start, Timed, attempt, start_of
from eigenode_cli.solve.rosenbrock_tableau import RosenbrockTableau
from eigenode_cli.solve.switching import switched, tableaus_of
from eigenode_cli.solve.tableau import Tableau


class Way:
    """The method of the next step.

    Args:
        name: one of `switching.STIFF`.
    """

    def __init__(self, name: str) -> None:
        self._explicit, self._implicit = tableaus_of(name)
        self._now: Tableau | RosenbrockTableau = self._explicit or self._implicit
        self._in_a_row = 0

    @property
    def order(self) -> int:
        """Order for the step-size control."""
        return self._now.order

    def start(self, field: Timed, time: Tensor, state: Tensor) -> Start:
        """Return what all attempts at a step from `state (n,)` share; no derivatives where it is explicit."""
        if isinstance(self._now, RosenbrockTableau):
            return start_of(field, time, state)
        none = torch.empty(0, dtype=state.dtype)
        return Start(time, state, none, none, none)

    def attempt(self, field: Timed, start: Start, size: float) -> Attempt | None:
        """Try a step of `size` in s; None where its matrix is singular."""
        if not isinstance(self._now, RosenbrockTableau):
            return attempt_explicit(self._now, field, start.time, start.state, size)
        tried = attempt(self._now, field, start, size)
        if tried is None or self._explicit is None:
            return tried
        return replace(tried, fastest=spectral_radius(start.jacobian))

    def decide(self, reach: float) -> None:
        """Choose the method of the next step after one with this `|h lambda|`."""
        if self._explicit is not None:
            implicit, self._in_a_row = switched(self._now is self._implicit, self._in_a_row, reach)
            self._now = self._implicit if implicit else self._explicit
