"""Disks that fill at random moments of a training: what is recorded, and whether it goes on to the same bytes.

    python benchmarks/damage.py [--moments 20] [--seed 0]

Each run trains in a small file system of its own (a limit on the size of files where none may be mounted). At a random
record the disk is filled, up to a random number of bytes; then there is room again and the run is resumed.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from eigenode_cli.batch import run
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.errors import UserError
from eigenode_cli.runs.atomic import WriteError
from eigenode_cli.runs.runfile import read_record
from tests.batch.helpers import without_time
from tests.disk import small_disk
from tests.test_damage import WORDS
from tests.test_disk import Filling

TABLES = ("solution.csv", "eigenvalues.csv", "checkpoints/step-000020.safetensors")


def main() -> int:
    """Try all moments; the exit status is 1 where one was not as it has to be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    config = typed(compose(WORDS))
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name) / "whole"
        whole.mkdir()
        run.train(config, whole, WORDS, quiet=True)
        for moment in range(args.moments):
            step, free = 4 * int(rng.integers(0, 6)), int(rng.integers(0, 150_000))
            with small_disk(Path(name) / f"disk{moment}") as disk:
                folder = disk.folder / "run"
                folder.mkdir()
                try:
                    status = run.train(config, folder, WORDS, quiet=True, watch=Filling(disk, step, free))
                except (WriteError, UserError) as error:
                    status = f"never began: {error}"
                record = read_record(folder)
                disk.clear()
                ended = 0 if record["status"] == "finished" else run.resume(config, folder, record, quiet=True)
                same = without_time(folder) == without_time(whole)
                same = same and all((folder / table).read_bytes() == (whole / table).read_bytes() for table in TABLES)
            right = same and ended == 0 and record["status"] in ("finished", "interrupted")
            wrong += not right
            shown = {"step": step, "free": free, "status": record["status"], "code": status, "error": record["error"]}
            print(json.dumps(shown | {"resumed": ended, "same_bytes": same}), flush=True)
    print(f"{args.moments - wrong} of {args.moments} went on to the same bytes")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
