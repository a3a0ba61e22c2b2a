"""One run: from a configuration to a folder with curves."""

import shlex
import subprocess
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from eigenode_cli import __version__
from eigenode_cli.batch.measured import measured_description
from eigenode_cli.batch.outcome import build_recorder, dense_grid, write_outcome
from eigenode_cli.batch.resumption import check_saved
from eigenode_cli.batch.stability import not_stable
from eigenode_cli.config.build import build_method, build_options, build_schedule, combination
from eigenode_cli.config.prediction import holdout_of
from eigenode_cli.config.schema import SCHEMAS, TrainConfig
from eigenode_cli.config.setup import Setup, build
from eigenode_cli.console import Display, QuietDisplay, display
from eigenode_cli.engines.base import unheard
from eigenode_cli.engines.problem import Problem
from eigenode_cli.interruption import check
from eigenode_cli.model import load_flat
from eigenode_cli.runs.atomic import Reserve, WriteError, write_text
from eigenode_cli.runs.lock import locked
from eigenode_cli.runs.recorder import load_last, write_json
from eigenode_cli.runs.runfile import VERSION, resume_command
from eigenode_cli.terms import canonical, split_grads
from eigenode_cli.terms.errors import error_value
from eigenode_cli.terms.user import TermFailed
from eigenode_cli.training.ending import DIVERGED, FAILED, FINISHED, INTERRUPTED, STALLED, Ending
from eigenode_cli.training.optimizers import build_optimizer
from eigenode_cli.training.options import RETRY
from eigenode_cli.training.progress import Progress, summary
from eigenode_cli.training.trainer import Trainer, Unsolvable

EXIT = {FINISHED: 0, FAILED: 1, STALLED: 1, DIVERGED: 1, INTERRUPTED: 130}
"""Exit status by the status of the run."""

PACKAGES = ("torch", "torchdiffeq", "numba", "numpy", "scipy", "hydra-core", "omegaconf", "pandas", "matplotlib")


def train(
    config: TrainConfig, folder: Path, overrides: Sequence[str], quiet: bool = False, watch: Display | None = None
) -> int:
    """Run one training in `folder`; returns the exit status (0 done, 1 failed, stalled or diverged, 130 interrupted).

    Args:
        config: the checked configuration.
        folder: exists, and holds no other run.
        overrides: what the user changed; with them run.json names the command that repeats this run.
        quiet: print nothing, for one run among many; everything that happened stands in the folder.
        watch: is shown every record of a quiet run.
    """
    record = _identity(config)
    record["command"] = shlex.join(["eigenode", "train", *overrides])
    with locked(folder):
        return _attended(config, folder, record, resumed=False, quiet=quiet, watch=watch)


def resume(
    config: TrainConfig, folder: Path, previous: dict[str, Any], quiet: bool = False, watch: Display | None = None
) -> int:
    """Go on with the run in `folder` from what it saved last; `previous` is its run.json.

    Raises:
        UserError: what it saved is damaged or does not go with `config`, or another process works in the folder.
    """
    with locked(folder):
        identity = _identity(config)
        check_saved(config, folder)
        kept = {key: previous.get(key, identity[key]) for key in ("command", "started", "wall_seconds")}
        return _attended(config, folder, identity | kept, resumed=True, quiet=quiet, watch=watch)


