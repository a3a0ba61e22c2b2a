"""`eigenode evaluate RUN [KEY=VALUE ...]`: a trained model from another initial state or over another horizon."""

import argparse
from dataclasses import replace

from eigenode_cli.commands.evaluate_map import draw_map
from eigenode_cli.commands.evaluate_measured import evaluate_measured
from eigenode_cli.commands.output import save_table
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.console import number, show_table
from eigenode_cli.errors import UserError

MEASURED = ("name", "target", "points", "observed", "noise", "initial_known")
"""Settings of a system that say what was measured of it, which is done."""


def evaluate(args: argparse.Namespace) -> int:
    """Print the errors of the model against the truth, state by state."""
    from eigenode_cli.config.compose import restore, with_changes  # noqa: PLC0415  # torch, once it is needed
    from eigenode_cli.recorded import load_run  # noqa: PLC0415
    from eigenode_cli.solve.settings import TIGHT  # noqa: PLC0415

    for option, value in (("--points", args.points), ("--grid", args.grid)):
        if value < 2:
            raise UserError(f"{option} {value}: must be at least 2")
    run = load_run(args.run)
    if args.map:
        draw_map(run, args.map, args.grid)
    if isinstance(run.config.system, TableConfig):
        return evaluate_measured(args, run)
    own = [f"system.{name}" for name in run.record["config"]["system"] if name not in MEASURED]
    config = restore(with_changes(run.record["config"], args.words, own), run.record.get("schemas"))
    if isinstance(config.system, TableConfig):
        raise TypeError("a run on measured data")
    start = list(config.system.initial_state)
    given = any(word.startswith("system.initial_state=") for word in args.words)
    try:
        found = replace(run, config=config).evaluate(start if given else None, points=args.points)
    except ValueError as error:
        raise UserError(str(error)) from error
    rows = [
        [str(state), *map(number, row)] for state, row in zip(found.errors.index, found.errors.to_numpy(), strict=True)
    ]
    header = ("state", *(f"{name} error" for name in found.errors.columns))
    show_table(header, rows, f"{config.system.name} over {config.system.horizon:g} s from {start}", right=header[1:])
    print(f"model solved by {TIGHT.name} at rtol={TIGHT.rtol:g}, the truth by DOP853 at 1e-10")
    if args.output:
        save_table(found.table, args.output)
    return 0
