"""What a sweep will take, from trying a few steps of its runs: time on the cores that there are, and disk.

The model: a run takes a time for each step, a time for each record, and a fixed time (building, outcome, files). They
are measured by training a kind of run for one step and for some more, into a folder that is thrown away, and by
evaluating a few records; to a run of a sweep comes what Hydra does for each of its jobs. A worker besides has to start
and to compose each kind once, and the command itself checks first and draws last. Steps get slower or faster while a
network learns, and cores are shared: expect a factor of two, not a per cent.
"""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.batch import run
from eigenode_cli.batch.launch import launcher_of
from eigenode_cli.batch.outcome import dense_grid
from eigenode_cli.batch.plan import quoted
from eigenode_cli.batch.state import recorded
from eigenode_cli.config.compose import finalise, typed
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.schema import TrainConfig, TrainerConfig
from eigenode_cli.config.sweep import Kind, settings_of
from eigenode_cli.console import duration
from eigenode_cli.errors import UserError
from eigenode_cli.model import flat_parameters

MOST = 4
"""Kinds that are tried; the others are taken to cost as much as these on average."""
FEW, MANY = 20, 200
"""Steps of the two tries; the longer one only where the shorter took less than `LONG`."""
LONG = 0.05
RECORDS, JOBS = 5, 6
BLOCK = 4096
"""Bytes by which a file takes room."""


@dataclass(frozen=True)
class Cost:
    """Of one kind of run.

    Attributes:
        step: seconds of a step.
        rest: seconds of everything else in a run.
        steps: number of them.
        disk: bytes that a run takes.
    """

    step: float
    rest: float
    steps: int
    disk: int

    @property
    def seconds(self) -> float:
        """Time of one run."""
        return self.rest + self.step * self.steps


def measure(kind: Kind, drawn: bool) -> Cost:
    """Try one kind of run, with its figures if they are `drawn`.

    Raises:
        UserError: it fails.
    """
    config = typed(settings_of(kind[0], kind[0].seed))
    config.trainer.figures = config.trainer.figures and drawn
    steps, records = config.trainer.steps, _every(config.trainer.record_every, config.trainer.steps)
    with tempfile.TemporaryDirectory(prefix="eigenode-dry-run-") as folder:
        place = Path(folder)
        _try(config, 1, place / "first")  # compiles or loads the kernels
        one, _ = _try(config, 1, place / "one")
        tried, (_, training) = FEW, _try(config, FEW, place / "few")
        if training < LONG:
            tried, (_, training) = MANY, _try(config, MANY, place / "many")
        disk = _disk(place / "one", config.trainer, steps) + _blocks(len(OmegaConf.to_yaml(kind[0])))
    rest = one + (records - 2) * _record_seconds(config)  # a run of one step has two records
    return Cost(training / tried, rest, steps, disk)


@dataclass(frozen=True)
class Around:
    """Seconds of what a sweep takes besides its runs.

    Attributes:
        command: checking, starting a worker, drawing the summary.
        kind: composing one kind, once in each worker.
        job: Hydra's work for one job.
    """

    command: float
    kind: float
    job: float


def expected_seconds(costs: Sequence[Cost], counts: Sequence[int], workers: int, around: Around) -> float:
    """Time of the whole sweep in s.

    Args:
        costs: of the kinds that were measured.
        counts: number of runs of every kind, the measured ones first.
        workers: runs at once.
        around: the rest.
    """
    seconds = [around.job + cost.seconds for cost in costs]
    seconds += [float(np.mean(seconds))] * (len(counts) - len(seconds))
    work = sum(count * each for count, each in zip(counts, seconds, strict=True))
    return around.command + around.kind * len(counts) + max(work / workers, *seconds)


