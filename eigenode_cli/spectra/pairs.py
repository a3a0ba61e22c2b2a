"""Which eigenvalues form conjugate pairs, and which target each pair is compared with."""

import numpy as np

from eigenode_cli.jit import njit

REAL = -1
"""Partner of a real eigenvalue."""
UNMATCHED = -1
"""Target of an eigenvalue that has none."""


@njit
def find_partners(spectrum, partner):
    """Fill `partner (n,)` with the index of each eigenvalue's conjugate, `REAL` where there is none.

    `spectrum (n,)` are the eigenvalues of a real matrix, in any order: the members of a pair are exact conjugates.
    Returns the number of pairs. A pair needs an imaginary part: equal real eigenvalues are not one.
    """
    n = spectrum.size
    pairs = 0
    for i in range(n):
        partner[i] = REAL
    for i in range(n):
        if partner[i] != REAL or not spectrum[i].imag > 0.0:
            continue
        best, least = REAL, np.inf
        for j in range(n):
            if partner[j] == REAL and spectrum[j].imag < 0.0:
                across, along = spectrum[i].real - spectrum[j].real, spectrum[i].imag + spectrum[j].imag
                distance = across * across + along * along
                if best == REAL or distance < least:
                    best, least = j, distance
        if best != REAL:
            partner[i] = best
            partner[best] = i
            pairs += 1
    return pairs


@njit
def match_targets(spectrum, partner, frequency, match):
    """Fill `match (n,)` with the index of the target that each member of a pair is compared with.

    `frequency (K,)` in Hz, ascending, NaN behind the last one. As many pairs are matched as both sides have; the
    assignment has the smallest sum of frequency differences. In one dimension such an assignment keeps the order,
    so dynamic programming over both sorted lists finds it. Returns the number of matched pairs.
    """
    n = spectrum.size
    for i in range(n):
        match[i] = UNMATCHED
    m = 0
    for i in range(n):
        if partner[i] != REAL and spectrum[i].imag > 0.0:
            m += 1
    k = 0
    while k < frequency.size and not np.isnan(frequency[k]):
        k += 1
    if m == 0 or k == 0:
        return 0
    if m == 1 and k == 1:  # the paper's systems: nothing to assign, nothing to allocate
        for i in range(n):
            if partner[i] != REAL:
                match[i] = 0
        return 1
    _assign(spectrum, partner, frequency[:k], match, m)
    return min(m, k)


@njit
def _assign(spectrum, partner, frequency, match, m):
    n, k = spectrum.size, frequency.size
    members = np.empty(m, np.int64)
    a = 0
    for i in range(n):
        if partner[i] != REAL and spectrum[i].imag > 0.0:
            members[a] = i
            a += 1
    members = members[np.argsort(spectrum.imag[members], kind="mergesort")]
    # cost[a, b]: cheapest assignment of the first a pairs and b targets, with min(a, b) of them assigned
    cost = np.zeros((m + 1, k + 1))
    for a in range(1, m + 1):
        for b in range(1, k + 1):
            here = cost[a - 1, b - 1] + abs(spectrum[members[a - 1]].imag / (2 * np.pi) - frequency[b - 1])
            if a > b:
                here = min(here, cost[a - 1, b])
            elif b > a:
                here = min(here, cost[a, b - 1])
            cost[a, b] = here
    a, b = m, k
    while a > 0 and b > 0:
        if a > b and cost[a, b] == cost[a - 1, b]:
            a -= 1
        elif b > a and cost[a, b] == cost[a, b - 1]:
            b -= 1
        else:
            a -= 1
            b -= 1
            match[members[a]] = b
            match[partner[members[a]]] = b
