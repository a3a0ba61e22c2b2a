"""Learned fields on a fixed-step solver: with and without the term `stp`, over 100 horizons.

python benchmarks/fixed_step.py --seeds 10 --output benchmarks/fixed_step.json
"""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import argparse
import json
import shlex
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

import eigenode_cli as en
from eigenode_cli.solve.settings import FixedStepSolver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.trajectory import solve

HORIZONS = 100
ROOM = 1.1
"""The step that training is told is so much larger than that of the solver: a bound is met from outside."""
REACH = 10.0
"""A simulation blows up where a state exceeds this multiple of the initial one."""
CASES = {
    "overdamped, explicit Euler": ("euler", 0.05, ("system=oscillator", "system.c=25", "system.d=50")),
    "overdamped, RK4": ("rk4", 0.1, ("system=oscillator", "system.c=25", "system.d=50")),
    "damped, explicit Euler": ("euler", 0.085, ("system=oscillator", "system.c=25", "system.d=2")),
}


def run(words: tuple[str, ...], method: str, step: float, folder: Path) -> dict[str, Any]:
    """Train, and simulate the learned field with the fixed step over 100 horizons."""
    found = en.train(*words, "protocol=robust", "trainer.figures=false", folder=folder)
    field, start = found.field(), np.array(found.initial_state())
    end = HORIZONS * float(found.config.system.horizon)
    times = torch.linspace(0.0, end, 1001, dtype=torch.float64)
    with torch.no_grad():
        one = solve(field, torch.from_numpy(start), times, FixedStepSolver(method, step))
    states = one.states.numpy()
    blown = one.status is not Status.OK or not (np.abs(states) <= REACH * max(1.0, np.abs(start).max())).all()
    last = found.metrics.iloc[-1]
    return {
        "status": found.status,
        "blown": bool(blown),
        "dense_error": float(last["dense_error"]),
        "accepted": int(last["n_accepted"]),
        "max_real": float(last["max_real"]),
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    rows = []
    for name, (method, step, words) in CASES.items():
        own = (f"stp.method={method}", f"stp.step={ROOM * step:g}")
        for grads in ("sol", "sol+stp"):
            with tempfile.TemporaryDirectory() as folder:
                every = [
                    run((*words, *own, f"grads={grads}", f"seed={seed}"), method, step, Path(folder) / str(seed))
                    for seed in range(args.seeds)
                ]
            errors = [one["dense_error"] for one in every]
            rows.append(
                {
                    "case": name,
                    "method": method,
                    "step": step,
                    "grads": grads,
                    "seeds": args.seeds,
                    "blown_up": sum(one["blown"] for one in every),
                    "median_dense_error": float(np.median(errors)),
                    "worst_dense_error": float(np.max(errors)),
                    "median_accepted_steps": float(np.median([one["accepted"] for one in every])),
                    "statuses": sorted({one["status"] for one in every}),
                }
            )
            print(rows[-1], flush=True)
    record = {"command": shlex.join(["python", *sys.argv]), "horizons": HORIZONS, "rows": rows}
    args.output.write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
