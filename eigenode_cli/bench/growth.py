"""How time grows with states, width, depth and horizon, as exponents b of a fit a x^b."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.bench.agreement import agreement
from eigenode_cli.bench.case import Case, oscillating
from eigenode_cli.bench.contestants import OURS, Contestant
from eigenode_cli.bench.measure import compare

Say = Callable[[str], None]

STATES, WIDTHS, DEPTHS, HORIZONS = (2, 6, 20, 50, 100), (16, 32, 64, 128), (1, 2, 3, 4), (5, 10, 20, 40)
"""What is varied: states n of the network n -> 32 -> n, width, number of hidden layers, horizon in s."""
SPECTRA = (21, 41)
WIDTH, BASE_STATES, BASE_HORIZON = 32, 4, 5.0
"""What is kept where it is not varied."""
BOTH = ("sol", "frq")
PATIENCE = 2.0
"""Seconds of one comparison, see `measure.compare`."""


@dataclass(frozen=True)
class Curve:
    """One quantity is varied, all else is kept.

    Attributes:
        name: of the curve.
        quantity: what is varied.
        values: its values.
        make: the case at a value.
        checked: whether contestants are compared at tight tolerance before they are timed; the curves that differ
            from a checked one in terms or in the number of spectra are not.
    """

    name: str
    quantity: str
    values: Sequence[int]
    make: Callable[[int], Case]
    checked: bool


@dataclass(frozen=True)
class PowerLaw:
    """`a x^b`, fitted by least squares to the logarithms."""

    a: float
    b: float


def fit_power(x: Floats, y: Floats) -> PowerLaw:
    """Return the power law through points `x (K,)`, `y (K,)`, all above zero.

    Raises:
        ValueError: fewer than two different x.
    """
    if np.unique(x).size < 2:
        raise ValueError("an exponent needs two different abscissae")
    b, log_a = np.polyfit(np.log(x), np.log(y), 1)
    return PowerLaw(float(np.exp(log_a)), float(b))


def curves() -> Iterator[Curve]:
    """All curves, those over the states first."""
    for terms in (BOTH, ("sol",)):
        for points in SPECTRA:
            yield Curve(
                f"states, {'+'.join(terms)}, {points} spectra",
                "states",
                STATES,
                lambda n, terms=terms, points=points: oscillating(n, [WIDTH], BASE_HORIZON, points, terms),
                checked=terms == BOTH and points == SPECTRA[0],
            )
    yield Curve("width", "width", WIDTHS, lambda w: oscillating(BASE_STATES, [w], BASE_HORIZON, SPECTRA[0], BOTH), True)
    yield Curve(
        "depth",
        "depth",
        DEPTHS,
        lambda d: oscillating(BASE_STATES, [WIDTH] * d, BASE_HORIZON, SPECTRA[0], BOTH),
        True,
    )
    yield Curve(
        "horizon",
        "horizon",
        HORIZONS,
        lambda h: oscillating(BASE_STATES, [WIDTH], float(h), SPECTRA[0], BOTH),
        True,
    )


def measure_curve(curve: Curve, peers: Sequence[Contestant], say: Say) -> dict[str, Any]:
    """Return times of all contestants along a curve, their exponents, and where a peer is faster."""
    seconds: dict[str, list[float]] = {OURS.name: [], **{peer.name: [] for peer in peers}}
    ratios: dict[str, list[dict[str, Any]]] = {peer.name: [] for peer in peers}
    disagree: dict[str, list[int]] = {}
    for value in curve.values:
        say(f"growth: {curve.name}, {curve.quantity} = {value}")
        case = curve.make(value)
        ours, own = OURS.build(case), []
        for peer in peers:
            if curve.checked and not _agree(peer, case.tight()):
                disagree.setdefault(peer.name, []).append(value)
            ratio = compare(peer.build(case).call, ours.call, PATIENCE)
            ratios[peer.name].append(ratio.as_json())
            seconds[peer.name].append(ratio.numerator_seconds)
            own.append(ratio.denominator_seconds)
        seconds[OURS.name].append(float(np.median(own)))
    x = np.array(curve.values, dtype=np.float64)
    return {
        "quantity": curve.quantity,
        "values": list(curve.values),
        "exponents": {name: fit_power(x, np.array(y)).b for name, y in seconds.items()},
        "ratios": ratios,
        "seconds": seconds,
        "disagree": disagree,
        "slower_than": {
            name: [v for v, ratio in zip(curve.values, rows, strict=True) if ratio["median"] < 1.0]
            for name, rows in ratios.items()
        },
    }


def _agree(peer: Contestant, case: Case) -> bool:
    return agreement(peer.build(case).result(), OURS.build(case).result()).holds


def measure_growth(peers: Sequence[Contestant], say: Say) -> dict[str, Any]:
    """All curves by name."""
    return {curve.name: measure_curve(curve, peers, say) for curve in curves()}
