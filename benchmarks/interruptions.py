"""Trainings interrupted at random moments of their life and resumed, against the same ones left alone: the same bytes.

    python benchmarks/interruptions.py [--count 100] [--seed 0] [--output benchmarks/interruptions.json]

Each training is the command itself in a process of its own. It gets SIGINT, SIGTERM and SIGKILL in turn, at a moment
drawn between its start and its end; every second resumption is interrupted as well. Where nothing was recorded yet, the
command is given again. One in twelve is a new interpreter; the others are forks of this process, which has loaded what
they need, so that most signals come while something is trained.

What must agree is metrics.csv but for the time, every checkpoint, all that the last one holds for a resumption
(weights, optimizer, random state), solution.csv and eigenvalues.csv.
"""

import argparse
import contextlib
import io
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import Any

from safetensors.numpy import load_file

from eigenode_cli import __version__
from eigenode_cli.cli import main as eigenode

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
CAUGHT = (signal.SIGINT, signal.SIGTERM)

FRESH = 0.08
"""Share of the trainings that run in new interpreters."""

SMALL = ("system=oscillator", "trainer.record_every=10", "trainer.checkpoint_every=40")
STAGES = ("stages=[{horizons:[0.3,0.6,1]}]",)
PRETRAINED = ("stages=[{terms:sol+frq,steps:300},{horizons:[0.3,0.6,1]}]",)
SGD = ("optimizer=sgd", "optimizer.lr=1e-3", "optimizer.momentum=0.9")
BFGS = ("optimizer=adam_bfgs", "combine=sum", "solver.rtol=1e-6")
TORCH = ("engine=torch", "trainer.checkpoint_every=5", "system.horizon=1.5", "system.points=16")
CASES: dict[str, tuple[tuple[str, ...], int]] = {
    "compiled adam": ((*SMALL, "grads=sol+frq+dmp+osc"), 2000),
    "compiled sgd, pre-trained, stages": ((*SMALL, *PRETRAINED, *SGD, "grads=sol+stb"), 2000),
    "compiled bfgs, stages": ((*SMALL, *BFGS, *STAGES, "grads=sol+frq", "optimizer.adam_steps=200"), 400),
    "compiled robust": ((*SMALL, "protocol=robust", "grads=sol+frq+stb", "stages.0.steps=200"), 400),
    "compiled adam, figures": ((*SMALL, "grads=sol+stb", "trainer.figures=true"), 1000),
    "torch adam": ((*SMALL, *TORCH, "grads=sol+frq"), 24),
    "torch sgd, stages": ((*SMALL, *TORCH, *STAGES, *SGD, "grads=sol+stb"), 24),
    "torch bfgs, spectra first": ((*SMALL, *TORCH, *BFGS, "grads=sol+frq", "stages=[{solve:false,steps:6},{}]"), 18),
}
"""Words and steps of each kind of training."""
COUNTED = re.compile(r"(?<=steps[:=])\d+")
"""Numbers of steps in a setting."""


@dataclass(frozen=True)
class Blow:
    """One signal.

    Attributes:
        signal: its name.
        fraction: of the life of the undisturbed training after which it came.
        exit: status of the process, negative where the signal itself ended it, 0 where it had ended before.
        found: status in run.json then, None where there was none.
        step: of the last checkpoint then, None where there was none.
        seconds: from the signal to the end of the process.
    """

    signal: str
    fraction: float
    exit: int
    found: str | None
    step: int | None
    seconds: float


@dataclass(frozen=True)
class Interruption:
    """One training that was interrupted, once or twice.

    Attributes:
        case: which.
        fresh: whether its processes were new interpreters.
        blows: the signals.
        resumed: exit status of the last process.
        equal: whether the bytes are those of the undisturbed training.
    """

    case: str
    fresh: bool
    blows: list[Blow]
    resumed: int
    equal: bool


