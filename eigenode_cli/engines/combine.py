"""Combinations: how several gradients become optimizer steps (the paper's Sec. 2.4, ways 2 and 3).

A combination maps the gradients `(L, P)` of one solve, each times its scale, to updates `(K, P)` that the optimizer
takes one after another. Gradients that are zero or not finite do not act. It is compiled, so that the compiled engine
can take many training steps without Python (`learner.learn`).
"""

import math

from eigenode_cli.jit import njit

SEQUENTIAL, SUM, MEAN, SWITCH, MIX, SEQUENTIAL_REPEATING_LAST = range(6)
COMBINATIONS = {"sequential": SEQUENTIAL, "sum": SUM, "mean": MEAN, "switch": SWITCH, "mix": MIX}
"""Codes by the name that `combine=` takes: `sequential` makes every gradient an update of its own, in canonical order
(the paper's way); `sum` and `mean` make one update of all that act; `switch` takes the one with the largest
Euclidean norm; `mix` takes for every parameter the one that is largest there. `SEQUENTIAL_REPEATING_LAST` is
`sequential`, and `learner.learn` makes the last step twice, a quirk of the authors' first code."""


@njit
def combine(combination, gradients, scales, updates):
    """Fill the leading rows of `updates (L + 1, P)`; returns how many there are, 0 if no gradient acts.

    Args:
        combination: code.
        gradients: of the named terms `(L, P)`.
        scales: factor of each `(L,)`.
        updates: filled; the rows behind are working space.
    """
    acting = _scale_acting(gradients, scales, updates)
    if acting == 0 or combination in (SEQUENTIAL, SEQUENTIAL_REPEATING_LAST):
        return acting
    if combination == SWITCH:
        updates[0] = updates[_longest(acting, updates)]
    elif combination == MIX:
        _largest_entries(acting, updates)
    else:
        for row in range(1, acting):
            for i in range(updates.shape[1]):
                updates[0, i] += updates[row, i]
        if combination == MEAN:
            for i in range(updates.shape[1]):
                updates[0, i] /= acting
    return 1


@njit
def _scale_acting(gradients, scales, updates):
    """Scale the gradients that act into the leading rows; returns their number."""
    acting = 0
    for term in range(gradients.shape[0]):
        largest, finite = 0.0, True
        for i in range(gradients.shape[1]):
            scaled = scales[term] * gradients[term, i]
            finite &= scaled - scaled == 0.0  # but for NaN and infinity
            largest = max(largest, abs(scaled))
            updates[acting, i] = scaled
        acting += 1 if finite and largest > 0.0 else 0
    return acting


@njit
def _longest(acting, updates):
    best, length = 0, -1.0
    for row in range(acting):
        total = 0.0
        for i in range(updates.shape[1]):
            total += updates[row, i] * updates[row, i]
        if math.sqrt(total) > length:
            best, length = row, math.sqrt(total)
    return best


@njit
def _largest_entries(acting, updates):
    for row in range(1, acting):
        for i in range(updates.shape[1]):
            if abs(updates[row, i]) > abs(updates[0, i]):
                updates[0, i] = updates[row, i]
