"""SOL: deviation of the trajectory from the data.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 15. https://arxiv.org/abs/2302.10892
"""

from eigenode_cli.jit import njit
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def sol(states, data, mask, error, delta, slope):
    """Mean error over the observed entries of the trajectory.

    Args:
        states: trajectory `(N, n)` at the data times; NaN where the solve did not arrive.
        data: observed states `(N, n)`.
        mask: True where `data` is observed `(N, n)`.
        error, delta: error function (see `errors`) and Huber's threshold.
        slope: filled with the derivative of the returned value with respect to `states` `(N, n)`.
    """
    times, n = states.shape
    count = 0
    value = 0.0
    for j in range(times):
        for i in range(n):
            slope[j, i] = 0.0
            if mask[j, i]:
                difference = states[j, i] - data[j, i]
                value += error_value(error, delta, difference)
                slope[j, i] = error_slope(error, delta, difference)
                count += 1
    for j in range(times):
        for i in range(n):
            slope[j, i] /= count
    return value / count
