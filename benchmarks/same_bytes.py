"""Whether two checkouts train to the same bytes: metrics.csv of the same runs, without its columns of time.

    python benchmarks/same_bytes.py --before CHECKOUT --after CHECKOUT [--quick] [--shared]

A checkout is a folder with its own `.venv`, or the path of a Python that has eigenode installed. Each trains all runs
in one process. Prints a row for each run; the exit code is 1 if any differs.
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path

GRID = {
    "protocol": ("paper", "journal"),
    "system": ("oscillator", "sparse_oscillator", "vdp"),
    "grads": ("sol", "sol+frq+dmp+stb+osc+stf"),
    "seed": ("0", "1"),
}
RUNS = tuple(
    (*(f"{key}={value}" for key, value in zip(GRID, values, strict=True)), f"engine={engine}", f"trainer.steps={steps}")
    for engine, steps in (("compiled", 1000), ("torch", 50))
    for values in product(*GRID.values())
)
"""Settings of every run."""
QUICK = tuple((*run[:-1], f"trainer.steps={200 if 'engine=compiled' in run else 3}") for run in RUNS if "seed=0" in run)
"""The same with `--quick`."""

TRAIN_ALL = """
import json, runpy, sys
for words in json.load(sys.stdin):
    sys.argv = ["eigenode", "train", *words]
    try:
        runpy.run_module("eigenode_cli", run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            print("exit code", ended.code, "of", *sys.argv, file=sys.stderr)
"""
"""What each checkout runs: one command after another, in one process."""


def main() -> int:
    """Train with both checkouts, compare, print; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, required=True, help="checkout, or a Python that has eigenode installed")
    parser.add_argument("--after", type=Path, required=True, help="the same")
    parser.add_argument("--quick", action="store_true", help="one seed and fewer steps")
    parser.add_argument("--shared", action="store_true", help="leave out columns that only one of the two writes")
    args = parser.parse_args()
    runs = QUICK if args.quick else RUNS
    with tempfile.TemporaryDirectory() as folder:
        before = train(args.before, runs, Path(folder, "before"))
        after = train(args.after, runs, Path(folder, "after"))
    different = 0
    width = max(len(" ".join(run)) for run in runs)
    for run, one, other in zip(runs, before, after, strict=True):
        found = difference(one, other, args.shared)
        different += found is not None
        print(f"{' '.join(run):{width}}  {found or f'equal, {len(one) - 1} rows'}")
    print(f"{len(runs) - different} of {len(runs)} equal")
    return int(different > 0)


def train(checkout: Path, runs: Sequence[Sequence[str]], folder: Path) -> list[list[list[str]]]:
    """Return the metrics of every run by the code of a checkout, header and rows as text; empty for none."""
    python = checkout.absolute() if checkout.is_file() else checkout.absolute() / ".venv/bin/python"
    folder.mkdir()
    commands = [[*run, "trainer.figures=false", f"hydra.run.dir={number}"] for number, run in enumerate(runs)]
    words = json.dumps(commands)
    subprocess.run([python, "-c", TRAIN_ALL], input=words, cwd=folder, text=True, stdout=subprocess.DEVNULL, check=True)
    return [metrics(folder / str(number) / "metrics.csv") for number in range(len(runs))]


def metrics(path: Path) -> list[list[str]]:
    """Header and rows of a metrics.csv without its columns of time."""
    if not path.exists():
        return []
    table = list(csv.reader(path.read_text().splitlines()))
    kept = [i for i, name in enumerate(table[0]) if not name.endswith("_seconds")]
    return [[row[i] for i in kept] for row in table]


def difference(before: list[list[str]], after: list[list[str]], shared: bool) -> str | None:
    """Return the first difference of two tables in words, None if there is none."""
    if not before or not after:
        return "no metrics.csv " + " and ".join(
            name for name, table in (("before", before), ("after", after)) if not table
        )
    if shared:
        common = [name for name in before[0] if name in after[0]]
        before, after = columns(before, common), columns(after, common)
    if before[0] != after[0]:
        only = sorted({*before[0]} ^ {*after[0]}) or "their order"
        return f"different columns: {only}"
    for one, other in zip(before[1:], after[1:], strict=False):
        for name, old, new in zip(before[0], one, other, strict=True):
            if old != new:
                return f"different at step {one[0]}, {name}: {old} before, {new} after"
    return None if len(before) == len(after) else f"{len(before) - 1} rows before, {len(after) - 1} after"


def columns(table: list[list[str]], names: Sequence[str]) -> list[list[str]]:
    """Return the table with these columns only."""
    index = [table[0].index(name) for name in names]
    return [[row[i] for i in index] for row in table]


if __name__ == "__main__":
    sys.exit(main())
