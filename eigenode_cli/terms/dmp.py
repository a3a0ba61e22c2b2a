"""DMP: damping ratios of the oscillating pairs.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 9 and 10. https://arxiv.org/abs/2302.10892
"""

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import UNMATCHED
from eigenode_cli.terms.errors import error_slope, error_value, outside


@njit
def dmp(comparison, error, delta, slope):
    """`1/n sum_i eps(-Re lambda_i / |lambda_i| - d*_i)` over both members of every matched pair; see `Comparison`.

    Of a range the difference counts that is outside of it.
    """
    spectrum, match, damping = comparison.spectrum, comparison.match, comparison.damping
    tolerance, n = comparison.damping_tolerance, spectrum.size
    value = 0.0
    for i in range(n):
        slope[i] = 0.0
        if match[i] != UNMATCHED:
            # a matched eigenvalue has an imaginary part, so its modulus is not zero
            real, imag, modulus = spectrum[i].real, spectrum[i].imag, abs(spectrum[i])
            difference = outside(-real / modulus - damping[match[i]], tolerance[match[i]])
            value += error_value(error, delta, difference) / n
            outer = error_slope(error, delta, difference) / n
            # d(-Re/|l|)/dRe = -Im^2/|l|^3,  d(-Re/|l|)/dIm = Re Im/|l|^3; ratios first, |l|^3 may underflow
            cosine, sine = real / modulus, imag / modulus
            slope[i] = complex(-outer * sine * sine / modulus, outer * cosine * sine / modulus)
    return value, comparison.matched > 0
