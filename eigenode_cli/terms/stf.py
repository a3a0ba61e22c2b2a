"""STF: stiffness ratio, the largest over the smallest real part (Sec. 3.3.5)."""

import math

from eigenode_cli.jit import njit
from eigenode_cli.spectra.stiffness import stiffness_ratio
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def has_ratio(spectrum, level, corridor):
    """Whether STF has something to compare: a finite ratio, and a finite corridor `(2,)`."""
    return math.isfinite(stiffness_ratio(spectrum, level)) and math.isfinite(corridor[0]) and math.isfinite(corridor[1])


@njit
def stf(spectrum, level, corridor, error, delta, slope):
    """`eps(max|Re| / min|Re| - sigma)` at one time; sigma is the nearest point of the corridor `[low, high]`.

    A ratio or a corridor that is not finite contributes nothing: the truth's ratio is infinite where a real part of
    it crosses zero.

    Args:
        spectrum: eigenvalues `(n,)` in 1/s.
        level: up to where a real part counts as zero, in 1/s.
        corridor: smallest and largest accepted ratio `(2,)`; equal for a value to be met.
        error, delta: error function (see `errors`) and Huber's threshold.
        slope: filled with `dl/dRe + i dl/dIm` of every eigenvalue `(n,)`.
    """
    n = spectrum.size
    top, bottom = 0, 0
    for i in range(n):
        slope[i] = 0.0
        if abs(spectrum[i].real) > abs(spectrum[top].real):
            top = i
        if abs(spectrum[i].real) < abs(spectrum[bottom].real):
            bottom = i
    if not has_ratio(spectrum, level, corridor):
        return 0.0
    ratio = stiffness_ratio(spectrum, level)
    difference = ratio - min(max(ratio, corridor[0]), corridor[1])
    # where all real parts have one modulus (a single pair) the ratio stands at its minimum 1: no direction to go
    if ratio > 1.0:
        outer = error_slope(error, delta, difference)
        real_top, real_bottom = spectrum[top].real, spectrum[bottom].real
        slope[top] += outer * math.copysign(1.0, real_top) / abs(real_bottom)
        slope[bottom] -= outer * ratio / real_bottom
    return error_value(error, delta, difference)
