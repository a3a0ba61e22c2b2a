"""Times of two things in turn, A B A B ..., in one process: what disturbs one disturbs the other."""

import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.cpus import usable_cores

SAMPLE_SECONDS = 0.03
"""Calls are repeated until a sample lasts about this long."""
PAIRS = 21
"""Pairs of samples of calls that are quick."""
FEWEST = 5
"""Pairs of samples at least."""
PATIENCE = 6.0
"""Seconds after which a comparison ends, unless it has too few pairs."""


@dataclass(frozen=True)
class Ratio:
    """Times of one thing over those of another, pair by pair.

    Attributes:
        median, low, high: median, first and third quartile of the pairs' ratios; `least` the smallest.
        pairs: number of pairs.
        numerator_seconds, denominator_seconds: median time of a call of each.
        numerator_cores, denominator_cores: processor time over time: how many cores each kept busy.
    """

    median: float
    low: float
    high: float
    least: float
    pairs: int
    numerator_seconds: float
    denominator_seconds: float
    numerator_cores: float
    denominator_cores: float

    def as_json(self) -> dict[str, Any]:
        """As it stands in bench.json."""
        return asdict(self)


def ratio_of(numerators: Floats, denominators: Floats, cores: tuple[float, float] = (1.0, 1.0)) -> Ratio:
    """Return the ratio of paired times `(R,)` and `(R,)` in s."""
    ratios = numerators / denominators
    low, median, high = np.percentile(ratios, [25.0, 50.0, 75.0])
    return Ratio(
        median=float(median),
        low=float(low),
        high=float(high),
        least=float(ratios.min()),
        pairs=int(ratios.size),
        numerator_seconds=float(np.median(numerators)),
        denominator_seconds=float(np.median(denominators)),
        numerator_cores=cores[0],
        denominator_cores=cores[1],
    )


class _Sampler:
    """Samples one call: warmed up, and repeated so often that a sample is long enough to be timed."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self._call = call
        call()  # compiles, fills caches
        start = perf_counter()
        call()
        self.repeats = max(1, round(SAMPLE_SECONDS / max(perf_counter() - start, 1e-7)))
        self.wall = self.processor = 0.0

    def sample(self) -> float:
        """Time of a call in s, the mean of the repeats."""
        start, processor = perf_counter(), process_time()
        for _ in range(self.repeats):
            self._call()
        span = perf_counter() - start
        self.wall += span
        self.processor += process_time() - processor
        return span / self.repeats

    @property
    def cores(self) -> float:
        """Cores that were busy."""
        return self.processor / self.wall


def compare(numerator: Callable[[], Any], denominator: Callable[[], Any], patience: float = PATIENCE) -> Ratio:
    """Time of `numerator` over that of `denominator`, samples of both in turn for about `patience` seconds."""
    above, below = _Sampler(numerator), _Sampler(denominator)
    spans: list[tuple[float, float]] = []
    start = perf_counter()
    while len(spans) < FEWEST or (len(spans) < PAIRS and perf_counter() - start < patience):
        spans.append((above.sample(), below.sample()))
    times = np.array(spans)
    return ratio_of(times[:, 0], times[:, 1], (above.cores, below.cores))


def describe_machine(versions: dict[str, str]) -> dict[str, Any]:
    """Return what a reader must know of the machine, nothing that identifies it."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "cores": usable_cores(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "versions": versions,
        "load": load,
    }
