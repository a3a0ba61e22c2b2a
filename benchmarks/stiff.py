"""A stiff NeuralODE trained with tsit5, rodas5p and auto: times as ratios, and errors.

    python benchmarks/stiff.py --seeds 10 --output benchmarks/stiff.json

The data are 121 samples of the Van der Pol oscillator with mu = 100 on its slow branch, t = 0 ... 60 s from (2, 0).
The field is a network of 16 units beside a linear part that starts with the fast rate there, -3 mu in 1/s, which an
engineer would state. All three solvers train the same start with least squares at the same tolerance (1e-6). The
error is that of x at 1,000 times against the truth, with the trained field solved by rodas5p at 1e-9 whatever it was
trained with. Times are those of a whole call of `en.fit` in the compiled engine, behind a warm-up; runs of the three
alternate.
"""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import argparse
import json
import shlex
import sys
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import torch
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.console import show_table
from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.model import VectorField
from eigenode_cli.solve.settings import AdaptiveSolver
from eigenode_cli.training.methods import LevenbergMarquardt

MU, HORIZON, STEPS = 100.0, 60.0, 60
SOLVERS = ("tsit5", "rodas5p", "auto")


def truth(times: Floats) -> Floats:
    """Return the states `(N, 2)` of the oscillator at `times (N,)` in s."""
    found = solve_ivp(
        lambda _t, x: [x[1], MU * (1.0 - x[0] ** 2) * x[1] - x[0]],
        (0.0, times[-1]),
        [2.0, 0.0],
        method="Radau",
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )
    return found.y.T


def stiff_field(seed: int) -> VectorField:
    """Return a field whose linear part decays at the fast rate."""
    generator = torch.Generator().manual_seed(seed)
    network = en.Mlp(2, (16,), 1, generator=generator, output_scale=torch.tensor([0.1], dtype=torch.float64))
    return VectorField(network, "second_order", torch.tensor([[-1.0, -3.0 * MU]], dtype=torch.float64))


def train(name: str, seed: int) -> dict[str, Any]:
    """Train once, and measure."""
    times, dense = np.linspace(0.0, HORIZON, 121), np.linspace(0.0, HORIZON, 1000)
    states = truth(times)
    data, solver = Series(times, states, states[0]), AdaptiveSolver(name, 1e-6, 1e-9, 200_000)
    target = en.StatedTarget((), ())
    start = perf_counter()
    found = en.fit(
        *(stiff_field(seed), data, target),
        method=LevenbergMarquardt(ridge=1e-8),
        stages=(en.Stage(),),
        steps=STEPS,
        record_every=STEPS,
        solver=solver,
        engine="compiled",
    )
    seconds = perf_counter() - start
    tight = found.problem.changed(solver=AdaptiveSolver("rodas5p", 1e-9, 1e-11, 200_000))
    shown = build_engine(found.field, tight).evaluate(found.theta, dense)
    own = build_engine(found.field, found.problem).evaluate(found.theta, times)
    fastest = float(np.abs(own.spectra).max())
    error = float(np.abs(shown.dense[:, 0] - truth(dense)[:, 0]).mean())
    return {
        "seconds": seconds,
        "error": error,
        "accepted": own.n_accepted,
        "fastest": fastest,
        "ending": found.ending.status,
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    for name in SOLVERS:
        train(name, 0)
    runs = {name: [] for name in SOLVERS}
    for seed in range(args.seeds):
        for name in SOLVERS:
            runs[name].append(train(name, seed))
    rows = []
    for name in SOLVERS:
        ratios = [one["seconds"] / other["seconds"] for one, other in zip(runs[name], runs["tsit5"], strict=True)]
        middle = {key: median(one[key] for one in runs[name]) for key in ("error", "accepted", "fastest")}
        failed = sum(one["ending"] != "finished" for one in runs[name])
        rows.append({"solver": name, "time_over_tsit5": median(ratios), **middle, "failed": failed})
    cells = [[row["solver"], *(f"{value:.3g}" for value in list(row.values())[1:])] for row in rows]
    show_table(tuple(rows[0]), cells, "a stiff NeuralODE", tuple(rows[0])[1:])
    if args.output:
        content = {"command": shlex.join(["python", *sys.argv]), "seeds": args.seeds, "solvers": rows, "runs": runs}
        args.output.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
