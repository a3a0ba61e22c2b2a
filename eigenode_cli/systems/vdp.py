"""Van der Pol oscillator, partly unstable and nonlinear (the paper's Equ. 18)."""

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.systems.base import Parameter, State, System


class VanDerPol(System):
    """`d^2 nu/dt^2 = mu (1 - nu^2) dnu/dt - nu`; nu is without unit, time in s.

    Args:
        mu: strength of the nonlinear damping, without unit.
    """

    title = "Van der Pol oscillator"
    states = (State("nu", "", r"\nu"), State("nu_dot", "1/s", r"\dot{\nu}"))

    def __init__(self, mu: float = 2.0) -> None:
        self.parameters = (Parameter("mu", mu, ""),)
        self._mu = mu

    def dynamics(self, x: Floats) -> Floats:
        """See `System.dynamics`."""
        nu, rate = x[..., 0], x[..., 1]
        return np.stack([rate, self._mu * (1.0 - nu**2) * rate - nu], axis=-1)

    def jacobian(self, x: Floats) -> Floats:
        """See `System.jacobian`."""
        nu, rate = x[..., 0], x[..., 1]
        matrix = np.zeros((*x.shape[:-1], 2, 2))
        matrix[..., 0, 1] = 1.0
        matrix[..., 1, 0] = -2.0 * self._mu * nu * rate - 1.0
        matrix[..., 1, 1] = self._mu * (1.0 - nu**2)
        return matrix
