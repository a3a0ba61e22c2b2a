"""The integrators of the torch engine: torchdiffeq's own, and Tsit5 within the same Runge-Kutta framework.

Three things are ours, for every adaptive method: the PI controller that both engines share, steps that are constants
for differentiation (torchdiffeq lets gradients leak through the choice of the first one), and a stage loop without
in-place tricks, so that forward-mode differentiation passes through a solve as well as reverse mode.
"""

from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchdiffeq._impl.dopri5 import Dopri5Solver
from torchdiffeq._impl.dopri8 import Dopri8Solver
from torchdiffeq._impl.fehlberg2 import Fehlberg2
from torchdiffeq._impl.fixed_grid import RK4, Euler, Heun3, Midpoint
from torchdiffeq._impl.misc import _compute_error_ratio, _rms_norm, _select_initial_step
from torchdiffeq._impl.rk_common import RKAdaptiveStepsizeODESolver, _ButcherTableau, _RungeKuttaState

from eigenode_cli.solve.status import Status
from eigenode_cli.solve.step_control import SolveStopped, StepControl
from eigenode_cli.solve.tableau import ADAPTIVE_HEUN, BOSH3, TSIT5, Tableau


class TableauSolver(RKAdaptiveStepsizeODESolver):
    """A method of `solve.tableau` with its own dense output."""

    dense: Tensor

    def _interp_fit(self, y0: Tensor, y1: Tensor, k: Tensor, dt: Tensor) -> list[Tensor]:
        del y1
        return [y0, *(dt * (k @ self.dense)).unbind(-1)]


class SteppedSolver(RKAdaptiveStepsizeODESolver):
    """Mixed in before one of torchdiffeq's adaptive methods: controls, counts and records its steps.

    Attributes:
        control: sizes of the steps, and their counts.
    """

    def prepare(self, control: StepControl) -> None:
        """Set what the constructor of torchdiffeq's classes has no place for."""
        self.control = control
        last_row, weights = self.tableau.beta[-1], self.tableau.c_sol
        self._same_as_last = bool(weights[-1] == 0 and torch.equal(weights[:-1], last_row))

    def _before_integrate(self, t: Tensor) -> None:
        start, y0 = t[0], self.y0
        f0 = self.func(start, y0)
        if not torch.isfinite(f0).all():
            raise SolveStopped(Status.NON_FINITE)
        with torch.no_grad():
            first = _select_initial_step(
                self.func, start, y0.detach(), self.order - 1, self.rtol, self.atol, self.norm, f0=f0.detach()
            )
        self.rk_state = _RungeKuttaState(y0, f0, start, start, first, [y0] * 5)

    def _adaptive_step(self, rk_state: Any) -> Any:
        y0, f0, _, start, proposed, interp_coeff = rk_state
        self.control.proposed = float(proposed)
        size, clipped = self.control.size(float(start))
        y1, f1, error, k = self._trial(float(start), y0, f0, size)
        if not self.control.accepts(size, self._error_ratio(y0, y1, f1, error), self.order):
            return _RungeKuttaState(y0, f0, start, start, _scalar(self.control.proposed), interp_coeff)
        end = _scalar(self.control.end) if clipped else start + size
        dense = self._interp_fit(y0, y1, k, _scalar(size))
        return _RungeKuttaState(y1, f1, start, end, _scalar(self.control.proposed), dense)

    def _trial(self, start: float, y0: Tensor, f0: Tensor, size: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        stages = [f0]
        y = y0
        for node, row in zip(self.tableau.alpha.tolist(), self.tableau.beta, strict=True):
            y = y0 + size * (torch.stack(stages, dim=-1) @ row)
            stages.append(self.func(start + node * size, y))
        k = torch.stack(stages, dim=-1)
        if self._same_as_last:
            y1, f1 = y, stages[-1]
        else:
            y1 = y0 + size * (k @ self.tableau.c_sol)
            f1 = self.func(start + size, y1)
        return y1, f1, size * (k.detach() @ self.tableau.c_error), k

    def _error_ratio(self, y0: Tensor, y1: Tensor, f1: Tensor, error: Tensor) -> float:
        with torch.no_grad():
            finite = bool(torch.isfinite(y1).all() and torch.isfinite(f1).all())
            ratio = float(_compute_error_ratio(error, self.rtol, self.atol, y0, y1, self.norm))
        return ratio if finite and ratio < float("inf") else float("inf")


def _scalar(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def _stepped(method: type[RKAdaptiveStepsizeODESolver]) -> type[SteppedSolver]:
    return type(method.__name__, (SteppedSolver, method), {})


@cache
def of_tableau(tableau: Tableau) -> type[SteppedSolver]:
    """Return the solver of a method, whose steps are chosen or given."""
    butcher = _ButcherTableau(
        alpha=torch.from_numpy(tableau.c[1:].copy()),
        beta=[torch.from_numpy(tableau.a[i, :i].copy()) for i in range(1, tableau.error.size)],
        c_sol=torch.from_numpy(tableau.b.copy()),
        c_error=torch.from_numpy(tableau.error.copy()),
    )
    middle = torch.from_numpy(tableau.dense @ (0.5 ** np.arange(1, 5)))
    dense = torch.from_numpy(tableau.dense.copy())
    own = {"order": tableau.order, "tableau": butcher, "mid": middle, "dense": dense}
    return _stepped(type(tableau.name, (TableauSolver,), own))


ADAPTIVE: dict[str, type[SteppedSolver]] = {
    "tsit5": of_tableau(TSIT5),
    "dopri5": _stepped(Dopri5Solver),
    "bosh3": of_tableau(BOSH3),
    "dopri8": _stepped(Dopri8Solver),
    "adaptive_heun": of_tableau(ADAPTIVE_HEUN),
    "fehlberg2": _stepped(Fehlberg2),
}
"""Adaptive methods by the name that `solver=` takes."""

FIXED: dict[str, type[Any]] = {"rk4": RK4, "euler": Euler, "midpoint": Midpoint, "heun3": Heun3}
"""Fixed-step methods by the name that `solver=` takes."""

rms_norm = _rms_norm
"""The norm of the error control."""
