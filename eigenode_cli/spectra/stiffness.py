"""The stiffness ratio of a spectrum."""

import math

from eigenode_cli.jit import njit


@njit
def stiffness_ratio(spectrum, level):
    """`max|Re| / min|Re|` of one spectrum `(n,)`: 1 for a single pair, infinite where a real part is 0.

    A real part counts as 0 up to `level` in 1/s (`pairs.rounding_level`): what is left of it then is rounding.
    """
    largest, smallest = 0.0, math.inf
    for i in range(spectrum.size):
        size = abs(spectrum[i].real)
        largest = max(largest, size)
        smallest = min(smallest, size)
    if smallest <= level:
        return 1.0 if largest <= level else math.inf
    return largest / smallest
