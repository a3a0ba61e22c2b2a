"""Solver settings: which Runge-Kutta method, and how its steps are chosen."""

from dataclasses import dataclass
from typing import ClassVar

from eigenode_cli.solve.tableau import Tableau


class RungeKutta:
    """An explicit Runge-Kutta method with its settings; one of your own is a subclass with its `tableau`."""

    tableau: ClassVar[Tableau | None] = None
    """Coefficients (`solve.tableau.explicit`), which both engines run; None for a shipped method, by its name."""


@dataclass(frozen=True)
class AdaptiveSolver(RungeKutta):
    """An embedded Runge-Kutta method with step-size control.

    Attributes:
        name: method, as in `solver=`: tsit5 | dopri5 | dopri8 | bosh3 | adaptive_heun | fehlberg2 | rodas5p |
            rosenbrock23 | auto.
        rtol: relative tolerance.
        atol: absolute tolerance, in the units of the states.
        max_steps: attempted steps after which a solve ends with the status `max_steps`.
    """

    name: str = "tsit5"
    rtol: float = 1e-3
    atol: float = 1e-6
    max_steps: int = 10_000


@dataclass(frozen=True)
class FixedStepSolver(RungeKutta):
    """A Runge-Kutta method with steps of one size.

    Attributes:
        name: method, as in `solver=`: rk4 | euler | midpoint | heun3.
        step: step size in s.
    """

    name: str = "rk4"
    step: float = 0.01


TIGHT = AdaptiveSolver(rtol=1e-7, atol=1e-9, max_steps=100_000)
"""Solver of a simulation: the learned field is shown, not the error of the solver that it was trained with."""

Solver = AdaptiveSolver | FixedStepSolver
