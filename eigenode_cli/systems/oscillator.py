"""Translational spring-damper oscillator, a linear system (the paper's Equ. linsys)."""

import numpy as np

from eigenode_cli.config.schema import OscillatorConfig
from eigenode_cli.systems.base import Floats, Parameter, State, System


class Oscillator(System):
    """`m dv/dt = -c s - d v` with position s in m and velocity v in m/s."""

    title = "Oscillator"
    states = (State("s", "m", "s"), State("v", "m/s", "v"))

    def __init__(self, config: OscillatorConfig) -> None:
        self.parameters = (
            Parameter("c", config.c, "N/m"),
            Parameter("d", config.d, "N s/m"),
            Parameter("m", config.m, "kg"),
        )
        self._matrix = np.array([[0.0, 1.0], [-config.c / config.m, -config.d / config.m]])

    def dynamics(self, x: Floats) -> Floats:
        """See `System.dynamics`."""
        return x @ self._matrix.T

    def jacobian(self, x: Floats) -> Floats:
        """See `System.jacobian`; the same matrix at every state."""
        return np.broadcast_to(self._matrix, (*x.shape[:-1], 2, 2)).copy()