def show_cost(composer: Composer, kinds: Sequence[Kind], workers: int, drawn: bool) -> None:
    """Print how many runs there are, the time they are expected to take and the disk."""
    checking = process_time()
    order = np.unique(np.linspace(0, len(kinds) - 1, min(MOST, len(kinds))).round().astype(int)).tolist()
    costs = [measure(kinds[index], drawn) for index in order]
    counts = [kinds[i][1] for i in [*order, *(i for i in range(len(kinds)) if i not in order)]]
    command = checking + _seconds(sys.executable, "-c", "import eigenode_cli.batch.figure") + _start_seconds()
    around = Around(command, _compose_seconds(composer), _job_seconds(composer))
    seconds = expected_seconds(costs, counts, workers, around)
    runs = sum(counts)
    disks = [cost.disk for cost in costs]
    disk = sum(count * size for count, size in zip(counts, disks, strict=False))
    disk += int(np.mean(disks) * sum(counts[len(disks) :]))
    steps, rests = [1e3 * cost.step for cost in costs], [cost.rest for cost in costs]
    print(f"runs  {runs}, of {len(kinds)} {'kind' if len(kinds) == 1 else 'kinds'} (the seed apart)")
    print(f"time  about {duration(seconds)} on {workers} {'core' if workers == 1 else 'cores'}")
    print(f"disk  {disk / 1e6:.1f} MB")
    print(
        f"measured on {len(costs)} of {len(kinds)}: a step {_range(steps)} ms, everything else {_range(rests)} s a run"
    )


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return low if low == high else f"{low} to {high}"


def _try(config: TrainConfig, steps: int, folder: Path) -> tuple[float, float]:
    """Train for some steps in `folder`; gives the seconds of the whole run and those of the training alone."""
    folder.mkdir()
    kept = config.trainer.steps
    config.trainer.steps = steps
    clock = perf_counter()
    status = run.train(config, folder, [], quiet=True)
    seconds = perf_counter() - clock
    config.trainer.steps = kept
    if status != 0:
        raise UserError(f"--dry-run: a run that was tried for {steps} steps failed: {recorded(folder).error}")
    return seconds, recorded(folder).record["train_seconds"]


def _record_seconds(config: TrainConfig) -> float:
    """Time of a record, the median of a few."""
    setup = run.build(config, lambda _: None)
    theta, times = flat_parameters(setup.field), dense_grid(setup)
    seconds = []
    for _ in range(RECORDS):
        clock = perf_counter()
        setup.engine.evaluate(theta, times)
        seconds.append(perf_counter() - clock)
    return float(np.median(seconds))


def _every(interval: int, steps: int) -> int:
    """How often something happens that is done every `interval` steps, at the first, and at the last."""
    return len({*range(0, steps, interval), steps})


def _disk(folder: Path, config: TrainerConfig, steps: int) -> int:
    """Bytes of a run of `steps` steps, from one of a single step: that has two records and two checkpoints."""
    metrics = (folder / "metrics.csv").read_text().splitlines(keepends=True)
    fixed = sum(_blocks(path.stat().st_size) for path in folder.rglob("*") if path.is_file())
    weights = (folder / "checkpoints" / "step-000000.safetensors").stat().st_size
    table = sum(map(len, metrics))
    longer = table + (_every(config.record_every, steps) - 2) * len(metrics[-1])
    return fixed + _blocks(longer) - _blocks(table) + (_every(config.checkpoint_every, steps) - 2) * _blocks(weights)


def _blocks(size: int) -> int:
    return -(-size // BLOCK) * BLOCK


def _compose_seconds(composer: Composer) -> float:
    clock = perf_counter()
    composer.loader.load_configuration(composer.config_name, [], RunMode.RUN)
    return perf_counter() - clock


def _start_seconds() -> float:
    """Time of starting a worker: that of a run which hardly trains, as a command."""
    with tempfile.TemporaryDirectory(prefix="eigenode-dry-run-") as folder:
        short = ("trainer.steps=1", "trainer.figures=false", quoted("hydra.run.dir", folder))
        return _seconds(sys.executable, "-m", "eigenode_cli", "train", *short)


def _seconds(*command: str) -> float:
    clock = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - clock


def _job_seconds(composer: Composer) -> float:
    """Time that a job takes without its run: its configuration, made from one of another seed, and its files."""
    with tempfile.TemporaryDirectory(prefix="eigenode-dry-run-") as folder:
        launcher = launcher_of(composer, ["hydra/launcher=basic", quoted("hydra.sweep.dir", folder)], _idle)
        seconds = []
        for seed in range(JOBS):
            clock = perf_counter()
            launcher.launch([[f"seed={seed}"]], initial_job_idx=seed)
            seconds.append(perf_counter() - clock)
    return float(np.median(seconds[1:]))


def _idle(config: DictConfig) -> int:
    """Do the work of a job up to its run."""
    typed(finalise(config))
    return 0
