"""`eigenode list` and `eigenode validate`: the shipped configs, and the user's own."""

import argparse
from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

from eigenode_cli.config.catalogue import choices, groups, validate
from eigenode_cli.config.composer import Composer
from eigenode_cli.errors import UserError
from eigenode_cli.reproduce.library import check_all


def list_choices(args: argparse.Namespace) -> int:
    """Print all groups, or the choices of one, with a line each."""
    composer = Composer(args.config_dir)
    lines = groups(composer) if args.group is None else choices(composer, args.group)
    print_lines(lines)
    return 0


def validate_configs(args: argparse.Namespace) -> int:
    """Compose and check everything that is shipped."""
    result = validate(Composer(args.config_dir))
    experiments = check_all(Composer(args.config_dir))
    if result.faults or experiments.faults:
        raise UserError([*result.faults, *experiments.faults])
    print(f"{result.compositions} configurations from {len(result.files)} files are valid")
    print(f"{experiments.compositions} runs of {experiments.experiments} experiments are valid")
    return 0


def print_lines(lines: Mapping[str, str]) -> None:
    """Two columns: a table on a terminal, plain unwrapped lines in a pipe."""
    console = Console()
    if console.is_terminal:
        table = Table.grid(padding=(0, 2))
        for name, text in lines.items():
            table.add_row(f"[bold]{name}[/bold]", text)
        console.print(table)
        return
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name:<{width}}  {text}")
