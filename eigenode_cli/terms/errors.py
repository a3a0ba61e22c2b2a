"""The error function of a term: the paper's epsilon, a choice per term (`error.sol=mae|mse|huber`)."""

from eigenode_cli.jit import njit

MAE = 0
MSE = 1
HUBER = 2
ERRORS = {"mae": MAE, "mse": MSE, "huber": HUBER}
"""Names of the error functions as they stand in the configuration."""


@njit
def outside(difference, tolerance):
    """Return how far a difference lies outside `[-tolerance, tolerance]`, with its sign; zero inside."""
    return difference - min(max(difference, -tolerance), tolerance)


@njit
def error_value(kind, delta, difference):
    """Error of one difference: `|r|`, `r^2`, or Huber's `r^2/2` inside `delta` and `delta (|r| - delta/2)` outside."""
    size = abs(difference)
    if kind == MSE:
        return difference * difference
    if kind == HUBER:
        if size <= delta:
            return 0.5 * difference * difference
        return delta * (size - 0.5 * delta)
    return size


@njit
def error_slope(kind, delta, difference):
    """Return the derivative of `error_value` with respect to the difference; 0 at 0, where |r| has a kink."""
    if kind == MSE:
        return 2.0 * difference
    if kind == HUBER and abs(difference) <= delta:
        return difference
    slope = delta if kind == HUBER else 1.0
    if difference > 0.0:
        return slope
    if difference < 0.0:
        return -slope
    return 0.0
