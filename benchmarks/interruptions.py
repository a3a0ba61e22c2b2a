"""Trainings interrupted at random moments of their life and resumed, against the same ones left alone: the same bytes.

    python benchmarks/interruptions.py [--count 100] [--seed 0] [--output benchmarks/interruptions.json]

Each training is the command itself in a process of its own. It gets SIGINT, SIGTERM and SIGKILL in turn, at a moment
drawn between its start and its end; every second resumption is interrupted as well. Where nothing was recorded yet, the
command is given again. What must agree is metrics.csv but for the time, every checkpoint, and all that the last one
holds for a resumption (weights, optimizer, random state).
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from safetensors.numpy import load_file

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
OFTEN = ("trainer.record_every=10", "trainer.checkpoint_every=40")
PLAIN = ("system=oscillator", *OFTEN)
STAGES = ("trainer.horizons=[0.3,0.6,1]",)
PRETRAINED = ("trainer.pretrain=sol+frq", "trainer.pretrain_steps=500")
BFGS = ("optimizer=adam_bfgs", "combine=sum", "solver.rtol=1e-6")
CASES: dict[str, tuple[tuple[str, ...], int]] = {
    "compiled adam": ((*PLAIN, "grads=sol+frq+dmp+osc"), 6000),
    "compiled adam, figures": ((*PLAIN, "grads=sol+stb", "trainer.figures=true"), 3000),
    "compiled sgd, stages": ((*PLAIN, *PRETRAINED, *STAGES, "grads=sol+stb", "optimizer=sgd", "optimizer.lr=1e-3"), 6000),
    "compiled bfgs, stages": ((*PLAIN, *BFGS, *STAGES, "grads=sol+frq", "optimizer.adam_steps=300"), 900),
    "robust": (("system=vdp", *OFTEN, "protocol=robust", "trainer.spectral_steps=200"), 800),
    "torch adam": ((*PLAIN, "grads=sol+frq", "engine=torch", "trainer.checkpoint_every=4"), 16),
    "torch sgd, stages": ((*PLAIN, *STAGES, "engine=torch", "grads=sol+stb", "optimizer=sgd", "optimizer.lr=1e-3"), 24),
    "torch bfgs, stages": (
        (*PLAIN, *BFGS, *STAGES, "engine=torch", "grads=sol+frq", "optimizer.adam_steps=8", "trainer.spectral_steps=4"),
        20,
    ),
}
"""Words and steps of each kind of training."""


@dataclass(frozen=True)
class Interruption:
    """One training that was interrupted, once or twice.

    Attributes:
        case, signals: which, and by what.
        fractions: of the life of the undisturbed training (of the resumption for the second) at which they came.
        exits: status of every process but the last, negative for one that the signal ended.
        found: status in run.json after each, None where there was none.
        steps: training steps that were saved by then, None where nothing was.
        resumed: exit status of the last process, 0.
        equal: whether the bytes are those of the undisturbed training.
        seconds: from the signal to the end of each process.
    """

    case: str
    signals: list[str]
    fractions: list[float]
    exits: list[int]
    found: list[str | None]
    steps: list[int | None]
    resumed: int
    equal: bool
    seconds: list[float]


def main() -> None:
    """Interrupt, compare, print, and write JSON where asked to; exit status 1 if any bytes differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="trainings that are interrupted")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--shorter", type=int, default=1, help="divides the steps of every training")
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        results = interrupt_all(Path(folder), args.cases, args.count, args.seed, args.shorter)
    text = json.dumps(summary(results, " ".join(["python", "benchmarks/interruptions.py", *sys.argv[1:]])), indent=1)
    print(text[: text.index('"each"')].rstrip())
    if args.output:
        args.output.write_text(text + "\n")
    sys.exit(0 if all(result.equal and result.resumed == 0 for result in results) else 1)


