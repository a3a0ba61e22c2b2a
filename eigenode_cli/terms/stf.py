"""STF: stiffness ratio, the largest over the smallest real part.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 11. https://arxiv.org/abs/2302.10892
"""

import math

from eigenode_cli.jit import njit
from eigenode_cli.spectra.stiffness import stiffness_ratio
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def stf(comparison, error, delta, slope):
    """`eps(max|Re| / min|Re| - sigma)`, sigma the nearest point of the corridor `[low, high]`; see `Comparison`.

    A ratio or a corridor that is not finite contributes nothing: the truth's ratio is infinite where a real part of
    it crosses zero.
    """
    spectrum, corridor = comparison.spectrum, comparison.stiffness
    n = spectrum.size
    top, bottom = 0, 0
    for i in range(n):
        slope[i] = 0.0
        if abs(spectrum[i].real) > abs(spectrum[top].real):
            top = i
        if abs(spectrum[i].real) < abs(spectrum[bottom].real):
            bottom = i
    ratio = stiffness_ratio(spectrum, comparison.level)
    if not (math.isfinite(ratio) and math.isfinite(corridor[0]) and math.isfinite(corridor[1])):
        return 0.0, False
    difference = ratio - min(max(ratio, corridor[0]), corridor[1])
    # where all real parts have one modulus (a single pair) the ratio stands at its minimum 1: no direction to go
    if ratio > 1.0:
        outer = error_slope(error, delta, difference)
        real_top, real_bottom = spectrum[top].real, spectrum[bottom].real
        slope[top] += outer * math.copysign(1.0, real_top) / abs(real_bottom)
        slope[bottom] -= outer * ratio / real_bottom
    return error_value(error, delta, difference), True
