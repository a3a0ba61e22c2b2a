"""`eigenode train`: check everything, make a folder, then let Hydra run the job or the sweep."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from eigenode_cli.config.compose import finalise, typed
from eigenode_cli.config.composer import VERSION_BASE, Composer, explain, hydra_values
from eigenode_cli.config.examine import examine, normalise
from eigenode_cli.config.sweep import examine_sweep
from eigenode_cli.errors import UserError
from eigenode_cli.paths import CONFIG_DIR, claim_folder, importable, restore_variable
from eigenode_cli.terms import canonical, split_grads

AUTO = "auto"
"""Value of `hydra.run.dir` and `hydra.sweep.dir` that asks for a new folder under outputs/."""
INTERRUPTED = 130

_statuses: list[int] = []


@hydra.main(version_base=VERSION_BASE, config_path=str(CONFIG_DIR), config_name="train")
def _job(config: DictConfig) -> None:
    from eigenode_cli import run  # noqa: PLC0415  # torch, only once the command line is known to be right

    job = HydraConfig.get()
    status = run.train(typed(finalise(config)), Path(job.runtime.output_dir), job.overrides.task)
    _statuses.append(status)
    if status == INTERRUPTED:
        raise KeyboardInterrupt


def train(words: Sequence[str]) -> int:
    """Run `eigenode train <words>`; returns the exit status.

    Raises:
        UserError: with all faults of the command line, before any folder is made.
    """
    args = _parse(words)
    with importable(*([args.config_dir] if args.config_dir else [])):
        if args.help or args.hydra_help or args.info or args.shell_completion:
            return _show(words)
        flags = [word for word in words if word not in args.overrides]
        args.overrides = normalise(args.overrides)
        place = _check(args)
        if args.cfg is not None:
            return _show([*args.overrides, *flags])
        folder = claim_folder(place.name) if place.name else None
        chosen = [f"{place.key}={folder.as_posix()}"] if folder else []
        return _start([*args.overrides, *chosen, *flags], folder)


@dataclass(frozen=True)
class _Place:
    """Where results go: a new folder called `name`, or, where that is None, the one that the user set as `key`."""

    key: str
    name: str | None


def _parse(words: Sequence[str]) -> argparse.Namespace:
    parser = get_args_parser()

    def fail(message: str) -> NoReturn:
        raise UserError(f"train: {message}; 'eigenode train --hydra-help' lists the flags")

    parser.error = fail
    args = parser.parse_intermixed_args(list(words))
    modes = [args.run, args.multirun, args.cfg is not None, args.info is not None, args.shell_completion]
    faults = []
    if sum(modes) > 1:
        faults.append("train: only one of --run, --multirun, --cfg, --info and --shell-completion goes at a time")
    if args.resolve and args.cfg is None and not args.help:
        faults.append("train: --resolve goes with --cfg")
    if args.config_path is not None:
        faults.append(f"--config-path {args.config_path}: would hide the shipped configs; add yours with --config-dir")
    if args.experimental_rerun is not None:
        faults.append("--experimental-rerun: not supported; use eigenode resume RUN")
    if faults:
        raise UserError(faults)
    return args


def _check(args: argparse.Namespace) -> _Place:
    """Check the whole command line, every run of a sweep included, and say where the results go."""
    composer = Composer(args.config_dir, args.config_name or "train")
    hydra_words = [word for word in args.overrides if word.lstrip("+~").startswith(("hydra.", "hydra/"))]
    found = examine(composer, hydra_words if args.multirun else args.overrides)
    sweep = args.multirun or (found.config is not None and found.config.hydra.mode == RunMode.MULTIRUN)
    if sweep and found.config is not None:
        found = examine_sweep(composer, found.config, args.overrides)
    config = found.checked()
    with hydra_values(config):
        if sweep:
            return _place("hydra.sweep.dir", config.hydra.sweep.dir, "sweep", "*/run.json")
        grads = "+".join(canonical(split_grads(config.grads)))
        name = f"{config.system.name}_{grads}_seed{config.seed}"
        return _place("hydra.run.dir", config.hydra.run.dir, name, "run.json")


def _place(key: str, folder: str, name: str, runs: str) -> _Place:
    if folder == AUTO:
        return _Place(key, name)
    if Path(folder).exists() and not Path(folder).is_dir():
        raise UserError(f"{key}={folder}: is a file; name a folder")
    if any(Path(folder).glob(runs)):
        raise UserError(f"{key}={folder}: holds a run already; name another folder, or go on with eigenode resume")
    return _Place(key, None)


def _start(words: Sequence[str], claimed: Path | None) -> int:
    """Let Hydra start the job or the sweep; an empty folder is not left behind."""
    _statuses.clear()
    try:
        with _handed_over(words):
            _job()
    except (HydraException, OmegaConfBaseException) as error:
        if claimed is not None and not any(claimed.iterdir()):
            claimed.rmdir()
        raise UserError(explain(error)) from error
    except KeyboardInterrupt:
        if INTERRUPTED not in _statuses:
            raise
    return max(_statuses, default=0)


def _show(words: Sequence[str]) -> int:
    """Let Hydra print help, settings or completions."""
    try:
        with _handed_over(words):
            _job()
    except (HydraException, OmegaConfBaseException, ValueError) as error:
        raise UserError(explain(error)) from error
    except SystemExit as done:
        return 0 if not done.code else 2
    return 0


@contextmanager
def _handed_over(words: Sequence[str]) -> Iterator[None]:
    """The process as Hydra expects it: its words in `sys.argv`, and exceptions raised instead of printed."""
    argv, full = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = ["eigenode" if "-sc" in words else "eigenode train", *words]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        yield
    finally:
        sys.argv = argv
        restore_variable("HYDRA_FULL_ERROR", full)
