"""Optimizers at equal training time, with and without spectral terms, with and without a modal start.

    python benchmarks/ablation.py [--seeds 10] [--seconds 3] [--output benchmarks/ablation.json]

Each run trains the same network on the same positions for the same time at most, on one core; `train_seconds` counts
training alone. The error is the mean of |x1 - truth| over the horizon in per cent of the amplitude, looked at after
every few steps. A time to an error is that of the first record below it; it counts from the first step.

adam: protocol=paper. bfgs: Adam on the spectra for 1,000 steps, then BFGS over a growing horizon, the recipe that
protocol=robust was before least squares. lm: protocol=robust.
"""

import argparse
import json
import os
import sys
import tempfile
from itertools import product
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import numpy as np

import eigenode_cli as en

FIRST_SEED = 1000
SYSTEMS = {
    "oscillator": ("frq", "dmp", "stb", "osc"),
    "sparse_oscillator": ("frq", "dmp", "stb", "osc"),
    "vdp": ("frq", "dmp", "osc"),
}
"""Spectral terms that train on each system."""
TWENTIETHS = ",".join(f"{k / 20:g}" for k in range(1, 21))
METHODS = {
    "adam": ("protocol=paper", "trainer.steps=1000000", "trainer.record_every=25"),
    "bfgs": (
        *("protocol=robust", "optimizer=adam_bfgs", "optimizer.lr=1e-2", "combine=sum"),
        *("trainer.steps=5000", "trainer.record_every=5"),
    ),
    "lm": ("protocol=robust", "trainer.record_every=1"),
}
START = {
    "modal start": ("network.linear=modes", "network.output_gain=0.1"),
    "random start": ("network.linear=none", "network.output_gain=1"),
}
LEVELS = (1.0, 0.1)
"""Errors in per cent that are timed."""


def main() -> None:
    """Train, print a line a case, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    cases, seeds = {}, range(FIRST_SEED, FIRST_SEED + args.seeds)
    for system, spectral, start, method in product(SYSTEMS, (True, False), START, METHODS):
        name = f"{system}, {'spectral terms' if spectral else 'sol alone'}, {start}, {method}"
        words = settings(system, spectral, start, method, args.seconds)
        cases[name] = summary([run(words, seed) for seed in seeds])
        print(f"{name}: {line(cases[name])}", flush=True)
        if args.output:
            command = " ".join(["python", "benchmarks/ablation.py", *sys.argv[1:]])
            content = {"command": command, "version": en.__version__, "seconds": args.seconds, "cases": cases}
            args.output.write_text(json.dumps(content, indent=1) + "\n")


def settings(system: str, spectral: bool, start: str, method: str, seconds: float) -> list[str]:
    """Return the settings of one case."""
    terms = SYSTEMS[system] if spectral else ()
    words = [*METHODS[method], *START[start], f"system={system}", f"grads={'+'.join(('sol', *terms))}"]
    if method == "bfgs":
        words += [f"scale.{term}=1e-2" for term in terms]
        spectra = "{steps:1000,solve:false}," if spectral else ""
        growing = f"{{horizons:[{TWENTIETHS}]{',spectra:data' if spectral else ''}}}"
        words.append(f"stages=[{spectra}{growing}]")
        words.append(f"optimizer.adam_steps={1000 if spectral else 0}")
    return [*words, f"trainer.stop.seconds={seconds:g}", "trainer.figures=false"]


def run(words: list[str], seed: int) -> dict[str, float]:
    """Return the final error, and the time to each level, infinite where it is not reached."""
    words = [
        word for i, word in enumerate(words) if word.split("=")[0] not in {w.split("=")[0] for w in words[i + 1 :]}
    ]
    with tempfile.TemporaryDirectory() as folder:
        found = en.train(*words, f"seed={seed}", folder=Path(folder) / "run")
        metrics, solution = found.metrics, found.solution
    inside = solution["horizon"] == "train"
    percent = 100.0 / np.abs(solution.loc[inside].iloc[:, 1]).max()
    errors = (percent * metrics["dense_error"]).fillna(np.inf).to_numpy()
    times = metrics["train_seconds"].to_numpy()
    reached = {str(level): float(times[errors <= level].min(initial=np.inf)) for level in LEVELS}
    return {"error": float(errors[-1]), "seconds": float(times[-1]), **reached}


def summary(runs: list[dict[str, float]]) -> dict[str, object]:
    """Return medians over the seeds, and how many reached each level; None for a time that fewer than half reached."""
    found: dict[str, object] = {
        "seeds": len(runs),
        "median_error": float(np.median([one["error"] for one in runs])),
        "median_seconds": float(np.median([one["seconds"] for one in runs])),
    }
    for level in map(str, LEVELS):
        times = np.array([one[level] for one in runs])
        middle = float(np.median(times))
        found[f"reached_{level}"] = int(np.isfinite(times).sum())
        found[f"seconds_to_{level}"] = middle if np.isfinite(middle) else None
    return found


def line(found: dict[str, object]) -> str:
    """Return a summary in one line."""
    times = ", ".join(
        f"{level:g} % in {'-' if (time := found[f'seconds_to_{level}']) is None else f'{time:.3f} s'}"
        f" ({found[f'reached_{level}']} of {found['seeds']})"
        for level in LEVELS
    )
    return f"{found['median_error']:.3g} % after {found['median_seconds']:.2f} s, {times}"


if __name__ == "__main__":
    main()
