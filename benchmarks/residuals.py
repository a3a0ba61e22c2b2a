"""What a residual Jacobian and a Levenberg-Marquardt step cost, as ratios to a loss Jacobian of the same problem.

    python benchmarks/residuals.py [--rounds 15] [--output benchmarks/residuals.json]

The system has n/2 modes between 0.5 and 2 Hz, all positions are measured at 41 times. The field is a linear part with
these modes beside a network of one hidden layer; P counts its parameters and the linear part's. The three calls are
timed in alternation, the median over the rounds counts.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from time import perf_counter

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import numpy as np
import torch

import eigenode_cli as en
from eigenode_cli.training.least_squares import Iteration, LeastSquares, relative_scales

STATES = (2, 4, 8, 20)
PARAMETERS = (33, 129, 500, 2000)
"""About as many: the width of the hidden layer is rounded."""
TERMS = ("sol", "frq", "dmp")


def main() -> None:
    """Measure, print a line a size, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    sizes = []
    for n in STATES:
        for wanted in PARAMETERS:
            sizes.append(measured(n, wanted, args.rounds))
            print(line(sizes[-1]), flush=True)
    if args.output:
        command = " ".join(["python", "benchmarks/residuals.py", *sys.argv[1:]])
        args.output.write_text(
            json.dumps({"command": command, "version": en.__version__, "sizes": sizes}, indent=1) + "\n"
        )


def measured(n: int, wanted: int, rounds: int) -> dict[str, float]:
    """Return the ratios at n states and about so many parameters."""
    half = n // 2
    width = max(1, round((wanted - half - half * n) / (n + 1 + half)))
    times = np.linspace(0.0, 4.0, 41)
    frequency = np.linspace(0.5, 2.0, half) if half > 1 else np.array([1.0])
    phase = 2.0 * np.pi * frequency * times[:, None]
    positions = np.exp(-0.05 * phase) * np.cos(phase)
    values = np.hstack([positions, np.full_like(positions, np.nan)])
    start = np.concatenate([np.ones(half), -0.05 * 2.0 * np.pi * frequency])
    data = en.Series(times, values, start)
    target = en.StatedTarget(frequency.tolist(), [0.05] * half)
    network = en.Mlp(n, [width], half, generator=torch.Generator().manual_seed(0))
    field = en.modal_field(network, data, target, output_gain=0.01)
    solver = en.AdaptiveSolver(rtol=1e-6, atol=1e-7)
    problem = en.Problem(data, target.rows(times), terms=TERMS, stabilise=False, solver=solver)
    engine, theta = en.build_engine(field, problem), en.flat_parameters(field)
    scales = relative_scales({"sol": 1.0, "frq": 1e-6, "dmp": 1e-6}, problem)
    factors = np.array([scales[term] for term in TERMS])

    def lm_step() -> None:
        function, iteration = LeastSquares(engine, factors), Iteration(1e-3, 0.0)
        point = theta.copy()
        iteration.step(point, function.at(point), function.value)

    calls = (lambda: engine.loss_jacobian(theta), lambda: engine.residual_jacobian(theta), lm_step)
    spent = np.array([[seconds(call) for call in calls] for _ in range(rounds + 2)])[2:]
    ratios = np.median(spent / spent[:, :1], axis=0)
    residuals = engine.residual_jacobian(theta).residuals.size
    found = {"n": n, "parameters": theta.size, "residuals": residuals}
    return {**found, "residual_jacobian": float(ratios[1]), "lm_step": float(ratios[2])}


def seconds(call) -> float:
    """Return the time of one call."""
    start = perf_counter()
    call()
    return perf_counter() - start


def line(size: dict[str, float]) -> str:
    """Return the ratios of one size in one line."""
    return (
        f"n = {size['n']}, P = {size['parameters']}, {size['residuals']} residuals: residual Jacobian"
        f" {size['residual_jacobian']:.2f}, LM step {size['lm_step']:.2f} loss Jacobians"
    )


if __name__ == "__main__":
    main()
