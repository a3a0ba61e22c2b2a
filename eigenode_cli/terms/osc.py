"""OSC: oscillation capability, real eigenvalues are drawn together until they form a pair.

T. Thummerer, L. Mikelsons, Eigen-informed NeuralODEs, Equ. 6. https://arxiv.org/abs/2302.10892
"""

import numpy as np

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import REAL
from eigenode_cli.terms.errors import error_slope, error_value


@njit
def osc(comparison, error, delta, slope):
    """`1/n sum_(a, b) eps(Re lambda_a - Re lambda_b)` over the pairs that are missing; see `Comparison`.

    Existing pairs have no gap between their real parts; as many further pairs as those of the target exceed them are
    sought among the real eigenvalues: neighbours on the real axis, with the smallest sum of gaps.
    """
    spectrum, partner, wanted = comparison.spectrum, comparison.partner, comparison.pairs
    defined = wanted > 0
    n = spectrum.size
    reals = 0
    for i in range(n):
        slope[i] = 0.0
        if partner[i] == REAL:
            reals += 1
    missing = min(wanted - (n - reals) // 2, reals // 2)
    if missing <= 0:
        return 0.0, defined
    if n == 2:  # the paper's systems: one possible pair, nothing to sort, nothing to allocate
        return _pull_together(spectrum, 0, 1, error, delta, slope), defined
    members = np.empty(reals, np.int64)
    at = 0
    for i in range(n):
        if partner[i] == REAL:
            members[at] = i
            at += 1
    members = members[np.argsort(spectrum.real[members], kind="mergesort")]
    cost = _gap_sums(spectrum, members, missing)
    value = 0.0
    b, k = reals, missing
    while k > 0:
        if cost[b, k] == cost[b - 1, k]:
            b -= 1
        else:
            value += _pull_together(spectrum, members[b - 2], members[b - 1], error, delta, slope)
            b -= 2
            k -= 1
    return value, defined


@njit
def _gap_sums(spectrum, members, pairs):
    """`cost[b, k]`: smallest sum of gaps when k pairs of neighbours are formed among the first b real eigenvalues."""
    cost = np.full((members.size + 1, pairs + 1), np.inf)
    cost[:, 0] = 0.0
    for b in range(2, members.size + 1):
        gap = spectrum[members[b - 1]].real - spectrum[members[b - 2]].real
        for k in range(1, pairs + 1):
            cost[b, k] = min(cost[b - 1, k], cost[b - 2, k - 1] + gap)
    return cost


@njit
def _pull_together(spectrum, a, b, error, delta, slope):
    n = spectrum.size
    gap = spectrum[a].real - spectrum[b].real
    pull = error_slope(error, delta, gap) / n
    slope[a] = complex(pull, 0.0)
    slope[b] = complex(-pull, 0.0)
    return error_value(error, delta, gap) / n
