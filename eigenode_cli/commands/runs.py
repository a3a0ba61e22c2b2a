"""`eigenode resume | plot | report RUN`: what is done with the folder of a run, or of a sweep."""

import argparse
import sys
from pathlib import Path
from typing import Any

from eigenode_cli.batch.plan import PLAN, quoted, read_plan
from eigenode_cli.errors import UserError
from eigenode_cli.runs.lock import locked
from eigenode_cli.runs.paths import OUTPUTS, importable, is_folder, run_folder
from eigenode_cli.runs.runfile import Record, config_dirs, read_record
from eigenode_cli.training.ending import FINAL, FINISHED

MAY_CHANGE = ("trainer.steps", "trainer.record_every", "trainer.checkpoint_every", "trainer.figures", "trainer.stop")
"""Settings that may change when a run goes on: they do not touch the steps that were done."""


def resume(args: argparse.Namespace) -> int:
    """Go on with a run, or with a sweep, where it stopped; with settings that may change, beyond where it ended."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        if args.words:
            raise UserError([f"{word}: a sweep is resumed as it was started" for word in args.words])
        return _resume_sweep(sweep, args.config_dir)
    folder = run_folder(args.run)
    with locked(folder):
        previous = read_record(folder)
        record = Record(previous)
        status = record.text("status")
        if status in FINAL and not (args.words and status == FINISHED):
            raise UserError(f"{args.run}: {_finality(previous)}")
        dirs = config_dirs(record.text("command"))
        from eigenode_cli.config.compose import restore, with_changes  # noqa: PLC0415

        with importable(*([args.config_dir] if args.config_dir else dirs)):
            settings = with_changes(record.mapping("config"), args.words, MAY_CHANGE)
            config = restore(settings, previous.get("schemas"))
            if status == FINISHED and not previous.get("stopped") and config.trainer.steps <= previous["steps"]:
                raise UserError(
                    f"trainer.steps={config.trainer.steps}: the run has done {previous['steps']}; give more of them"
                )
            from eigenode_cli.batch import run  # noqa: PLC0415

            return run.resume(config, folder, previous)


def _finality(record: dict[str, Any]) -> str:
    """Why there is nothing to resume."""
    if record["status"] == FINISHED:
        return "the run is finished; to go on with it, give more steps, for example trainer.steps=10000"
    return f"the run {record['status']}, to resume it would lead to the same ({record['error']}); start a new one"


def plot(args: argparse.Namespace) -> int:
    """Draw a run's figures again, or a sweep's."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        from eigenode_cli.batch.figure import draw_summary  # noqa: PLC0415
        from eigenode_cli.batch.summary import group, read_rows  # noqa: PLC0415

        return _tell(draw_summary(sweep, group(read_rows(read_plan(sweep)))), [])
    folder = run_folder(args.run)
    from eigenode_cli.reporting.figures import draw_run  # noqa: PLC0415

    return _tell(*draw_run(folder))


def report(args: argparse.Namespace) -> int:
    """Write a run's page again, or a sweep's."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        from eigenode_cli.batch.page import write_page  # noqa: PLC0415

        return _tell([write_page(read_plan(sweep))], [])
    folder = run_folder(args.run)
    from eigenode_cli.reporting.report import write_report  # noqa: PLC0415

    written = write_report(folder)
    return _tell([written.path], written.faults)


def _tell(paths: list[Path], faults: list[str]) -> int:
    """Print what was drawn and what kept the rest from being drawn; returns the exit status.

    Raises:
        UserError: nothing was drawn.
    """
    if not paths:
        raise UserError(faults)
    for path in paths:
        print(path)
    for fault in faults:
        print(f"eigenode: {fault}", file=sys.stderr)
    return 0


def _sweep_folder(text: str) -> Path | None:
    """Return the folder of a sweep, given as a path or as a name under outputs/; None where it is none."""
    return next(
        (folder for folder in (Path(text), OUTPUTS / text) if is_folder(folder) and (folder / PLAN).is_file()), None
    )


def _resume_sweep(folder: Path, config_dir: str | None) -> int:
    """Give the sweep's command again, with its folder."""
    from eigenode_cli.commands.train import train  # noqa: PLC0415  # Hydra, only where it is needed

    words = [word for word in read_plan(folder).words if config_dir is None or not word.startswith("--config-dir=")]
    flags = [] if config_dir is None else [f"--config-dir={config_dir}"]
    return train([*words, *flags, quoted("hydra.sweep.dir", folder.as_posix())])
