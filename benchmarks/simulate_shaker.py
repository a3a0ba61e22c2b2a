"""Make shaker.csv: a hardening mass on a shaker, its displacement with noise, drift and holes, its velocity unseen.

python benchmarks/simulate_shaker.py
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

RATE, LENGTH = 50.0, 12.0
"""Rows a second, and length of the record in s."""
FREQUENCY, DAMPING, HARDENING = 2.0, 0.02, 0.04
"""Of small vibrations in Hz, ratio, and relative stiffness at 1 mm."""
NOISE, DRIFT = 0.03, 0.05
"""Standard deviation in mm, and displacement in mm over the record."""


def force(t: float) -> float:
    """Return the shaker's force per mass in mm/s^2: three tones about the resonance."""
    return float(sum(30.0 * np.sin(2.0 * np.pi * hertz * t + hertz) for hertz in (1.3, 1.9, 2.6)))


def rate(t: float, x: np.ndarray) -> list[float]:
    """Return velocity and acceleration."""
    angular = 2.0 * np.pi * FREQUENCY
    return [x[1], -(angular**2) * (x[0] + HARDENING * x[0] ** 3) - 2.0 * DAMPING * angular * x[1] + force(t)]


def main() -> None:
    """Write the file."""
    rng = np.random.default_rng(7)
    times = np.arange(0.0, LENGTH, 1.0 / RATE)
    found = solve_ivp(rate, (0.0, LENGTH), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.02).y[0]
    shown = found + NOISE * rng.standard_normal(times.size) + DRIFT * times / LENGTH
    holes = set(rng.choice(times.size, 12, replace=False).tolist()) | set(range(210, 216))
    rows = ["# Simulated: a hardening mass on a shaker (benchmarks/simulate_shaker.py)", "t [ms];x [mm];F [N]"]
    for i, t in enumerate(times):
        cell = "" if i in holes else f"{shown[i]:.4f}".replace(".", ",")
        rows.append(f"{1000 * t:.0f};{cell};{force(t):.4f}".replace(".", ","))
    (Path(__file__).parents[1] / "experiments" / "measured" / "shaker.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