def interrupt_all(folder: Path, cases: list[str], count: int, seed: int, shorter: int) -> list[Interruption]:
    """Every case undisturbed, then `count` interruptions of them in turn; a line for each that does not agree."""
    words = {case: [*CASES[case][0], f"trainer.steps={CASES[case][1] // shorter}"] for case in cases}
    for case in cases:
        if not any(word.startswith("trainer.figures=") for word in words[case]):
            words[case].append("trainer.figures=false")
        for word in ("trainer.pretrain_steps=", "optimizer.adam_steps=", "trainer.spectral_steps="):
            words[case] = [shortened(one, shorter) if one.startswith(word) else one for one in words[case]]
    lives = {case: undisturbed(folder, case, words[case]) for case in cases}
    print("seconds of the undisturbed:", {case: round(life, 1) for case, life in lives.items()}, flush=True)
    draw, results = random.Random(seed), []
    for number in range(count):
        case = cases[number % len(cases)]
        chosen = SIGNALS[(number // len(cases) + number) % 3]
        result = interrupt(folder, f"cut{number}", case, words[case], chosen, lives[case], draw)
        results.append(result)
        print(number, result, flush=True)
    return results


def shortened(word: str, shorter: int) -> str:
    """A word with a number of steps, with fewer of them."""
    key, _, value = word.partition("=")
    return f"{key}={max(1, int(value) // shorter)}"


def started(folder: Path, *words: str) -> "subprocess.Popen[bytes]":
    """`eigenode WORDS` in `folder`, a process group of its own, its errors in a file."""
    with (folder / "errors.txt").open("ab") as errors:
        return subprocess.Popen(
            [sys.executable, "-m", "eigenode_cli", *words],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )


def name_of(case: str) -> str:
    """The folder of a case left alone."""
    return "whole-" + case.replace(",", "").replace(" ", "-")


def undisturbed(folder: Path, case: str, words: list[str]) -> float:
    """Train a case twice, first for the machine code to be there; returns how many seconds the second one took."""
    started(folder, "train", *words, f"hydra.run.dir=first-{name_of(case)}").wait()
    clock = time.perf_counter()
    if started(folder, "train", *words, f"hydra.run.dir={name_of(case)}").wait() != 0:
        raise RuntimeError((folder / "errors.txt").read_text())
    return time.perf_counter() - clock


def interrupt(
    folder: Path, name: str, case: str, words: list[str], chosen: signal.Signals, life: float, draw: random.Random
) -> Interruption:
    """Interrupt one training, resume it, every second time with another interruption, and compare."""
    again = draw.random() < 0.5
    signals, fractions, exits, found, steps, seconds = [], [], [], [], [], []
    for kind in [chosen, *([draw.choice(SIGNALS)] if again else [])]:
        fraction = draw.random()
        process = started(folder, *command(folder / name, words))
        try:
            process.wait(fraction * life)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, kind)
        clock = time.perf_counter()
        exits.append(process.wait())
        seconds.append(round(time.perf_counter() - clock, 3))
        signals.append(kind.name)
        fractions.append(round(fraction, 3))
        found.append(status(folder / name))
        steps.append(saved(folder / name))
        if found[-1] == "finished":
            break
    resumed = 0 if found[-1] == "finished" else started(folder, *command(folder / name, words)).wait()
    equal = status(folder / name) == "finished" and outcome(folder / name) == outcome(folder / name_of(case))
    return Interruption(case, signals, fractions, exits, found, steps, resumed, equal, seconds)


def command(run: Path, words: list[str]) -> list[str]:
    """What brings a run to its end: `resume`, or `train` where nothing was recorded."""
    if status(run) is None:
        return ["train", *words, f"hydra.run.dir={run.name}"]
    return ["resume", run.name]


def status(run: Path) -> str | None:
    """What run.json says."""
    path = run / "run.json"
    return json.loads(path.read_text())["status"] if path.exists() else None


def saved(run: Path) -> int | None:
    """The training steps in the last checkpoint."""
    path = run / "checkpoints" / "last.json"
    return json.loads(path.read_text())["step"] if path.exists() else None


def outcome(run: Path) -> dict[str, Any]:
    """Everything of a run that must not depend on interruptions."""
    rows = [line.split(",") for line in (run / "metrics.csv").read_text().splitlines()]
    last = load_file(run / "checkpoints" / "last.safetensors")
    files = [*sorted((run / "checkpoints").glob("step-*")), run / "solution.csv", run / "eigenvalues.csv"]
    return {
        "metrics": [row[:1] + row[2:] for row in rows],
        "last": {name: array.tobytes() for name, array in last.items()},
        "files": {path.name: path.read_bytes() for path in files},
    }


def summary(results: list[Interruption], typed: str) -> dict[str, Any]:
    """The counts, then every interruption."""
    exits = Counter(f"{kind} {code}" for result in results for kind, code in zip(result.signals, result.exits, strict=True))
    states = Counter(str(status) for result in results for status in result.found)
    return {
        "command": typed,
        "trainings": len(results),
        "interruptions": sum(len(result.signals) for result in results),
        "equal": sum(result.equal for result in results),
        "resumed_to_exit_0": sum(result.resumed == 0 for result in results),
        "signals_and_exits": dict(sorted(exits.items())),
        "status_after_a_signal": dict(sorted(states.items())),
        "longest_seconds_from_signal_to_end": max(second for result in results for second in result.seconds),
        "each": [asdict(result) for result in results],
    }


if __name__ == "__main__":
    main()
