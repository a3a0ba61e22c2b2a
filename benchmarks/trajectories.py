"""Several trajectories in threads against one after another: the same loss Jacobian, in alternation.

python benchmarks/trajectories.py --output benchmarks/trajectories.json
"""

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import argparse
import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import torch

import eigenode_cli as en
from eigenode_cli.cpus import usable_cores
from eigenode_cli.data.simulate import simulate
from eigenode_cli.data.targets import TruthTarget
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.several import SeveralEngine
from eigenode_cli.model import VectorField, flat_parameters, scale_output

TERMS = ("sol", "frq", "dmp")


def engine_of(field: VectorField, count: int, points: int) -> SeveralEngine:
    """Return the engine of `count` trajectories of a Van der Pol oscillator with `points` data times each."""
    problems = []
    for number in range(count):
        truth = en.Truth(en.VanDerPol(mu=2.0), (2.0 - number / count, 0.0))
        times = np.linspace(0.0, 30.0, points)
        series = simulate(truth, times, ["nu", "nu_dot"]).series[0]
        problems.append(Problem(series, TruthTarget(truth).rows(times), terms=TERMS))
    built = build_engine(field, replace(problems[0], others=tuple(problems[1:])))
    if not isinstance(built, SeveralEngine):
        raise TypeError("one trajectory")
    return built


def seconds(engine: Engine, theta: np.ndarray, calls: int) -> float:
    """Return the time of `calls` loss Jacobians."""
    start = perf_counter()
    for _ in range(calls):
        engine.loss_jacobian(theta)
    return perf_counter() - start


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for width in (32, 128):
        network = en.Mlp(2, (width,), 1, generator=torch.Generator().manual_seed(0))
        scale_output(network, 0.01)
        field = VectorField(network, linear=torch.tensor([[-1.0, -0.02]]))  # it swings, as a trained one does
        theta = flat_parameters(field)
        for count in (2, 4, 8):
            engine = engine_of(field, count, 91)
            threads, found = engine.threads, engine.loss_jacobian(theta)
            engine.threads = 1
            alone = engine.loss_jacobian(theta)
            equal = found.gradients.tobytes() == alone.gradients.tobytes()
            ratios = []
            for _ in range(15):
                engine.threads = 1
                one = seconds(engine, theta, 20)
                engine.threads = threads
                ratios.append(one / seconds(engine, theta, 20))
            rows.append(
                {
                    "width": width,
                    "trajectories": count,
                    "ratio": float(np.median(ratios)),
                    "equal_bytes": equal,
                }
            )
            print(rows[-1])
    record = {"command": shlex.join(["python", *sys.argv]), "cores": usable_cores(), "rows": rows}
    args.output.write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
