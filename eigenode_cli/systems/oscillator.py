"""Translational spring-damper oscillator, a linear system (the paper's Equ. 16)."""

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.systems.base import Parameter, State, System


class Oscillator(System):
    """`m dv/dt = -c s - d v` with position s in m and velocity v in m/s.

    Args:
        c: spring constant in N/m.
        d: damping constant in N s/m.
        m: mass in kg, positive.
    """

    title = "Oscillator"
    states = (State("s", "m", "s"), State("v", "m/s", "v"))

    def __init__(self, c: float = 25.0, d: float = 0.05, m: float = 1.0) -> None:
        self.parameters = (Parameter("c", c, "N/m"), Parameter("d", d, "N s/m"), Parameter("m", m, "kg"))
        self._matrix = np.array([[0.0, 1.0], [-c / m, -d / m]])

    def dynamics(self, x: Floats) -> Floats:
        """See `System.dynamics`."""
        return x @ self._matrix.T

    def jacobian(self, x: Floats) -> Floats:
        """See `System.jacobian`; the same matrix at every state."""
        return np.broadcast_to(self._matrix, (*x.shape[:-1], 2, 2)).copy()
