"""The fixed lists of names that settings choose from, as plain data: no torch, no Numba.

The modules that implement them hold a registry under the same names; a test keeps the two equal.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any

from eigenode_cli.terms import NAMES, PAPER_TERMS, canonical, split_grads

ACTIVATIONS = ("tanh", "sigmoid", "relu", "softplus", "silu", "elu", "sin", "identity")
INITS = ("glorot", "uniform01", "kaiming")
STRUCTURES = ("second_order", "full")
SCALINGS = ("none", "max_abs")
SCALING_SOURCES = ("data", "truth")
LINEARS = ("none", "zero", "fitted", "modes")
BLOCKS = ("network", "linear", "initial_state", "offset")
ERRORS = ("mae", "mse", "huber")
ON_UNSOLVABLE = ("stabilise", "retry", "skip", "stop")
STABILISING = ("stabilise", "retry")
"""Those under which the spectral terms may act where a solve fails."""
KEPT = ("last", "best")
JACOBIANS = ("autodiff", "finite_difference", "symbolic")
SPECTRA_AT = ("trajectory", "data")
TARGETS_AT = ("trajectory", "equilibrium")
EIGENVALUE_COUNTS = ("spectrum", "times")
STEPPERS = ("euler", "midpoint", "heun3", "tsit5", "dopri5", "bosh3", "adaptive_heun", "rk4")
SENSITIVITIES = ("auto", "forward", "adjoint")


def stated_ranges(entries: Iterable[Any]) -> list[tuple[float, float]]:
    """Return the ends of what is stated, a value or [low, high]; those of a value are equal."""
    return [(entry, entry) if isinstance(entry, int | float) else (entry[0], entry[1]) for entry in entries]


def damped_frequencies(target: Any) -> list[tuple[float, float]]:
    """Return the ends of the stated frequencies |Im|/2 pi in Hz; of an undamped one it is `f sqrt(1 - ratio^2)`."""
    found = []
    for (low, high), damping in zip(stated_ranges(target.frequency), stated_ranges(target.damping), strict=True):
        sizes = sorted(map(abs, damping)) if target.undamped else [0.0, 0.0]
        least = 0.0 if damping[0] < 0.0 < damping[1] else sizes[0]
        found.append((low * math.sqrt(1.0 - sizes[1] ** 2), high * math.sqrt(1.0 - least**2)))
    return found


def named_terms(config: Any) -> Iterator[tuple[str, str]]:
    """Yield every setting that names terms to train, as key and text: `grads`, then those of the stages."""
    yield "grads", config.grads
    for number, stage in enumerate(config.stages):
        if stage.terms is not None:
            yield f"stages.{number}.terms", stage.terms


def recorded_names(config: Any) -> tuple[str, ...]:
    """Return the names of the shipped terms that have a column in metrics.csv: `stp` only where a step is stated."""
    return PAPER_TERMS if config.stp.step is None else NAMES


def training_terms(config: Any) -> tuple[str, ...]:
    """Return every term whose gradient trains in any stage, in canonical order."""
    words = [word for _, text in named_terms(config) for word in split_grads(text)]
    return canonical(list(dict.fromkeys(words)))
