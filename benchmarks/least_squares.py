"""How well and how fast protocol=robust fits, over seeds that none of it was tuned on.

    python benchmarks/least_squares.py [--seeds 20] [--output benchmarks/least_squares.json]

Each run is `eigenode train protocol=robust` with a case's settings: positions measured, terms of the paper. Errors are
means of |x1 - truth| in per cent of the amplitude, over the horizon and over the one that follows it.
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import numpy as np

from eigenode_cli import __version__
from eigenode_cli.batch.run import train
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.runs.reader import open_run

FIRST_SEED = 1000
ALL = {"oscillator": "sol+frq+dmp+stb+osc", "sparse_oscillator": "sol+frq+dmp+stb+osc", "vdp": "sol+frq+dmp+osc"}
NOISE = (0.01, 0.05, 0.1)
POINTS = (11, 14, 31, 101)
CASES: dict[str, tuple[str, ...]] = {
    **{system: (f"system={system}", f"grads={grads}") for system, grads in ALL.items()},
    **{f"{system}, sol alone": (f"system={system}", "grads=sol") for system in ALL},
    **{
        f"{system}, no modal start": (
            f"system={system}",
            f"grads={grads}",
            "network.linear=none",
            "network.output_gain=1",
        )
        for system, grads in ALL.items()
    },
    **{
        f"{system}, unknown initial velocity": (
            f"system={system}",
            f"grads={grads}",
            f"system.initial_known=[{'nu' if system == 'vdp' else 's'}]",
        )
        for system, grads in ALL.items()
    },
    **{
        f"{system}, {share:.0%} noise": (f"system={system}", f"grads={grads}", f"system.noise={share}")
        for system, grads in ALL.items()
        for share in NOISE
    },
    **{
        f"{system}, {points} samples": (f"system={system}", f"grads={grads}", f"system.points={points}")
        for system, grads in ALL.items()
        for points in POINTS
    },
}
"""Settings of each case."""


@dataclass(frozen=True)
class Outcome:
    """One run: its status, both errors in per cent of the amplitude, and the seconds of its training."""

    seed: int
    status: str
    error: float
    beyond: float
    train_seconds: float
    max_real: float


def main() -> None:
    """Train, print a line a case, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES), metavar="CASE")
    parser.add_argument("--words", nargs="*", default=[], help="further settings of every run")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    table = {}
    for case in args.cases:
        start = perf_counter()
        runs = [run(case, seed, args.words) for seed in range(FIRST_SEED, FIRST_SEED + args.seeds)]
        table[case] = {**summary(runs), "errors": [float(f"{one.error:.3g}") for one in runs]}
        print(f"{case}: {line(table[case])} ({perf_counter() - start:.0f} s)", flush=True)
        if args.output:
            head = {
                "command": " ".join(["python", "benchmarks/least_squares.py", *sys.argv[1:]]),
                "version": __version__,
            }
            args.output.write_text(json.dumps({**head, "cases": table}, indent=1) + "\n")


def run(case: str, seed: int, words: list[str]) -> Outcome:
    """Train once in a folder that is thrown away."""
    config = typed(compose(["protocol=robust", *CASES[case], *words, f"seed={seed}", "trainer.figures=false"]))
    with tempfile.TemporaryDirectory() as folder:
        train(config, Path(folder), [], quiet=True)
        done = open_run(Path(folder))
        record = json.loads((Path(folder) / "run.json").read_text())
        solution, max_real = done.solution, float(done.metrics.max_real[-1])
    error = np.abs(solution.model[:, 0] - solution.truth[:, 0])
    percent = 100.0 / np.abs(solution.truth[~solution.beyond, 0]).max()
    inside, beyond = error[~solution.beyond].mean(), error[solution.beyond].mean()
    return Outcome(seed, done.status, percent * inside, percent * beyond, record["train_seconds"], max_real)


def summary(runs: list[Outcome]) -> dict[str, float]:
    """Medians over the seeds, the largest error, how many failed, and how many lie below 1 and 2 %."""
    errors = np.array([one.error for one in runs])
    return {
        "seeds": len(runs),
        "failed": sum(one.status != "finished" or not np.isfinite(one.error) for one in runs),
        "median_error": float(np.nanmedian(errors)),
        "largest_error": float(np.nanmax(errors)),
        "below_1": int((errors < 1.0).sum()),
        "below_2": int((errors < 2.0).sum()),
        "median_beyond": float(np.nanmedian([one.beyond for one in runs])),
        "median_train_seconds": float(np.median([one.train_seconds for one in runs])),
        "largest_max_real": float(max(one.max_real for one in runs)),
    }


def line(found: dict) -> str:
    """Return a summary in one line."""
    return (
        f"error {found['median_error']:.3g} % (largest {found['largest_error']:.3g} %), {found['below_1']} of"
        f" {found['seeds']} below 1 %, {found['below_2']} below 2 %, beyond {found['median_beyond']:.3g} %,"
        f" {found['median_train_seconds']:.2f} s, {found['failed']} failed"
    )


if __name__ == "__main__":
    main()
