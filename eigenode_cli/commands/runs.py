"""`eigenode resume | plot | report RUN`: what is done with the folder of a run, or of a sweep."""

import argparse
import json
from pathlib import Path
from typing import Any

from eigenode_cli.ending import FINAL, FINISHED
from eigenode_cli.errors import UserError
from eigenode_cli.paths import OUTPUTS, importable, run_folder
from eigenode_cli.sweep.plan import PLAN, quoted, read_plan


def resume(args: argparse.Namespace) -> int:
    """Go on with a run, or with a sweep, where it stopped."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        return _resume_sweep(sweep, args.config_dir)
    folder = run_folder(args.run, ())
    try:
        previous = json.loads((folder / "run.json").read_text())
    except json.JSONDecodeError as error:
        raise UserError(f"{args.run}: its run.json cannot be read ({error})") from error
    if previous.get("status") in FINAL:
        raise UserError(f"{args.run}: {_finality(previous)}")
    from eigenode_cli.config.compose import restore  # noqa: PLC0415

    config = restore(previous["config"])
    from eigenode_cli import run  # noqa: PLC0415

    with importable(*([args.config_dir] if args.config_dir else [])):
        return run.resume(config, folder, previous)


def _finality(record: dict[str, Any]) -> str:
    """Why there is nothing to resume."""
    if record["status"] == FINISHED:
        return "the run is finished, there is nothing to resume"
    return f"the run {record['status']}, to resume it would lead to the same ({record['error']}); start a new one"


def plot(args: argparse.Namespace) -> int:
    """Draw a run's figures again, or a sweep's."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        from eigenode_cli.sweep.figure import draw_summary  # noqa: PLC0415
        from eigenode_cli.sweep.summary import group, read_rows  # noqa: PLC0415

        paths = draw_summary(sweep, group(read_rows(read_plan(sweep))))
    else:
        folder = run_folder(args.run, ("metrics.csv",))
        from eigenode_cli.figures import draw_run  # noqa: PLC0415

        paths = draw_run(folder)
    for path in paths:
        print(path)
    return 0


def report(args: argparse.Namespace) -> int:
    """Write a run's page again, or a sweep's."""
    sweep = _sweep_folder(args.run)
    if sweep is not None:
        from eigenode_cli.sweep.page import write_page  # noqa: PLC0415

        print(write_page(read_plan(sweep)))
        return 0
    folder = run_folder(args.run, ("metrics.csv",))
    from eigenode_cli.report import write_report  # noqa: PLC0415

    print(write_report(folder))
    return 0


def _sweep_folder(text: str) -> Path | None:
    """The folder of a sweep, given as a path or as a name under outputs/; None where it is none."""
    return next((folder for folder in (Path(text), OUTPUTS / text) if (folder / PLAN).is_file()), None)


def _resume_sweep(folder: Path, config_dir: str | None) -> int:
    """Give the sweep's command again, with its folder."""
    from eigenode_cli.commands.train import train  # noqa: PLC0415  # Hydra, only where it is needed

    words = [word for word in read_plan(folder).words if config_dir is None or not word.startswith("--config-dir=")]
    flags = [] if config_dir is None else [f"--config-dir={config_dir}"]
    return train([*words, *flags, quoted("hydra.sweep.dir", folder.as_posix())])
