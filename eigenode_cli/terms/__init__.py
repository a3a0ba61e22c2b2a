"""The registry of the terms, in their canonical order, and what a `grads=` string means.

Kept free of torch and Numba: the command line is checked before anything heavy is imported.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Term:
    """A term of the registry; its kernel and its equation lie in the module of its name.

    Attributes:
        name: as in `grads=`, and of the kernel.
        title, description: for people.
        needs: what it compares: the `trajectory`, or the `spectra` along it.
        target: what it needs to compare with: `data`, the `pairs` or the stiffness `ratio` of the target,
            a solver's `step`, or None.
        unit: what its residuals are measured by: the size of the `data`, of the target's `frequency` in Hz or
            `angular` frequency, of its `ratio`, or None for a number without unit.
        per_eigenvalue: whether it is a mean over the eigenvalues of a spectrum.
    """

    name: str
    title: str
    description: str
    needs: str = "spectra"
    target: str | None = None
    unit: str | None = None
    per_eigenvalue: bool = True


TERMS: dict[str, Term] = {
    term.name: term
    for term in (
        Term(
            name="sol",
            title="solution",
            description="deviation of the trajectory from the data",
            needs="trajectory",
            target="data",
            unit="data",
            per_eigenvalue=False,
        ),
        Term(
            name="frq",
            title="frequency",
            description="frequencies of oscillating pairs against their targets, in Hz",
            target="pairs",
            unit="frequency",
        ),
        Term(
            name="dmp",
            title="damping",
            description="damping ratios of oscillating pairs against their targets",
            target="pairs",
        ),
        Term(
            name="stb",
            title="stability",
            description="real parts right of the border of stability",
            unit="angular",
        ),
        Term(
            name="osc",
            title="oscillation",
            description="gap between real eigenvalues that ought to form a pair",
            target="pairs",
            unit="angular",
        ),
        Term(
            name="stf",
            title="stiffness",
            description="ratio of the largest to the smallest real part against its target",
            target="ratio",
            unit="ratio",
            per_eigenvalue=False,
        ),
        Term(
            name="stp",
            title="solver step",
            description="growth |R(h lambda)| above 1 of a fixed-step method with a stated step",
            target="step",
        ),
    )
}
"""The terms in their canonical order."""

NAMES: tuple[str, ...] = tuple(TERMS)
PAPER_TERMS: tuple[str, ...] = NAMES[:6]
"""The terms of the paper, which are always recorded; `stp` where a step is stated."""
SPECTRAL: tuple[str, ...] = tuple(name for name, term in TERMS.items() if term.needs == "spectra")
"""Terms that need no solution, only states to take a spectrum at."""
AT_TARGET: tuple[str, ...] = tuple(name for name in SPECTRAL if TERMS[name].target in ("pairs", "ratio"))
"""Terms that compare the spectrum with a target, and are taken where the target holds."""


def of_target(kind: str) -> tuple[str, ...]:
    """Return the names of the terms that compare with this part of the target."""
    return tuple(name for name, term in TERMS.items() if term.target == kind)


def split_grads(text: str) -> list[str]:
    """Return the lower-case words of a `grads=` string, in the order typed, unchecked."""
    return [word.strip().lower() for word in text.split("+")]


def canonical(words: Sequence[str]) -> tuple[str, ...]:
    """Return the words in canonical order: the terms of the registry first, then the user's own by name."""
    rank = {name: i for i, name in enumerate(NAMES)}
    return tuple(sorted(words, key=lambda word: (rank.get(word, len(rank)), word)))
