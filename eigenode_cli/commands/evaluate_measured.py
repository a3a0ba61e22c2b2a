"""`eigenode evaluate RUN` of a run on measured data: errors on the same tables or on others, modes, simulations."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.commands.output import save_table
from eigenode_cli.console import number, show_table
from eigenode_cli.errors import UserError

if TYPE_CHECKING:
    from eigenode_cli.recorded import RecordedRun

ROLES = (
    "system.file",
    "system.folder",
    "system.test_files",
    "system.window",
    "system.stride",
    "system.trials",
    "solver",
)
"""Settings that may change: what is looked at, not which column is what."""
SIMULATION = ("system.initial_state=", "system.horizon=")
"""Words that ask for a simulation from elsewhere, with which no data can be compared."""


def evaluate_measured(args: argparse.Namespace, run: "RecordedRun") -> int:
    """Print how the model does on its own data or on other tables, and its modes at the equilibrium."""
    from eigenode_cli.config.compose import restore, with_changes  # noqa: PLC0415  # torch, once it is needed
    from eigenode_cli.config.evaluation import predictions  # noqa: PLC0415

    words, simulated = _simulation_words(args.words)
    if simulated:
        _simulate(args, run, simulated, words)
        return 0
    files = ("system.file=", "system.test_files=")
    if any(word.startswith(files) for word in words) and not any(word.startswith("system.folder=") for word in words):
        words.append(f"system.folder='{Path.cwd()}'")
    config = restore(with_changes(run.record["config"], words, ROLES), run.record.get("schemas"))
    table = predictions(run.folder, run.config, config)
    rows = [[str(cell) if isinstance(cell, str) else number(cell) for cell in row] for row in table.to_numpy().tolist()]
    header = [str(name) for name in table.columns]
    show_table(header, rows, f"{run.folder.name}: model beside the measurements", right=header[3:])
    known = run.record.get("baselines") or {}
    if not args.words and known:
        parts = [f"{name} {number(error)}" for name, error in known.items()]
        model = run.record["final"].get("test_error")
        print(f"test error: model {number(model)}, {', '.join(parts)}")
    _show_modes(run.folder)
    if args.output:
        save_table(table, args.output)
    return 0


def _simulation_words(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the words that say what to compare with, and values of those that ask for a simulation instead."""
    simulated = dict(word.split("=", 1) for word in words if word.startswith(SIMULATION))
    return [word for word in words if not word.startswith(SIMULATION)], simulated


def _simulate(args: argparse.Namespace, run: "RecordedRun", asked: Mapping[str, str], rest: Sequence[str]) -> None:
    """Print where the model goes from another initial state, or over another horizon, without inputs after the data.

    Raises:
        UserError: the state has another length, or a value is no number.
    """
    import pandas as pd  # noqa: PLC0415

    if rest:
        raise UserError(f"{rest[0]}: no effect beside {next(iter(asked))}=..., which compares with no data")
    names, start = list(run.states), run.initial_state().tolist()
    if "system.initial_state" in asked:
        start = _numbers("system.initial_state", asked["system.initial_state"])
        if len(start) != len(names):
            shown = asked["system.initial_state"]
            raise UserError(f"system.initial_state={shown}: give one value for each of {', '.join(names)}")
    begin, end = (float(run.solution["t"].iloc[i]) for i in (0, -1))
    horizon = _numbers("system.horizon", asked["system.horizon"])[0] if "system.horizon" in asked else end - begin
    if not horizon > 0.0:
        raise UserError(f"system.horizon={horizon:g}: must be above 0")
    times = np.linspace(begin, begin + horizon, args.points)
    found = run.simulate(times, start)
    rows = [
        [name, *map(number, (found[0, i], found[-1, i], float(np.max(np.abs(found[:, i])))))]
        for i, name in enumerate(names)
    ]
    header = ("state", "first", "last", "largest modulus")
    show_table(header, rows, f"{run.folder.name}: simulated over {horizon:g} s", right=header[1:])
    if not np.isfinite(found).all():
        print("the model could not be solved to the end")
    if args.output:
        columns = {"t": times} | {f"model_{name}": found[:, i] for i, name in enumerate(names)}
        save_table(pd.DataFrame(columns), args.output)


def _numbers(key: str, text: str) -> list[float]:
    """Return the numbers of a value or of a list as typed."""
    try:
        values = [float(part) for part in text.strip().strip("[]").split(",")]
    except ValueError:
        values = [float("nan")]
    if not np.isfinite(values).all():
        raise UserError(f"{key}={text}: must be a number, or a list of numbers such as [0.5,0]")
    return values


def _show_modes(folder: Path) -> None:
    """Print the modes at the equilibrium beside the stated ones."""
    import pandas as pd  # noqa: PLC0415

    path = folder / "equilibrium.csv"
    if not path.is_file():
        raise UserError(f"{path}: is missing; the run was made by an earlier version, or did not finish")
    table: pd.DataFrame = pd.read_csv(path).sort_values(by="frequency")
    upper = table.loc[table["im"] > 0.0]
    if upper.empty:
        print("no oscillating pair at the equilibrium" if len(table) else "no equilibrium was found")
        return
    rows = []
    for values in upper.sort_values(by="frequency")[
        ["frequency", "damping_ratio", "target_re", "target_im"]
    ].to_numpy():
        hertz, ratio, real, imaginary = values.tolist()
        modulus = float(np.hypot(real, imaginary))
        stated = (imaginary / (2.0 * np.pi), -real / modulus) if np.isfinite(modulus) else (np.nan, np.nan)
        rows.append([number(value) for value in (hertz, stated[0], ratio, stated[1])])
    header = ("frequency in Hz", "stated", "damping ratio", "stated ")
    show_table(header, rows, "modes at the equilibrium", right=header)
