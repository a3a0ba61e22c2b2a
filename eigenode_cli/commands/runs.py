"""`eigenode resume | plot | report RUN`: what is done with a run's folder."""

import argparse
import json

from eigenode_cli.errors import UserError
from eigenode_cli.paths import importable, run_folder


def resume(args: argparse.Namespace) -> int:
    """Go on with a run where it stopped."""
    folder = run_folder(args.run, ())
    try:
        previous = json.loads((folder / "run.json").read_text())
    except json.JSONDecodeError as error:
        raise UserError(f"{args.run}: its run.json cannot be read ({error})") from error
    if previous.get("status") == "finished":
        raise UserError(f"{args.run}: the run is finished, there is nothing to resume")
    from eigenode_cli.config.compose import restore  # noqa: PLC0415

    config = restore(previous["config"])
    from eigenode_cli import run  # noqa: PLC0415

    with importable(*([args.config_dir] if args.config_dir else [])):
        return run.resume(config, folder, previous)


def plot(args: argparse.Namespace) -> int:
    """Draw a run's figures again."""
    folder = run_folder(args.run, ("metrics.csv",))
    from eigenode_cli.figures import draw_run  # noqa: PLC0415

    for path in draw_run(folder):
        print(path)
    return 0


def report(args: argparse.Namespace) -> int:
    """Write a run's page again."""
    folder = run_folder(args.run, ("metrics.csv",))
    from eigenode_cli.report import write_report  # noqa: PLC0415

    print(write_report(folder))
    return 0
