"""`eigenode list` and `eigenode validate`: the shipped configs, and the user's own."""

import argparse

from eigenode_cli.config.catalogue import choices, groups, validate
from eigenode_cli.config.composer import Composer
from eigenode_cli.console import show_table
from eigenode_cli.errors import UserError
from eigenode_cli.reproduce.library import check_all


def list_choices(args: argparse.Namespace) -> int:
    """Print all groups, or the choices of one, with a line each."""
    composer = Composer(args.config_dir)
    lines = groups(composer) if args.group is None else choices(composer, args.group)
    show_table((), [*lines.items()])
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
