"""STB: stability, no eigenvalue right of the border (Sec. 3.3.1)."""

from eigenode_cli.jit import njit
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def stb(spectrum, margin, error, delta, slope):
    """`1/M sum_i eps(max(Re lambda_i + margin, 0))` at one time.

    Args:
        spectrum: eigenvalues `(n,)` in 1/s.
        margin: stability margin in 1/s; 0 is the paper's border, a positive one asks for `Re lambda <= -margin`.
        error, delta: error function (see `errors`) and Huber's threshold.
        slope: filled with `dl/dRe + i dl/dIm` of every eigenvalue `(n,)`.
    """
    n = spectrum.size
    value = 0.0
    for i in range(n):
        excess = spectrum[i].real + margin
        slope[i] = 0.0
        if excess > 0.0:
            value += error_value(error, delta, excess) / n
            slope[i] = complex(error_slope(error, delta, excess) / n, 0.0)
    return value
