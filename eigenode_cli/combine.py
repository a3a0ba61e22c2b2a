"""Combinations: how several gradients become optimizer steps (the paper's Sec. 3.4, ways 2 and 3).

A combination maps the scaled gradients `(L, P)`, all of one solve, to updates `(K, P)` that the optimizer takes one
after another. Gradients that are zero or not finite have been left out before, so L may be anything from 1.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def sequential(gradients: Floats) -> Floats:
    """Every gradient is an update of its own, in canonical order: the paper's way."""
    return gradients


def sequential_repeating_last(gradients: Floats) -> Floats:
    """As `sequential`, the last update twice: a quirk of the authors' first code."""
    return np.concatenate([gradients, gradients[-1:]])


def total(gradients: Floats) -> Floats:
    """One update, the sum of all gradients."""
    return gradients.sum(axis=0, keepdims=True)


def mean(gradients: Floats) -> Floats:
    """One update, the average of the gradients that act at this step."""
    return gradients.mean(axis=0, keepdims=True)


def switch(gradients: Floats) -> Floats:
    """One update, the gradient with the largest Euclidean norm."""
    return gradients[[int(np.argmax(np.linalg.norm(gradients, axis=1)))]]


def mix(gradients: Floats) -> Floats:
    """One update, for every parameter the gradient that is largest there."""
    return np.take_along_axis(gradients, np.abs(gradients).argmax(axis=0)[None], axis=0)


COMBINATIONS: dict[str, Callable[[Floats], Floats]] = {
    "sequential": sequential,
    "sum": total,
    "mean": mean,
    "switch": switch,
    "mix": mix,
}
"""Combinations by the name that `combine=` takes."""


def acting(gradients: Floats, scales: Floats) -> Floats:
    """The scaled gradients `(<= L, P)` that are finite and not zero; the others make no update."""
    scaled = gradients * scales[:, None]
    sizes = np.abs(scaled).max(axis=1)
    return scaled[np.isfinite(sizes) & (sizes > 0.0)]
