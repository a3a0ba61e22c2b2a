"""Step-size control, written once for both engines: the PI controller of Hairer and Wanner.

E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Sec. IV.2, with the constants
that the Julia solvers of the paper use (beta1 = 7/(10 p), beta2 = 2/(5 p), safety 0.9, factors 0.2 and 10).
"""

from eigenode_cli.jit import njit

SAFETY = 0.9
SHRINK = 0.2
GROW = 10.0
SMALLEST_RATIO = 1e-4
"""Initial value and lower bound of the remembered error ratio."""
SMALLEST_STEP = 16 * 2.220446049250313e-16
"""A step below this fraction of the time it starts from counts as underflow."""


@njit
def next_step(step: float, ratio: float, last_ratio: float, order: int) -> float:
    """Size of the step after a trial of size `step` whose error was `ratio` times the tolerance.

    A trial with `ratio` <= 1 was accepted; `last_ratio` is the ratio of the accepted step before it, at
    least `SMALLEST_RATIO`. A non-finite ratio shrinks by the largest factor.
    """
    if not ratio < 1e300:  # NaN and infinity as well
        return step * SHRINK
    proportional = ratio ** (0.7 / order)
    if ratio > 1.0:
        return step * max(SHRINK, SAFETY / proportional)
    if ratio == 0.0:
        return step * GROW
    factor = SAFETY * last_ratio ** (0.4 / order) / proportional
    return step * min(GROW, max(SHRINK, factor))
