"""`eigenode reproduce [NAME ...]`: published figures and claims, from training to verdict."""

import argparse
import json
import shlex
import sys
from pathlib import Path
from typing import Any

from eigenode_cli.cpus import usable_cores
from eigenode_cli.errors import UserError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("names", metavar="NAME", nargs="*", help="experiments; all of the protocol where none is named")
    parser.add_argument("--list", action="store_true", help="list all experiments and start nothing")
    parser.add_argument("--protocol", metavar="P", help="training choices of all runs (paper where no name is given)")
    parser.add_argument("--repetitions", metavar="N", type=_positive, default=1, help="seeds 0 to N-1 of every run")
    parser.add_argument("--jobs", metavar="J", type=_positive, help="processes, one a core where left out")
    parser.add_argument("--output", metavar="DIR", type=Path, help="folder of verdicts, figures and page")
    parser.add_argument("--no-figures", action="store_true", help="leave figures and page out")
    parser.add_argument(
        "--check", metavar="FILE", type=Path, help="a verdicts.json to agree with; exit status 1 if not"
    )


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number from 1")
    return int(text)


def reproduce(args: argparse.Namespace) -> int:
    """Train, measure, judge, draw."""
    if args.list:
        return _list()
    committed = _committed(args.check)
    from eigenode_cli.reproduce import study as way  # noqa: PLC0415  # joblib and Hydra, only where they are needed

    study = way.prepare(args.names, args.protocol, args.repetitions)
    folder = args.output or way.default_output(study)
    with way.alone(folder):
        verdicts = _carry_out(study, args, folder)
    return 0 if committed is None else _compare(verdicts, committed, args.check)


def _carry_out(study: Any, args: argparse.Namespace, folder: Path) -> list[Any]:
    """Train and measure what is left, write everything into `folder`, print it; returns the verdicts."""
    from eigenode_cli.reproduce import study as way  # noqa: PLC0415
    from eigenode_cli.reproduce.journal import write_tables  # noqa: PLC0415
    from eigenode_cli.reproduce.runs import print_runs, run_tables, write_runs  # noqa: PLC0415
    from eigenode_cli.reproduce.tables import Summary, print_verdicts, write_verdicts  # noqa: PLC0415

    jobs = args.jobs or usable_cores()
    way.train(study, jobs)
    way.examine(study, jobs)
    verdicts = study.verdicts()
    titles = {name: experiment.title for name, experiment in study.experiments.items()}
    summary = Summary(study.protocol, study.repetitions, titles, _command(args, study.protocol))
    runs = run_tables(study)
    write_verdicts(folder, verdicts, summary, runs)
    write_runs(folder, runs)
    write_tables(study, folder)
    if not args.no_figures:
        _draw(study, verdicts, summary, folder)
    print_runs(runs)
    print_verdicts(verdicts, summary)
    print(f"verdicts {folder / 'verdicts.md'}")
    return verdicts


def _compare(verdicts: list[Any], committed: list[dict[str, Any]], file: Path) -> int:
    """Say where the verdicts differ from committed ones; returns the exit status."""
    from eigenode_cli.reproduce.verdicts import differences  # noqa: PLC0415

    lines = differences(verdicts, committed)
    for line in lines:
        print(f"eigenode: differs: {line}", file=sys.stderr)
    if not lines:
        print(f"the verdicts agree with {file}")
    return 1 if lines else 0


def _draw(study: Any, verdicts: Any, summary: Any, folder: Path) -> None:
    from eigenode_cli.reproduce.figures import draw_all  # noqa: PLC0415  # matplotlib
    from eigenode_cli.reproduce.page import write_page  # noqa: PLC0415

    draw_all(study, folder / "figures")
    print(f"page     {write_page(study, verdicts, summary, folder)}")


def _command(args: argparse.Namespace, protocol: str) -> str:
    """Return the command that makes the same table, wherever it is written."""
    words = ["eigenode", "reproduce", *args.names, "--protocol", protocol, "--repetitions", str(args.repetitions)]
    return shlex.join(words)


def _committed(path: Path | None) -> list[dict[str, Any]] | None:
    """Return the claims of a committed verdicts.json."""
    if path is None:
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))["claims"]
    except FileNotFoundError:
        raise UserError(f"--check {path}: no such file") from None
    except (json.JSONDecodeError, KeyError, TypeError, OSError) as error:
        raise UserError(f"--check {path}: not a verdicts.json ({type(error).__name__}: {error})") from error


def _list() -> int:
    from eigenode_cli.console import counted, show_table  # noqa: PLC0415
    from eigenode_cli.reproduce.library import load, names  # noqa: PLC0415

    lines = {}
    for name in names():
        experiment = load(name)
        size = f"{counted(len(experiment.runs), 'run')}, {counted(len(experiment.claims), 'claim')}"
        lines[name] = f"{experiment.title}: {size} ({', '.join(experiment.protocols)})"
    show_table((), [*lines.items()])
    return 0
