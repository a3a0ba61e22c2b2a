"""FRQ: frequencies of the oscillating pairs.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 7 and 8. https://arxiv.org/abs/2302.10892
"""

import math

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import UNMATCHED
from eigenode_cli.terms.errors import error_slope, error_value, outside

TWO_PI = 2.0 * math.pi


@njit
def frq(comparison, error, delta, slope):
    """`1/n sum_i eps(|Im lambda_i| / 2 pi - f*_i)` over both members of every matched pair; see `Comparison`.

    Of a range the difference counts that is outside of it.
    """
    spectrum, match, frequency = comparison.spectrum, comparison.match, comparison.frequency
    tolerance, n = comparison.frequency_tolerance, spectrum.size
    value = 0.0
    for i in range(n):
        slope[i] = 0.0
        if match[i] != UNMATCHED:
            imag = spectrum[i].imag
            difference = outside(abs(imag) / TWO_PI - frequency[match[i]], tolerance[match[i]])
            value += error_value(error, delta, difference) / n
            sign = 1.0 if imag > 0.0 else -1.0
            slope[i] = complex(0.0, sign * error_slope(error, delta, difference) / (TWO_PI * n))
    return value, comparison.matched > 0
