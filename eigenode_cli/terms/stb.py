"""STB: stability, no eigenvalue right of the border.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 5. https://arxiv.org/abs/2302.10892
"""

from eigenode_cli.jit import njit
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def stb(comparison, error, delta, slope):
    """`1/n sum_i eps(max(Re lambda_i + margin, 0))`; see `Comparison`.

    A margin of 0 is the paper's border, a positive one asks for `Re lambda <= -margin`.
    """
    spectrum, margin = comparison.spectrum, comparison.margin
    n = spectrum.size
    value = 0.0
    for i in range(n):
        excess = spectrum[i].real + margin
        slope[i] = 0.0
        if excess > 0.0:
            value += error_value(error, delta, excess) / n
            slope[i] = complex(error_slope(error, delta, excess) / n, 0.0)
    return value, True
