"""Verdicts: what the numbers of all repetitions say about a claim, and whether two tables of verdicts agree."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import betabinom

from eigenode_cli.arrays import Floats
from eigenode_cli.console import counted
from eigenode_cli.reproduce.measures import MEASURES, TIMED, Result
from eigenode_cli.reproduce.schema import ClaimSpec

HOLDS, MIXED, FAILS, UNDEFINED = "holds", "mixed", "fails", "undefined"
MOST = 0.8
"""A claim holds if at least this share of the seeds shows it, and fails if at most the rest does; mixed between.

A claim may ask for another share."""
LEAST_CHANCE = 0.005
"""Chance below which the seeds of a check are taken to contradict the committed ones."""


@dataclass(frozen=True)
class Verdict:
    """One row of the table.

    Attributes:
        experiment, claim, sentence, place: which claim.
        expected: measure and bounds in words.
        low, q25, median, q75, high: of the numbers found, failures left out; None where there is none.
        kept, seeds: how many seeds keep the bounds, of how many.
        failures: seeds whose run failed or whose number is not defined; they do not keep the bounds.
        verdict: holds | mixed | fails | undefined (no seed gave a number).
        timed: whether the numbers depend on the machine.
        values: the number of each seed.
    """

    experiment: str
    claim: str
    sentence: str
    place: str
    expected: str
    low: float | None
    q25: float | None
    median: float | None
    q75: float | None
    high: float | None
    kept: int
    seeds: int
    failures: int
    verdict: str
    timed: bool
    values: tuple[float | None, ...]

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON; infinity, which JSON has not, stands as text."""
        return {key: _plain(value) for key, value in asdict(self).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return "inf" if isinstance(value, float) and np.isinf(value) else value


def judge(experiment: str, claim: ClaimSpec, results: Mapping[str, Sequence[Result]]) -> Verdict:
    """Return the verdict on a claim from the results of its runs, seed by seed."""
    mine = results[claim.run]
    others = results[claim.against] if claim.against is not None else [None] * len(mine)
    values = np.array([_value(claim, a, b) for a, b in zip(mine, others, strict=True)])
    known = values[~np.isnan(values)]
    kept = int(_keeps(claim, values).sum())
    spread = [None] * 5 if not known.size else [quantile(known, q) for q in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return Verdict(
        experiment=experiment,
        claim=claim.name,
        sentence=claim.claim,
        place=claim.place,
        expected=expected(claim),
        low=spread[0],
        q25=spread[1],
        median=spread[2],
        q75=spread[3],
        high=spread[4],
        kept=kept,
        seeds=values.size,
        failures=int(values.size - known.size),
        verdict=_verdict(claim, values, kept),
        timed=claim.measure in TIMED,
        values=tuple(None if np.isnan(value) else float(value) for value in values),
    )


def _value(claim: ClaimSpec, mine: Result, other: Result | None) -> float:
    """Return the claim's number for one seed; NaN where a run did not finish."""
    if not mine.finished or (other is not None and not other.finished):
        return float("nan")
    measure = MEASURES[claim.measure]
    value = measure(mine, claim)
    if other is None:
        return value
    base = measure(other, claim)
    return value / base if base != 0.0 and np.isfinite(base) else float("nan")


def _keeps(claim: ClaimSpec, values: Floats) -> np.ndarray:
    """Which numbers keep the bounds; NaN does not."""
    kept = ~np.isnan(values)
    if claim.at_least is not None:
        kept &= values >= claim.at_least
    if claim.at_most is not None:
        kept &= values <= claim.at_most
    return kept


def _verdict(claim: ClaimSpec, values: Floats, kept: int) -> str:
    known = values[~np.isnan(values)]
    if not known.size:
        return UNDEFINED
    if claim.statistic == "median":
        return HOLDS if _keeps(claim, np.array([quantile(known, 0.5)]))[0] else FAILS
    enough = (MOST if claim.share is None else claim.share) * values.size
    if kept >= enough:
        return HOLDS
    return FAILS if values.size - kept >= enough else MIXED


def quantile(values: Floats, q: float) -> float:
    """Linear between the ordered values, and no NaN where some are infinite."""
    ordered = np.sort(values)
    place = q * (ordered.size - 1)
    below, above = ordered[int(np.floor(place))], ordered[int(np.ceil(place))]
    return float(below if below == above else below + (place - np.floor(place)) * (above - below))


def expected(claim: ClaimSpec) -> str:
    """Measure and bounds of a claim in one line."""
    what = claim.measure.replace("_", " ") + (f" at step {claim.step}" if claim.step is not None else "")
    if claim.window is not None:
        what += f" in steps {claim.window[0]} to {claim.window[1]}"
    if claim.tolerance:
        what += f" (within {claim.tolerance:g} 1/s)"
    who = f"{claim.run} / {claim.against}" if claim.against is not None else claim.run
    if claim.at_least is not None and claim.at_most is not None:
        bounds = (
            f"= {claim.at_least:g}"
            if claim.at_least == claim.at_most
            else f"from {claim.at_least:g} to {claim.at_most:g}"
        )
    elif claim.at_least is not None:
        bounds = f"\N{GREATER-THAN OR EQUAL TO} {claim.at_least:g}"
    else:
        bounds = f"\N{LESS-THAN OR EQUAL TO} {claim.at_most:g}"
    median = "median of " if claim.statistic == "median" else ""
    share = "" if claim.share is None else f" in {claim.share:.0%} of the seeds"
    return f"{median}{what} of {who} {bounds}{share}"


def differences(found: Sequence[Verdict], committed: Sequence[Mapping[str, Any]]) -> list[str]:
    """Claims on which `found` differs from a committed table beyond that table's spread, one line each.

    Few seeds, or another machine's rounding, may well give another verdict. It counts as different only where so many
    (or so few) seeds that keep the bounds are not to be expected from the committed k of N. Times belong to a machine
    and are not compared.
    """
    known = {(row["experiment"], row["claim"]): row for row in committed}
    lines = []
    for verdict in found:
        row = known.get((verdict.experiment, verdict.claim))
        name = f"{verdict.experiment}/{verdict.claim}"
        if row is None:
            lines.append(f"{name}: not in the committed table")
        elif not verdict.timed and verdict.verdict != row["verdict"]:
            chance = probability(verdict.kept, verdict.seeds, row["kept"], row["seeds"])
            if chance < LEAST_CHANCE:
                lines.append(
                    f"{name}: {verdict.verdict} ({verdict.kept} of {counted(verdict.seeds, 'seed')}), committed is"
                    f" {row['verdict']} ({row['kept']} of {row['seeds']}); the chance of this is {chance:.2g}"
                )
    return lines


def probability(kept: int, seeds: int, known_kept: int, known_seeds: int) -> float:
    """Probability of a count as far off as `kept` of `seeds`, or farther to the same side.

    It is that of the beta-binomial predictive distribution after `known_kept` of `known_seeds`, with Jeffreys' prior.
    """
    counts = betabinom(seeds, known_kept + 0.5, known_seeds - known_kept + 0.5)
    return float(min(counts.cdf(kept), counts.sf(kept - 1)))
