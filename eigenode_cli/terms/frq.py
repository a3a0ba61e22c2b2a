"""FRQ: frequencies of the oscillating pairs (Equ. lfreq, Sec. 3.3.3)."""

import math

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import UNMATCHED
from eigenode_cli.terms.errors import error_slope, error_value

TWO_PI = 2.0 * math.pi


@njit
def frq(spectrum, match, frequency, error, delta, slope):
    """`1/M sum_i eps(|Im lambda_i| / 2 pi - f*_i)` over both members of every matched pair, at one time.

    Args:
        spectrum: eigenvalues `(n,)` in 1/s.
        match: index of the target of each eigenvalue `(n,)`, `UNMATCHED` for none.
        frequency: targets `(K,)` in Hz.
        error, delta: error function (see `errors`) and Huber's threshold.
        slope: filled with `dl/dRe + i dl/dIm` of every eigenvalue `(n,)`.
    """
    n = spectrum.size
    value = 0.0
    for i in range(n):
        slope[i] = 0.0
        if match[i] != UNMATCHED:
            imag = spectrum[i].imag
            difference = abs(imag) / TWO_PI - frequency[match[i]]
            value += error_value(error, delta, difference) / n
            sign = 1.0 if imag > 0.0 else -1.0
            slope[i] = complex(0.0, sign * error_slope(error, delta, difference) / (TWO_PI * n))
    return value
