"""Throughput of sweeps: joblib on two workers against one, threads against one, and what --dry-run expected.

    python benchmarks/sweeps.py [--runs 200] [--steps 2000] [--output benchmarks/sweeps.json]

Every sweep is the command itself, started in a folder of its own, from its first to its last second.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def main() -> None:
    """Measure, print, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--steps", type=int, default=2000, help="of each run of the sweep")
    parser.add_argument("--pairs", type=int, default=3, help="of sweeps, in turn")
    parser.add_argument("--repetitions", type=int, default=8)
    parser.add_argument("--repeated-steps", type=int, default=5000, help="of each repetition")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    sweep = ["-m", "system=oscillator", "grads=sol,sol+frq", f"seed=range({args.runs // 2})"]
    sweep.append(f"trainer.steps={args.steps}")
    command(["-m", "system=oscillator", "grads=sol,sol+frq+dmp+osc", "trainer.steps=1"])  # the kernels are compiled
    result: dict[str, object] = {"load_before": os.getloadavg()[0], "runs": args.runs, "steps": args.steps}
    expected = command([*sweep, "hydra.launcher.n_jobs=2", "--dry-run"])[1]
    result["expected_seconds_on_two"] = seconds_of(expected)
    seconds = [[command([*sweep, f"hydra.launcher.n_jobs={n}"])[0] for n in (1, 2)] for _ in range(args.pairs)]
    result |= {"seconds_on_one": [one for one, _ in seconds], "seconds_on_two": [two for _, two in seconds]}
    result["throughput_ratios"] = [one / two for one, two in seconds]
    result["throughput_ratio"] = median(one / two for one, two in seconds)
    repeated = ["system=oscillator", f"repetitions={args.repetitions}", f"trainer.steps={args.repeated_steps}"]
    for grads in ("sol", "sol+frq+dmp+osc"):
        one = command([*repeated, f"grads={grads}"], cores=1)[0]
        two = command([*repeated, f"grads={grads}"])[0]
        result[f"repetitions_{grads}"] = {"seconds_on_one": one, "seconds_on_two": two, "throughput_ratio": one / two}
    result["load_after"] = os.getloadavg()[0]
    text = json.dumps(result, indent=2)
    print(text)
    if args.output:
        args.output.write_text(text + "\n")


def command(words: list[str], cores: int | None = None) -> tuple[float, str]:
    """Seconds and output of `eigenode train WORDS` in a folder of its own, on so many cores."""
    pinned = ["taskset", "-c", ",".join(map(str, range(cores)))] if cores else []
    with tempfile.TemporaryDirectory() as folder:
        clock = perf_counter()
        done = subprocess.run(
            [*pinned, sys.executable, "-m", "eigenode_cli", "train", *words],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        )
        return perf_counter() - clock, done.stdout


def seconds_of(text: str) -> float:
    """Return the time that a dry run prints."""
    found = re.search(r"^time  about (.+) on", text, re.MULTILINE)
    if found is None:
        raise ValueError(text)
    words = found[1].split()
    return sum(float(value) * UNITS[unit] for value, unit in zip(words[::2], words[1::2], strict=True))


if __name__ == "__main__":
    main()
