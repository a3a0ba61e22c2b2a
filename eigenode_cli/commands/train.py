"""`eigenode train`: check everything, make a folder, then run the one run, its repetitions, or the sweep."""

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
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

from eigenode_cli.batch.conduct import conduct
from eigenode_cli.batch.job import figures_chosen
from eigenode_cli.batch.launch import launch, launcher_faults, settings_faults, sweeper_faults, workers
from eigenode_cli.batch.plan import Sweep, default_folder
from eigenode_cli.config.check import examine, normalise
from eigenode_cli.config.compose import finalise, typed
from eigenode_cli.config.composer import VERSION_BASE, Composer, explain, hydra_values, own_flags
from eigenode_cli.config.plugins import forced, unforced
from eigenode_cli.config.sweep import Job, Kind, examine_sweep, is_hydras, repeated
from eigenode_cli.cpus import usable_cores
from eigenode_cli.errors import UserError
from eigenode_cli.runs.atomic import WriteError, writing
from eigenode_cli.runs.lock import LOCK, locked
from eigenode_cli.runs.paths import CONFIG_DIR, claim_folder, importable, new_folder, restore_variable
from eigenode_cli.runs.runfile import RUN
from eigenode_cli.terms import canonical, split_grads

AUTO = "auto"
"""Value of `hydra.run.dir` and `hydra.sweep.dir` that asks for a folder under outputs/."""
DRY_RUN = "--dry-run"


def _job(config: DictConfig) -> int | UserError | WriteError:
    """Run the training that a job of Hydra's is; returns its exit status, or why it never began.

    An exception would be announced by Hydra, too.
    """
    from eigenode_cli.batch import run  # noqa: PLC0415  # torch, only once the command line is known to be right

    job = HydraConfig.get()
    words = [*own_flags(), *unforced(job.overrides.task)]
    try:
        return run.train(typed(finalise(config)), Path(job.runtime.output_dir), words)
    except (UserError, WriteError) as error:
        return error


@dataclass(frozen=True)
class _Checked:
    """A command line without a fault.

    Attributes:
        config: of the (first) run, with its `hydra` node.
        jobs: the runs of a sweep, or the repetitions of one run; empty for a single one.
        kinds: the configurations that differ in more than the seed.
    """

    config: DictConfig
    jobs: list[Job]
    kinds: list[Kind]


def train(words: Sequence[str]) -> int:
    """Run `eigenode train <words>`; returns the exit status.

    Raises:
        UserError: with all faults of the command line, before any folder is made.
    """
    args = _parse([word for word in words if word != DRY_RUN])
    with importable(*([args.config_dir] if args.config_dir else [])):
        if args.help or args.hydra_help or args.info or args.shell_completion:
            return _show(words)
        flags = [word for word in words if word not in (*args.overrides, DRY_RUN)]
        args.overrides = normalise(args.overrides)
        composer = Composer(args.config_dir, args.config_name or "train")
        checked = _check(args, composer)
        if args.cfg is not None:
            resolved = ["--resolve"] if args.cfg == "job" and not args.resolve else []  # a config that trains by itself
            return _show([*forced(args.overrides), *flags, *resolved])
        if DRY_RUN in words:
            return _dry_run(args, composer, checked)
        if checked.jobs:
            return _sweep(args, composer, checked)
        return _single(args.overrides, composer, checked.config)


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


def _check(args: argparse.Namespace, composer: Composer) -> _Checked:
    """Check the whole command line, every run of a sweep included."""
    hydra_words = [word for word in args.overrides if is_hydras(word)]
    _refuse(launcher_faults(hydra_words))
    found = examine(composer, hydra_words if args.multirun else args.overrides, ground=args.multirun)
    sweep = args.multirun or (found.config is not None and found.config.hydra.mode == RunMode.MULTIRUN)
    if sweep and found.config is not None:
        _refuse(sweeper_faults(found.config))
        swept = examine_sweep(composer, found.config, args.overrides)
        config = swept.checked()
        _refuse([fault for one, _ in swept.kinds for fault in sweeper_faults(one)] or settings_faults(swept.kinds))
        return _Checked(config, swept.jobs, swept.kinds)
    config = found.checked()
    jobs = repeated(composer, config, args.overrides) if config.repetitions > 1 else []
    return _Checked(config, jobs, [(config, config.repetitions)])