def _attended(
    config: TrainConfig, folder: Path, record: dict[str, Any], resumed: bool, quiet: bool, watch: Display | None
) -> int:
    """Run a training so that run.json, filled from `record` on, tells how it ended, whatever happens."""
    start = perf_counter()
    reserve, full = Reserve(folder), None
    reserve.take()
    write_json(folder / "run.json", record)
    try:
        setup = build(config, unheard if quiet else print)
        record |= _description(setup)
        write_json(folder / "run.json", record)
        ending = _train(setup, folder, record, resumed, (watch or QuietDisplay()) if quiet else None, start)
    except KeyboardInterrupt:
        ending = Ending(INTERRUPTED, "interrupted by the user")
    except Unsolvable as error:
        ending = Ending(FAILED, str(error))
    except WriteError as error:  # once there is room, it goes on from what was saved
        ending, full = Ending(INTERRUPTED, str(error)), error
    except Exception as error:  # whatever it was: the folder tells, a sweep goes on
        with suppress(WriteError):
            write_text(folder / "error.txt", traceback.format_exc())
        said = str(error) if isinstance(error, TermFailed) else f"{type(error).__name__}: {error}"
        ending = Ending(FAILED, f"{said} (traceback in error.txt)")
    successful = ending.status == FINISHED
    record |= {"status": ending.status, "error": None if successful else ending.reason}
    record["stopped"] = ending.reason if successful else None
    record["wall_seconds"] += perf_counter() - start
    try:
        reserve.give()
        write_json(folder / "run.json", record)
    except WriteError as error:
        full = full or error
        if not quiet:
            print(f"eigenode: {error}", file=sys.stderr)
    if not quiet:
        _tell(folder, record)
    if full is not None:
        return EXIT[FAILED]
    drawn = draw(folder, quiet) if config.trainer.figures and record["final"] else EXIT[FINISHED]
    return EXIT[ending.status] or drawn


def _train(
    setup: Setup, folder: Path, record: dict[str, Any], resumed: bool, shown: Display | None, start: float
) -> Ending:
    """Train from the start, or from what was saved last, and write the outcome; fills `record` as it gets there.

    Args:
        setup: the parts.
        folder, record: of the run.
        resumed: whether to look for something saved.
        shown: shows the progress, by default what fits standard output.
        start: reading of the clock at which `record` was right about `wall_seconds`.

    Returns:
        How it ended.
    """
    config = setup.config
    saved = load_last(folder) if resumed else None
    if saved is not None:  # a kill leaves run.json alone
        record["wall_seconds"] = max(record["wall_seconds"], saved.progress.wall_seconds)
    theta = setup.theta.copy()
    network, retries = setup.blocks["network"].stop, config.trainer.on_unsolvable == RETRY
    optimizer = build_optimizer(build_method(config), theta.size, network, build_schedule(config), retries)
    dense_times, holdout = dense_grid(setup), holdout_of(setup)
    recorder = build_recorder(setup, folder, dense_times, tuple(optimizer.records))
    done = 0 if saved is None else saved.progress.step
    shown = shown or _display(setup, done)
    trainer = Trainer(
        engine=setup.engine,
        phases=setup.phases,
        optimizer=optimizer,
        combination=combination(config.combine),
        terms=setup.problem.terms,
        weights=setup.weights,
        options=build_options(config),
        recorder=recorder,
        display=shown,
        dense_times=dense_times,
        theta=theta,
        network=setup.tensors,
        progress=Progress(),
        zero_sol=_sol_of_zero(setup.problem),
        tested=holdout.error if holdout is not None and holdout.held_out else None,
        wall=partial(_elapsed, record["wall_seconds"] - start),
    )
    if saved is not None:
        trainer.go_on(saved)
    recorder.open(None if saved is None else done)
    try:
        with shown:
            last = trainer.run()
    finally:
        recorder.close()
        record |= _account(trainer, setup)
    load_flat(setup.field, theta)
    record |= write_outcome(setup, folder, holdout, theta)
    record |= {"final": last, "summary": summary(last, trainer.progress)}
    if (said := not_stable(setup, record["stability"])) is not None:
        shown.say(said)
    return trainer.ending


def _display(setup: Setup, done: int) -> Display:
    config = setup.config
    label = f"{config.system.name} {'+'.join(setup.problem.terms)} seed {config.seed}"
    return display(label, done, config.trainer.steps)


def _elapsed(offset: float) -> float:
    return offset + perf_counter()


