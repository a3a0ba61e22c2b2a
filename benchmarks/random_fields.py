"""Random fields, 100 training steps each with the default settings: how they start and how they end.

    python benchmarks/random_fields.py --count 1000 --output benchmarks/random_fields.json

Systems, structures, activations, widths, initial weights and gains of the output are drawn from lists; `modal` is a
linear part with the modes of the target and glorot beside it. Every run is `eigenode train grads=sol+stb` but for
what is drawn. A run that ends without one of the statuses of docs/endings.md, with an exception, or after more than
`--limit` seconds is counted as such, and is a fault.
"""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import argparse
import json
import random
import shlex
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import Any

import eigenode_cli as en
from eigenode_cli.console import show_table
from eigenode_cli.training.ending import ENDED

SYSTEMS = {"oscillator": "s,v", "sparse_oscillator": "s,v", "vdp": "nu,nu_dot"}
ACTIVATIONS, STRUCTURES = ("tanh", "relu", "softplus", "elu"), ("second_order", "full")
WIDTHS, GAINS = (8, 16, 32, 64, 128, 256), (0.1, 0.3, 1.0, 3.0, 10.0)
INITS = {
    "uniform01": ("network.init=uniform01",),
    "glorot": ("network.init=glorot",),
    "modal": ("network.init=glorot", "network.linear=modes"),
}


def draw(seed: int) -> dict[str, Any]:
    """Return what run number `seed` is made of."""
    chosen = random.Random(seed)
    return {
        "system": chosen.choice(list(SYSTEMS)),
        "init": chosen.choice(list(INITS)),
        "activation": chosen.choice(ACTIVATIONS),
        "structure": chosen.choice(STRUCTURES),
        "width": chosen.choice(WIDTHS),
        "gain": chosen.choice(GAINS),
        "seed": seed,
    }


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Train 100 steps; returns the case with how it started and ended."""
    words = (
        f"system={case['system']}",
        f"system.observed=[{SYSTEMS[case['system']]}]",
        *INITS[case["init"]],
        *(f"network.activation={case['activation']}", f"network.structure={case['structure']}"),
        f"network.hidden=[{case['width']}]",
        f"network.output_gain={case['gain']}",
        f"seed={case['seed']}",
        *("grads=sol+stb", "trainer.steps=100", "trainer.record_every=10", "trainer.figures=false"),
    )
    start = perf_counter()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        try:
            found = en.train(*words, folder=Path(folder) / "run")
        except Exception as error:  # whatever it is, it is what is counted
            return case | {"status": f"exception: {type(error).__name__}: {error}", "seconds": perf_counter() - start}
        rows = found.metrics["status"]
        return case | {
            "status": found.status,
            "start": rows.iloc[0],
            "end": rows.iloc[-1],
            "failed_records": int((rows != "ok").sum()),
            "seconds": perf_counter() - start,
        }


def outcome(row: dict[str, Any], limit: float) -> str:
    """Return in which column of the table a run counts."""
    if row["status"] not in ENDED or row["status"] == "failed":
        return "faults"
    if row["seconds"] > limit:
        return "too long"
    if row["start"] == "ok":
        return "solvable" if row["end"] == "ok" and row["status"] == "finished" else f"lost, {row['status']}"
    return "healed" if row["end"] == "ok" else f"unsolvable, {row['status']}"


def main() -> None:
    """Train, count, print a table, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--limit", type=float, default=120.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    run(draw(0))  # compiles
    with ProcessPoolExecutor(args.jobs) as pool:
        rows = list(pool.map(run, map(draw, range(args.count)), chunksize=5))
    table = {init: Counter(outcome(row, args.limit) for row in rows if row["init"] == init) for init in INITS}
    columns = sorted(set().union(*table.values()), key=lambda name: (name != "solvable", name))
    cells = [
        [init, str(sum(counts.values())), *(str(counts[name]) for name in columns)] for init, counts in table.items()
    ]
    show_table(("init", "runs", *columns), cells, f"{args.count} random fields", ("runs", *columns))
    print(f"longest run: {max(row['seconds'] for row in rows):.0f} s")
    if args.output:
        faults = [row for row in rows if outcome(row, args.limit) in ("faults", "too long")]
        content = {"command": shlex.join(["python", *sys.argv]), "count": args.count, "faults": faults}
        content |= {"table": {init: dict(counts) for init, counts in table.items()}}
        args.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
