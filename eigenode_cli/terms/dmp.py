"""DMP: damping ratios of the oscillating pairs (Sec. 3.3.4)."""

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import UNMATCHED
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def dmp(spectrum, match, damping, error, delta, slope):
    """`1/M sum_i eps(-Re lambda_i / |lambda_i| - d*_i)` over both members of every matched pair, at one time.

    Args:
        spectrum: eigenvalues `(n,)` in 1/s.
        match: index of the target of each eigenvalue `(n,)`, `UNMATCHED` for none.
        damping: target damping ratios `(K,)`, in [-1, 1].
        error, delta: error function (see `errors`) and Huber's threshold.
        slope: filled with `dl/dRe + i dl/dIm` of every eigenvalue `(n,)`.
    """
    n = spectrum.size
    value = 0.0
    for i in range(n):
        slope[i] = 0.0
        if match[i] != UNMATCHED:
            # a matched eigenvalue has an imaginary part, so its modulus is not zero
            real, imag, modulus = spectrum[i].real, spectrum[i].imag, abs(spectrum[i])
            difference = -real / modulus - damping[match[i]]
            value += error_value(error, delta, difference) / n
            outer = error_slope(error, delta, difference) / n
            # d(-Re/|l|)/dRe = -Im^2/|l|^3,  d(-Re/|l|)/dIm = Re Im/|l|^3; ratios first, |l|^3 may underflow
            cosine, sine = real / modulus, imag / modulus
            slope[i] = complex(-outer * sine * sine / modulus, outer * cosine * sine / modulus)
    return value
