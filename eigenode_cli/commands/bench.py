"""`eigenode bench`: timings against peers, as ratios."""

import argparse
import json
import os
import sys
from pathlib import Path

from eigenode_cli.bench import NAMES
from eigenode_cli.errors import UserError, unknown

ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "NPROC": "1",  # the size of XLA's other thread pools
}
"""Every library is held to one thread; read when it is imported, so set before."""


def bench(args: argparse.Namespace) -> int:
    """Measure, print, and write what was asked for; exit status 1 if a peer computed something else."""
    if args.name is not None and args.name not in NAMES:
        raise UserError(unknown("case", args.name, NAMES))
    folder = None if args.output is None else _claimed(Path(args.output))
    os.environ.update(ONE_THREAD)

    from eigenode_cli.bench.run import disagreements, run_bench  # noqa: PLC0415  # the environment comes first
    from eigenode_cli.bench.table import show  # noqa: PLC0415

    content = run_bench(NAMES if args.name is None else (args.name,), _say)
    if args.json:
        print(json.dumps(content, indent=2, allow_nan=False))
    else:
        show(content)
    if folder is not None:
        from eigenode_cli.bench.figure import draw_bench  # noqa: PLC0415
        from eigenode_cli.runs.recorder import write_json  # noqa: PLC0415

        write_json(folder / "bench.json", content)
        for path in (folder / "bench.json", *draw_bench(content, folder)):
            _say(str(path))
    return 1 if disagreements(content) else 0


def _claimed(folder: Path) -> Path:
    """Return the folder for the results, there from now on: hours of measurements are not lost to a wrong name."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--output {folder}: {error.strerror}") from error
    return folder


def _say(line: str) -> None:
    """Progress goes to standard error: standard output is the result."""
    print(line, file=sys.stderr, flush=True)
