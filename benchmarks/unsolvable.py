"""How many random fields cannot be solved over the horizon at the start, with and without a modal start, by width.

    python benchmarks/unsolvable.py [--seeds 100] [--output benchmarks/unsolvable.json]

A field is built as `eigenode train` builds it for data of all states, and solved once by
tsit5 at rtol 1e-3. With a modal start (network.linear=modes, network.output_gain=0.1) a linear part has the modes of
the target, where they are the same along the trajectory, else zeros, and the network's output is a tenth.
"""

import argparse
import json
import os
import sys
from itertools import product
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does

import numpy as np

import eigenode_cli as en
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import build
from eigenode_cli.console import show_table
from eigenode_cli.engines.base import unheard
from eigenode_cli.solve.status import Status

SYSTEMS = ("oscillator", "sparse_oscillator", "vdp")
STATES = {"oscillator": "s,v", "sparse_oscillator": "s,v", "vdp": "nu,nu_dot"}
NETWORKS = {
    f"{activation}, {structure}, {init}": (
        *(f"network.activation={activation}", f"network.structure={structure}", f"network.init={init}"),
    )
    for structure, activation in (("second_order", "tanh"), ("second_order", "relu"), ("full", "relu"))
    for init in ("glorot", "uniform01")
}
WIDTHS = (8, 32, 128, 512)
STARTS = {"random": (), "modal": ("network.linear=modes", "network.output_gain=0.1")}


def main() -> None:
    """Count, print a table, and write JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    rows = []
    for system, network, width in product(SYSTEMS, NETWORKS, WIDTHS):
        words = (f"system={system}", f"system.observed=[{STATES[system]}]", *NETWORKS[network])
        counts = {name: unsolvable((*words, *start), width, args.seeds) for name, start in STARTS.items()}
        rows.append({"system": system, "network": network, "width": width, **counts})
    header = ("system", "network", "width", *(f"{name} start" for name in STARTS))
    cells = [[str(cell) for cell in row.values()] for row in rows]
    show_table(header, cells, f"unsolvable of {args.seeds}", header[2:])
    if args.output:
        command = " ".join(["python", "benchmarks/unsolvable.py", *sys.argv[1:]])
        content = {"command": command, "version": en.__version__, "seeds": args.seeds, "unsolvable": rows}
        args.output.write_text(json.dumps(content, indent=1) + "\n")


def unsolvable(words: tuple[str, ...], width: int, seeds: int) -> int:
    """Return how many of the fields cannot be solved."""
    base = ("grads=sol", f"network.hidden=[{width}]", *words)
    config = typed(compose(base))
    count = 0
    for seed in range(seeds):
        config.seed = seed
        setup = build(config, unheard)
        found = setup.engine.evaluate(setup.theta, np.array([config.system.horizon]))
        count += found.status is not Status.OK
    return count


if __name__ == "__main__":
    main()
