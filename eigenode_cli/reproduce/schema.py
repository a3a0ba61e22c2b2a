"""The typed schema of an experiment's file under `experiments/`; what may be left out has a default here.

Importing this module costs nothing: no torch, no Numba.
"""
# ruff: noqa: RUF009  # option() is dataclasses.field() with a constraint

from dataclasses import MISSING as NEVER
from dataclasses import Field, dataclass, field
from typing import Any

from eigenode_cli.config.validators import option

KINDS = ("solution", "convergence", "stability")
STATISTICS = ("share", "median")
MEASURES = (
    "sol",
    "dense_error",
    "relative_error",
    "sol_to_average",
    "max_real",
    "stable_first",
    "stable_from",
    "mean_sol",
    "rebound",
    "parameters",
    "gradient_cost",
    "test_sol",
    "twice_error",
    "tight_error",
)
"""Names of the measures; `reproduce.measures` implements them."""


@dataclass
class RunSpec:
    """One run of an experiment, for every seed."""

    system: str = option()
    grads: str = option()
    overrides: list[str] = field(default_factory=list)
    """Further words of `eigenode train`."""
    protocol: str | None = None
    """A protocol of its own, whatever `--protocol` says."""


@dataclass
class FigureSpec:
    """One figure: a curve for each run."""

    name: str = option()
    """Of its files; the paper's own where it has one."""
    kind: str = option(choices=KINDS)
    caption: str = option()
    runs: list[str] | None = None
    """Names of the runs in the order of the legend; all of the experiment where left out."""
    twice: bool = False
    """Show a solution over twice the training horizon."""
    median_by: str = option(choices=("dense_error", "test_sol"))
    """What makes a run the median one, whose solution is shown."""


@dataclass
class ClaimSpec:
    """One sentence, as a number that a run gives and the bounds that it must keep."""

    name: str = option()
    """Short, unique in its experiment."""
    claim: str = option()
    """What is said, in our own words."""
    place: str = option()
    """Where it is said."""
    run: str = option()
    """The run that is measured."""
    measure: str = option(choices=MEASURES)
    against: str | None = None
    """Another run of the same seed: the number is then the ratio of `run` to it."""
    step: int | None = option(at_least=0)
    """Training step at which to measure; the last where left out."""
    window: list[int] | None = option(at_least=0)
    """First and last training step that `rebound` looks at."""
    tolerance: float | None = option(at_least=0)
    """Real part in 1/s up to which `stable_first` and `stable_from` call a system stable."""
    at_least: float | None = None
    at_most: float | None = None
    statistic: str = option(choices=STATISTICS)
    """share: how many seeds keep the bounds; median: whether their median does."""
    share: float | None = option(above=0.5, at_most=1)
    """Share of the seeds from which on the claim holds; where left out that of all claims (`verdicts.MOST`)."""


@dataclass
class Experiment:
    """The runs behind published figures, with the claims they must show."""

    title: str = option()
    protocols: list[str] = option()
    """Protocols under which `eigenode reproduce` takes it up by itself, the first one where none is named."""
    by_name: bool = False
    """Whether it is taken up only where it is named, not with all others of its protocol."""
    runs: dict[str, RunSpec] = field(default_factory=dict)
    figures: list[FigureSpec] = field(default_factory=list)
    claims: list[ClaimSpec] = field(default_factory=list)
    table: bool = False
    """Whether the journal's table is made: quartiles, hit step, test from another initial state, times."""
    growth: bool = False
    """Whether the time of a loss Jacobian is measured over the number of states."""


OPTIONAL = {
    "step": None,
    "window": None,
    "tolerance": None,
    "statistic": "share",
    "share": None,
    "median_by": "dense_error",
}
"""Values of constrained fields that may be left out."""


def default_of(entry: "Field[Any]") -> Any:
    """Return what stands for a field that a file leaves out; NEVER where it may not."""
    if entry.name in OPTIONAL:
        return OPTIONAL[entry.name]
    if entry.default_factory is not NEVER:
        return entry.default_factory()
    return NEVER if entry.default == "???" else entry.default
