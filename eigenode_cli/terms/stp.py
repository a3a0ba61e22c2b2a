"""STP: stability of a fixed-step solver, no eigenvalue outside of the region in which it damps.

The footnote of T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, on stiffness asks for a model that a given solver
can run; https://arxiv.org/abs/2302.10892. A step h of a method with the stability function R multiplies a mode by
`R(h lambda)`: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Sec. IV.2.
"""

from eigenode_cli.jit import njit
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def stp(comparison, error, delta, slope):
    """`1/n sum_i eps(max(|R(h lambda_i)| - 1, 0))`, R a polynomial; see `Comparison`."""
    spectrum, region = comparison.spectrum, comparison.region
    n, last = spectrum.size, region.size - 1
    value = 0.0
    for i in range(n):
        slope[i] = 0.0
    if last < 1:
        return value, False
    step = region[0]
    for i in range(n):
        z = step * spectrum[i]
        growth, rate = complex(region[last], 0.0), complex(0.0, 0.0)
        for k in range(last - 1, 0, -1):  # Horner's rule, with the derivative
            rate = rate * z + growth
            growth = growth * z + region[k]
        size = abs(growth)
        excess = size - 1.0
        if excess > 0.0:
            value += error_value(error, delta, excess) / n
            # d|R| = Re(conj(R) R' h dlambda) / |R|; the growth first, its square may overflow
            slope[i] = error_slope(error, delta, excess) * step / n * (growth / size) * rate.conjugate()
    return value, True
