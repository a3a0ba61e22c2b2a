"""The six terms, in their canonical order, and what a `grads=` string means.

Kept free of torch and Numba: the command line is checked before anything heavy is imported.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Term:
    """Name and one-line description of a term; its equation lives in the module of the same name."""

    name: str
    title: str
    description: str


TERMS: dict[str, Term] = {
    term.name: term
    for term in (
        Term("sol", "solution", "deviation of the trajectory from the data"),
        Term("frq", "frequency", "frequencies of oscillating pairs against their targets, in Hz"),
        Term("dmp", "damping", "damping ratios of oscillating pairs against their targets"),
        Term("stb", "stability", "real parts right of the border of stability"),
        Term("osc", "oscillation", "gap between real eigenvalues that ought to form a pair"),
        Term("stf", "stiffness", "ratio of the largest to the smallest real part against its target"),
    )
}

NAMES: tuple[str, ...] = tuple(TERMS)


def split_grads(text: str) -> list[str]:
    """The lower-case words of a `grads=` string, in the order typed, unchecked."""
    return [word.strip().lower() for word in text.split("+")]


def canonical(words: Sequence[str]) -> tuple[str, ...]:
    """The words in canonical order: the six terms first, then the user's own by name."""
    rank = {name: i for i, name in enumerate(NAMES)}
    return tuple(sorted(words, key=lambda word: (rank.get(word, len(rank)), word)))
