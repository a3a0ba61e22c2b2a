"""The command `eigenode`: finds the subcommand, and turns how it ends into an exit code.

0 done; 1 the run failed, stalled or diverged; 2 the user's mistake, one line each; 130 interrupted.
"""

import argparse
import errno
import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

from eigenode_cli import __version__
from eigenode_cli.commands.output import lasting_output
from eigenode_cli.errors import UserError, unknown
from eigenode_cli.interruption import interruptible
from eigenode_cli.runs.atomic import WriteError
from eigenode_cli.runs.paths import importable

USER_ERROR = 2
INTERRUPTED = 130
BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 before NumPy is imported, unless the user has set them: many small matrices, several runs side by side."""

OBJECTS_BETWEEN_COLLECTIONS = 10_000
"""Imports and Hydra make a million objects that stay: to look through them for garbage every 700 took 0.3 s."""

REFUSALS = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO),
    *(errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR),
)
"""Errors of a disk or a path that are not mistakes of this program: the file and the cause in one line."""

PRINTING = ("--cfg", "-c", "--info", "-i", "--help", "-h", "--hydra-help", "--list", "--dry-run")
"""Flags of commands that else write their result into a folder."""

Adder = Callable[[argparse.ArgumentParser], None]


@dataclass(frozen=True)
class Command:
    """One subcommand: its name, a line of help, its arguments, and what it does with them."""

    name: str
    summary: str
    arguments: Adder
    call: Callable[[argparse.Namespace], int]


def _run_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", metavar="RUN", help="folder of a run, or its name under outputs/")


def _config_dir_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config-dir", metavar="DIR", help="a folder of your own configs and code")


def _resume_arguments(parser: argparse.ArgumentParser) -> None:
    _run_argument(parser)
    parser.add_argument("words", metavar="KEY=VALUE", nargs="*", help="for example trainer.steps=10000, to go further")
    _config_dir_argument(parser)


def _list_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("group", metavar="GROUP", nargs="?", help="for example system, solver, terms")
    _config_dir_argument(parser)


def _train_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", metavar="KEY=VALUE", nargs="*", help="settings; see 'eigenode train --help'")


def _train(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.train import train  # noqa: PLC0415  # Hydra, only where it is needed

    return train(args.words)


def _resume(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.runs import resume  # noqa: PLC0415

    return resume(args)


def _plot(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.runs import plot  # noqa: PLC0415

    return plot(args)


def _report(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.runs import report  # noqa: PLC0415

    return report(args)


def _evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    _run_argument(parser)
    parser.add_argument("words", metavar="KEY=VALUE", nargs="*", help="for example 'system.initial_state=[0.5,0]'")
    parser.add_argument("--points", metavar="N", type=int, default=1001, help="equidistant times (1001)")
    parser.add_argument("--output", metavar="FILE", help="write times, truth and model into a CSV file")
    parser.add_argument("--map", metavar="FILE", help="draw where trajectories go from a grid of initial states")
    parser.add_argument("--grid", metavar="N", type=int, default=15, help="grid points of each state of the map (15)")


def _evaluate(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.evaluate import evaluate  # noqa: PLC0415

    return evaluate(args)


def _data_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a table, or a pattern such as 'run*.csv'")
    parser.add_argument("words", metavar="KEY=VALUE", nargs="*", help="for example time=t 'positions=[x]' offset=free")
    parser.add_argument("--output", metavar="FILE", help="picture, by default the name of the table with .png")


def _data(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.data import show_data  # noqa: PLC0415

    return show_data(args)


def _export_arguments(parser: argparse.ArgumentParser) -> None:
    _run_argument(parser)
    parser.add_argument("--to", metavar="FORMAT", help="onnx, torch, c or fmu")
    parser.add_argument("--output", metavar="FILE", help="by default RUN/export/<system> with the ending of the format")
    parser.add_argument("--step", metavar="N", type=int, help="weights of this training step, by default the result")
    parser.add_argument("--precision", metavar="TYPE", default="float64", help="float64, or float32 for onnx (float64)")


def _export(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.export import export  # noqa: PLC0415

    return export(args)


def _reproduce_arguments(parser: argparse.ArgumentParser) -> None:
    from eigenode_cli.commands.reproduce import add_arguments  # noqa: PLC0415

    add_arguments(parser)


def _reproduce(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.reproduce import reproduce  # noqa: PLC0415

    return reproduce(args)


def _list(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.configs import list_choices  # noqa: PLC0415

    return list_choices(args)


def _bench_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", help="one case, all by default: oscillator-sol, growth, ...")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--output", metavar="FOLDER", help="write bench.json and figures there")


def _bench(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.bench import bench  # noqa: PLC0415

    return bench(args)


def _validate(args: argparse.Namespace) -> int:
    from eigenode_cli.commands.configs import validate_configs  # noqa: PLC0415

    return validate_configs(args)


COMMANDS: tuple[Command, ...] = (
    Command("train", "one training run, or a sweep of them with -m", _train_arguments, _train),
    Command("reproduce", "the paper: its runs, figures and claims, checked", _reproduce_arguments, _reproduce),
    Command("evaluate", "a trained model from another initial state or horizon", _evaluate_arguments, _evaluate),
    Command("export", "the learned vector field as ONNX, torch, C or an FMU", _export_arguments, _export),
    Command("data", "what would be read from a table, with a picture and suggested targets", _data_arguments, _data),
    Command("resume", "go on with a run where it stopped, or further", _resume_arguments, _resume),
    Command("plot", "draw a run's figures again, from its files", _run_argument, _plot),
    Command("report", "write a run's page again, from its files", _run_argument, _report),
    Command("bench", "timings against peers, as ratios", _bench_arguments, _bench),
    Command("list", "what can be chosen, with one line each", _list_arguments, _list),
    Command("validate", "compose and check every shipped config", _config_dir_argument, _validate),
)
"""All subcommands, in the order of the help."""

EPILOG = """examples:
  eigenode train system=vdp grads=sol+frq+dmp+osc
  eigenode train -m system=oscillator,vdp grads=sol,sol+frq 'seed=range(3)'
  eigenode list system