def main() -> None:
    """Interrupt, compare, print, and write JSON where asked to; exit status 1 if any bytes differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="trainings that are interrupted")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--shorter", type=int, default=1, help="divides the steps of every training")
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES))
    args = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so its children
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the command does
    results: list[Interruption] = []
    with tempfile.TemporaryDirectory() as folder:
        for result in interrupt_all(Path(folder), args.cases, args.count, args.seed, args.shorter):
            print(len(results), result, flush=True)
            results.append(result)
            if args.output:
                args.output.write_text(json.dumps(summary(results), indent=1) + "\n")
    print(json.dumps({key: value for key, value in summary(results).items() if key != "each"}, indent=1))
    sys.exit(0 if all(result.equal and result.resumed == 0 for result in results) else 1)


def interrupt_all(folder: Path, cases: list[str], count: int, seed: int, shorter: int) -> Iterator[Interruption]:
    """Every case undisturbed, then `count` interruptions of them in turn."""
    words = {case: words_of(case, shorter) for case in cases}
    load()
    lives = {case: undisturbed(folder, case, words[case], name_of(case), fresh=False) for case in cases}
    new = undisturbed(folder, cases[0], words[cases[0]], "new", fresh=True)
    if outcome(folder / "new") != outcome(folder / name_of(cases[0])):
        raise RuntimeError("two trainings differ that nobody interrupted")
    start, draw = max(0.0, new - lives[cases[0]]), Random(seed)
    for number in range(count):
        case, kind = cases[number % len(cases)], SIGNALS[(number + number // len(cases)) % len(SIGNALS)]
        yield interrupt(folder, f"cut{number}", case, words[case], kind, lives[case], start, draw)


def words_of(case: str, shorter: int) -> list[str]:
    """Return the settings of a case, with its numbers of steps divided."""
    given, steps = CASES[case]
    words = [f"trainer.steps={steps // shorter}"]
    words += [COUNTED.sub(lambda found: str(max(1, int(found[0]) // shorter)), word) for word in given]
    drawn = any(word.startswith("trainer.figures=") for word in given)
    return words if drawn else [*words, "trainer.figures=false"]


class Command:
    """`eigenode WORDS` in `folder`, a process group of its own: a new interpreter, or a fork of one that is loaded."""

    def __init__(self, folder: Path, words: list[str], fresh: bool) -> None:
        self._fresh = fresh
        if fresh:
            with (folder / "output.txt").open("ab") as output:
                line = [sys.executable, "-m", "eigenode_cli", *words]
                self._new = subprocess.Popen(line, cwd=folder, stdout=output, stderr=output, start_new_session=True)
            self.pid = self._new.pid
        else:
            self._fork = multiprocessing.get_context("fork").Process(target=forked, args=(folder, words))
            before = signal.pthread_sigmask(signal.SIG_BLOCK, CAUGHT)  # the fork lets them in once it is ready for them
            try:
                self._fork.start()
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            self.pid = self._fork.pid or 0

    def wait(self, seconds: float | None = None) -> int | None:
        """Return the exit status, negative for a signal; None where it still runs after so many seconds."""
        if self._fresh:
            with contextlib.suppress(subprocess.TimeoutExpired):
                return self._new.wait(seconds)
            return None
        self._fork.join(seconds)
        return self._fork.exitcode


def forked(folder: Path, words: list[str]) -> None:
    """Do what a fork does."""
    os.setsid()
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    output = os.open("output.txt", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.dup2(output, 1)
    os.dup2(output, 2)
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, CAUGHT)
        code = eigenode(words)
    except KeyboardInterrupt:  # before the command took over
        code = 130
    sys.exit(code)


def whole(folder: Path, words: list[str], fresh: bool) -> int:
    """Exit status of a command that nobody interrupts."""
    code = Command(folder, words, fresh).wait()
    return 1 if code is None else code


def name_of(case: str) -> str:
    """Return the folder of a case left alone."""
    return "whole-" + case.replace(",", "").replace(" ", "-")


def undisturbed(folder: Path, case: str, words: list[str], run: str, fresh: bool) -> float:
    """Train a case; returns how many seconds that takes."""
    clock = time.perf_counter()
    if whole(folder, ["train", *words, f"hydra.run.dir={run}"], fresh) != 0:
        raise RuntimeError((folder / "output.txt").read_text())
    print(f"{case}, {'new' if fresh else 'forked'}: {time.perf_counter() - clock:.1f} s", flush=True)
    return time.perf_counter() - clock


def interrupt(
    folder: Path,
    name: str,
    case: str,
    words: list[str],
    kind: signal.Signals,
    life: float,
    start: float,
    draw: Random,
) -> Interruption:
    """Interrupt one training, resume it, every second time with another interruption, and compare.

    Args:
        folder, name: of the run.
        case, words: what is trained.
        kind: the first signal.
        life: seconds that a fork takes; start: how many more a new interpreter needs.
        draw: where the moments come from.
    """
    run, fresh = folder / name, draw.random() < FRESH
    blows: list[Blow] = []
    for signalled in [kind, *([draw.choice(SIGNALS)] if draw.random() < 0.5 else [])]:
        fraction = draw.random()
        if status(run) != "finished":
            blow = strike(folder, run, words, signalled, fresh, fraction, life + start * fresh)
            blows.append(blow)
    resumed = 0 if status(run) == "finished" else whole(folder, command(run, words), fresh)
    equal = status(run) == "finished" and outcome(run) == outcome(folder / name_of(case))
    return Interruption(case, fresh, blows, resumed, equal)


def strike(
    folder: Path, run: Path, words: list[str], kind: signal.Signals, fresh: bool, fraction: float, life: float
) -> Blow:
    """Start or resume a run and send it a signal after a fraction of its life."""
    process = Command(folder, command(run, words), fresh)
    if process.wait(fraction * life) is None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, kind)
    clock = time.perf_counter()
    code = process.wait()
    seconds = round(time.perf_counter() - clock, 3)
    return Blow(kind.name, round(fraction, 3), 0 if code is None else code, status(run), saved(run), seconds)


def command(run: Path, words: list[str]) -> list[str]:
    """Return what brings a run to its end: `resume`, or `train` where nothing was recorded."""
    if status(run) is None:
        return ["train", *words, f"hydra.run.dir={run.name}"]
    return ["resume", run.name]


def status(run: Path) -> str | None:
    """Return what run.json says."""
    path = run / "run.json"
    return json.loads(path.read_text())["status"] if path.exists() else None


def saved(run: Path) -> int | None:
    """Return the training steps in the last checkpoint."""
    path = run / "checkpoints" / "last.json"
    return json.loads(path.read_text())["step"] if path.exists() else None


def outcome(run: Path) -> dict[str, Any]:
    """Everything of a run that must not depend on interruptions."""
    rows = [line.split(",") for line in (run / "metrics.csv").read_text().splitlines()]
    last = load_file(run / "checkpoints" / "last.safetensors")
    files = [*sorted((run / "checkpoints").glob("step-*.safetensors")), run / "solution.csv", run / "eigenvalues.csv"]
    return {
        "metrics": [row[:1] + row[2:] for row in rows],
        "last": {name: array.tobytes() for name, array in last.items()},
        "files": {path.name: path.read_bytes() for path in files},
    }


def summary(results: list[Interruption]) -> dict[str, Any]:
    """Print the counts, then every interruption."""
    blows = [blow for result in results for blow in result.blows]
    return {
        "command": " ".join(["python", "benchmarks/interruptions.py", *sys.argv[1:]]),
        "versions": {"eigenode": __version__, "python": sys.version.split()[0]},
        "trainings": len(results),
        "equal": sum(result.equal for result in results),
        "resumed_to_exit_0": sum(result.resumed == 0 for result in results),
        "signals": len(blows),
        "signals_and_exits": dict(sorted(Counter(f"{blow.signal} {blow.exit}" for blow in blows).items())),
        "status_after_a_signal": dict(sorted(Counter(str(blow.found) for blow in blows).items())),
        "longest_seconds_from_signal_to_end": max(blow.seconds for blow in blows),
        "each": [asdict(result) for result in results],
    }


def load() -> None:
    """Train a little of everything, so that a fork of this process finds modules and machine code loaded."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        for case in ("compiled adam, figures", "compiled robust", "torch adam"):
            eigenode(["train", *words_of(case, 8), f"hydra.run.dir={name_of(case)}"])


if __name__ == "__main__":
    main()
