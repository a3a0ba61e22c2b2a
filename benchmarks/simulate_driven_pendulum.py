"""Make driven_pendulum_simulated.csv: a pendulum under a known torque, its angle alone, with noise, steps and holes.

python benchmarks/simulate_driven_pendulum.py
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

ROWS, LENGTH, JITTER = 640, 16.0, 0.3
"""Rows, length of the record in s, and largest shift of a time as a share of the spacing."""
MASS, ARM, GRAVITY = 0.5, 0.3, 9.81
"""Of a point on a rod without mass, in kg, m and m/s^2: 0.910 Hz at small angles."""
VISCOUS, DRY, SLIDING = 0.0155, 0.01, 0.05
"""Viscous friction in N m s (damping ratio 0.03), dry friction in N m, and rate in rad/s at which it is whole."""
TONES = ((0.24, 0.45), (0.21, 0.8), (0.17, 1.3))
"""Amplitude in N m and frequency in Hz of each part of the torque."""
NOISE, STEP = 0.3, 0.25
"""Standard deviation of the noise and step of the encoder in degrees."""


def torque(t: float) -> float:
    """Return the torque in N m."""
    return float(sum(size * np.sin(2.0 * np.pi * hertz * t + 3.0 * hertz) for size, hertz in TONES))


def rate(t: float, x: np.ndarray) -> list[float]:
    """Return rate in rad/s and acceleration in rad/s^2."""
    friction = VISCOUS * x[1] + DRY * np.tanh(x[1] / SLIDING)
    return [x[1], (torque(t) - friction - MASS * GRAVITY * ARM * np.sin(x[0])) / (MASS * ARM**2)]


def main() -> None:
    """Write the file."""
    rng = np.random.default_rng(11)
    spacing = LENGTH / ROWS
    times = np.round(spacing * (np.arange(ROWS) + JITTER * rng.uniform(-1.0, 1.0, ROWS)).clip(0.0), 4)
    angle = solve_ivp(rate, (0.0, LENGTH), [0.4, 0.0], t_eval=times, rtol=1e-10, atol=1e-10, max_step=0.01).y[0]
    shown = STEP * np.round((np.degrees(angle) + NOISE * rng.standard_normal(ROWS)) / STEP)
    holes = set(rng.choice(ROWS, 12, replace=False).tolist()) | set(range(250, 256))
    rows = ["# Simulated: a pendulum driven by a torque (benchmarks/simulate_driven_pendulum.py)"]
    rows.append("t [s],angle [deg],torque [N m]")
    for i, t in enumerate(times):
        rows.append(f"{t:.4f},{'' if i in holes else f'{shown[i]:.2f}'},{torque(t):.5f}")
    folder = Path(__file__).parents[1] / "experiments" / "measured"
    (folder / "driven_pendulum_simulated.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