settings of a training: eigenode train --help
completion in bash:     eval "$(eigenode -sc install=bash)"
"""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as every other part of the program does."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{self.prog.removeprefix('eigenode').strip()}: {message}".removeprefix(": "))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name), that of the process by default."""
    words = list(sys.argv[1:] if argv is None else argv)
    for variable in BLAS_THREADS:
        os.environ.setdefault(variable, "1")
    with lasting_output() as lost:
        status = _answered(words)
        return status or (USER_ERROR if lost() and _prints_its_result(words) else 0)


def _answered(words: list[str]) -> int:
    """Return the exit code of a command, whatever happens in it."""
    try:
        with interruptible(), _rare_collections(), importable("."):
            return _dispatch(words)
    except UserError as error:
        for fault in error.faults:
            print(f"eigenode: error: {fault}", file=sys.stderr)
        return USER_ERROR
    except KeyboardInterrupt:
        print("eigenode: interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        if not (isinstance(error, WriteError) or error.errno in REFUSALS):
            raise
        shown = str(error) if isinstance(error, WriteError) else f"{error.filename or 'a file'}: {error.strerror}"
        print(f"eigenode: error: {shown}", file=sys.stderr)
        return USER_ERROR


def _prints_its_result(words: list[str]) -> bool:
    """Whether what a command prints is all there is of its result: no folder has it."""
    return words[:1] not in (["train"], ["resume"], ["reproduce"]) or any(word in PRINTING for word in words)


def _dispatch(words: list[str]) -> int:
    if words[:1] in (["-sc"], ["--shell-completion"]):
        return _complete(words[1:])
    if words[:1] == ["train"]:  # Hydra owns everything after it
        return _train(argparse.Namespace(words=words[1:]))
    names = [command.name for command in COMMANDS]
    if words and not words[0].startswith("-") and words[0] not in names:
        raise UserError(_unknown_command(words[0], names))
    parser = _parser()
    args = parser.parse_args(words)
    if args.call is None:
        parser.print_help()
        return 0
    return args.call(args)


def _unknown_command(word: str, names: Sequence[str]) -> str:
    if "=" in word:
        return f"{word}: a setting without a command; write eigenode train {word}"
    return unknown("command", word, names)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="eigenode",
        description="Train NeuralODEs with knowledge about the eigenvalues of the learned system.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"eigenode {__version__}")
    parser.set_defaults(call=None)
    subparsers = parser.add_subparsers(metavar="COMMAND", title="commands")
    for command in COMMANDS:
        sub = subparsers.add_parser(command.name, help=command.summary, description=command.summary)
        command.arguments(sub)
        sub.set_defaults(call=command.call)
    return parser


def _complete(words: list[str]) -> int:
    """Tab completion: the subcommands here, the settings of `train` by Hydra."""
    line = os.environ.get("COMP_LINE", "")
    typed = line.split()
    if any(word.startswith("query=") for word in words):
        if len(typed) < 2 or (len(typed) == 2 and not line.endswith(" ")):
            print(" ".join(command.name for command in COMMANDS))
            return 0
        if typed[1] != "train":
            return 0
        os.environ["COMP_LINE"] = line.replace(" train", "", 1)
    return _train(argparse.Namespace(words=["-sc", *words]))


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Look for garbage less often than Python does by default."""
    before = gc.get_threshold()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