def _refuse(faults: list[str]) -> None:
    """Raise a UserError with the faults, if there are any, each once."""
    if faults:
        raise UserError(list(dict.fromkeys(faults)))


def _single(words: Sequence[str], composer: Composer, config: DictConfig) -> int:
    """Run one training in a folder of its own."""
    with hydra_values(config):
        grads = "+".join(canonical(split_grads(config.grads)))
        name = f"{config.system.name}_{grads}_seed{config.seed}"
        chosen = config.hydra.run.dir
    folder = claim_folder(name) if chosen == AUTO else _own_folder(chosen)
    if chosen == AUTO:
        words = [*words, f"hydra.run.dir={folder.as_posix()}"]
    with locked(folder):
        _check_empty(folder)
        try:
            with writing(folder):  # Hydra's own files; a run tells by itself
                outcome = composer.run(_job, words)
        except (HydraException, OmegaConfBaseException) as error:
            _leave(folder)
            raise UserError(explain(error)) from error
    if isinstance(outcome, Exception):
        raise outcome
    return outcome


def _own_folder(chosen: str) -> Path:
    """Return the folder that the user names, made where there is none."""
    said, folder = f"hydra.run.dir={chosen}", Path(chosen)
    new_folder(folder, said)
    return folder


def _check_empty(folder: Path) -> None:
    if (folder / RUN).exists():
        raise UserError(
            f"hydra.run.dir={folder}: holds a run already; name another folder, or go on with eigenode resume"
        )


def _leave(folder: Path) -> None:
    """Take a folder away that nothing was written into."""
    if {path.name for path in folder.iterdir()} == {LOCK}:
        with suppress(OSError):
            (folder / LOCK).unlink()
            folder.rmdir()


def _sweep(args: argparse.Namespace, composer: Composer, checked: _Checked) -> int:
    """Run a sweep by a launcher of Hydra's, or the repetitions of one run on threads of this process."""
    own = [word for word in args.overrides if not is_hydras(word)]
    of_hydra = [word for word in args.overrides if is_hydras(word) and not word.startswith("hydra.sweep.dir=")]
    flags = [f"--config-dir={Path(args.config_dir).resolve()}"] if args.config_dir else []
    flags += [f"--config-name={args.config_name}"] if args.config_name else []
    config = checked.config
    with hydra_values(config):
        chosen = config.hydra.sweep.dir
    sweep = Sweep(
        folder=default_folder(own, checked.jobs) if chosen == AUTO else Path(chosen),
        flags=tuple(flags),
        words=(*(["-m"] if args.multirun else []), *flags, *own, *of_hydra),
        jobs=tuple(checked.jobs),
    )
    if config.repetitions == 1:
        return conduct(sweep, launch(sweep, composer, config, of_hydra))
    from eigenode_cli.batch.repetitions import repeat  # noqa: PLC0415  # torch, as it runs in this process

    return conduct(sweep, lambda pending: repeat(sweep, pending, config))


def _dry_run(args: argparse.Namespace, composer: Composer, checked: _Checked) -> int:
    """Say what the command would take, and start nothing."""
    from eigenode_cli.batch.cost import show_cost  # noqa: PLC0415  # torch: it measures

    runs = sum(count for _, count in checked.kinds)
    many = workers(checked.config, runs) if args.multirun else min(runs, usable_cores())
    show_cost(composer, checked.kinds, many, drawn=not checked.jobs or figures_chosen(args.overrides))
    return 0


def _show(words: Sequence[str]) -> int:
    """Let Hydra print help, settings or completions."""
    show = hydra.main(version_base=VERSION_BASE, config_path=str(CONFIG_DIR), config_name="train")(_job)
    argv, full = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = ["eigenode" if "-sc" in words else "eigenode train", *words]
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions are raised, not printed
    try:
        show()
    except (HydraException, OmegaConfBaseException, ValueError) as error:
        raise UserError(explain(error)) from error
    except SystemExit as done:
        return 0 if not done.code else 2
    finally:
        sys.argv = argv
        restore_variable("HYDRA_FULL_ERROR", full)
    return 0