def _sol_of_zero(problem: Problem) -> float:
    """SOL of a model that stays at zero, NaN where SOL does not train."""
    if "sol" not in problem.terms:
        return float("nan")
    error = getattr(error_value, "py_func", error_value)  # as Python: to compile it would take longer
    every = [one.data for one in problem.trajectories]
    seen = np.concatenate([data.channels[data.channel_mask] for data in every]).tolist()
    return float(np.mean([error(problem.errors[0], problem.huber_delta, value) for value in seen]))


def _account(trainer: Trainer, setup: Setup) -> dict[str, Any]:
    """Return what a training took so far."""
    progress = trainer.progress
    return {
        "steps": progress.step,
        "train_seconds": progress.train_seconds,
        "compile_seconds": sum(engine.compile_seconds for engine in setup.engines),
        "unsolvable_steps": progress.unsolvable_steps,
        "guard_count": progress.guard_count,
        "converged_at": progress.converged_at,
        "best_step": progress.best_step,
    }


def _identity(config: TrainConfig) -> dict[str, Any]:
    """Return what is known of a run before anything is built."""
    return {
        "version": VERSION,
        "status": "running",
        "error": None,
        "seed": config.seed,
        "grads": "+".join(canonical(split_grads(config.grads))),
        "config": OmegaConf.to_container(OmegaConf.structured(config), resolve=True),
        "schemas": {group: type(getattr(config, group)).__name__ for group in SCHEMAS},
        "command": "",
        "versions": {"eigenode": __version__, "python": sys.version.split()[0], **_versions()},
        "git_commit": _git_commit(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "steps": 0,
        "train_seconds": 0.0,
        "compile_seconds": 0.0,
        "wall_seconds": 0.0,
        "final": {},
    }


def _description(setup: Setup) -> dict[str, Any]:
    """Return what is known of a run once its parts are built."""
    source = setup.source
    return {
        "engine": setup.engine.name,
        "parameters": setup.theta.size,
        "system": {
            "name": setup.config.system.name,
            "title": source.title,
            "states": [asdict(state) for state in source.states],
            "parameters": [asdict(parameter) for parameter in source.parameters],
            **(measured_description(source) if source.measured is not None else {}),
        },
    }


@cache
def _versions() -> dict[str, str]:
    return {package: version(package) for package in PACKAGES}


@cache
def _git_commit() -> str | None:
    """Commit of the checkout that this package runs from, None for an installed one."""
    here = Path(__file__).resolve().parents[1]
    if not (here.parent / ".git").exists():
        return None
    git = subprocess.run(["git", "-C", here, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    return git.stdout.strip() or None


def draw(folder: Path, quiet: bool) -> int:
    """Draw figures and page of a run whose record is complete and stays as it is; returns the exit status.

    It is 0 even where the figures fail, which is said in a line on standard error, and 130 where they are interrupted.
    """
    again = f"the run is recorded; draw it again with: eigenode plot {folder} and eigenode report {folder}"
    try:
        from eigenode_cli.reporting.figures import draw_run  # noqa: PLC0415  # matplotlib and pandas, only once they are needed
        from eigenode_cli.reporting.report import write_report  # noqa: PLC0415

        for fault in draw_run(folder).faults:
            print(f"eigenode: {fault}", file=sys.stderr)
        check()
        write_report(folder)
        if not quiet:
            print(f"figures {folder / 'plots'}\nreport  {folder / 'report.html'}")
    except KeyboardInterrupt:
        print(f"eigenode: the figures were interrupted; {again}", file=sys.stderr)
        return EXIT[INTERRUPTED]
    except Exception as error:  # whatever it was: the training is recorded
        print(f"eigenode: the figures failed ({type(error).__name__}: {error}); {again}", file=sys.stderr)
    return EXIT[FINISHED]


def _tell(folder: Path, record: dict[str, Any]) -> None:
    """Say how the run ended and where everything is."""
    if record["status"] != FINISHED:
        print(f"eigenode: {record['status']}: {record['error']}", file=sys.stderr)
    if record["status"] == INTERRUPTED:
        print(f"go on with: {resume_command(folder, record['command'])}", file=sys.stderr)
    if record["final"]:
        print(f"{record['summary']}\nrun     {folder}")
