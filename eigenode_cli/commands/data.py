"""`eigenode data FILE [KEY=VALUE ...]`: what would be read from a table, with a picture and suggested targets."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.console import number, show_table
from eigenode_cli.errors import UserError

if TYPE_CHECKING:
    from eigenode_cli.config.table_schema import TableConfig
    from eigenode_cli.data.measured import Measured
    from eigenode_cli.data.survey import Survey

SHORT = "system."
"""Stands before the options in `eigenode train`; here it may be left out."""


def show_data(args: argparse.Namespace) -> int:
    """Print what is read, and draw it."""
    config = _settings(args.file, args.words)
    if not (config.positions or config.velocities or config.accelerations or config.states):
        _show_columns(config)
        return 0
    from eigenode_cli.config.table import measured_of, role_faults, roles_of  # noqa: PLC0415  # SciPy and pandas
    from eigenode_cli.data.survey import survey  # noqa: PLC0415

    if faults := list(role_faults(config, "full" if config.states else "second_order")):
        raise UserError(faults)
    measured, roles = measured_of(config), roles_of(config)
    for note in measured.notes:
        print(note)
    modes = max(1, roles.freedom // 2) if config.states else roles.freedom
    found = [survey(measured, one, modes) for one in measured.trajectories]
    for one in found:
        _show_survey(one, measured)
    _suggest(found[0])
    path = Path(args.output or f"{Path(str(config.file)).stem}.png")
    from eigenode_cli.reporting.figures.survey import draw_survey  # noqa: PLC0415  # matplotlib

    draw_survey(found, path)
    print(path)
    return 0


def _settings(file: str, words: Sequence[str]) -> "TableConfig":
    """Return the settings of the table with the changes of the command line.

    Raises:
        UserError: with all faults.
    """
    from eigenode_cli.config.table_settings import table_settings  # noqa: PLC0415  # Hydra

    full = [word if word.startswith(SHORT) else f"{SHORT}{word}" for word in words]
    wrong = [word for word in words if "=" not in word]
    if wrong:
        raise UserError([f"{word}: not of the form KEY=VALUE" for word in wrong])
    return table_settings(file, full)


def _show_columns(config: "TableConfig") -> None:
    """Print the columns of a file whose roles are yet to be named."""
    from eigenode_cli.config.table import files_of, format_of  # noqa: PLC0415  # pandas
    from eigenode_cli.tables import Selection, read_table  # noqa: PLC0415

    for path in files_of(config):
        table = read_table(path, format_of(config), Selection(time=config.time))
        print(table.summary)
        rows: list[list[str]] = []
        for place, column in enumerate(table.numbers):
            values = table.values[:, place]
            known = values[np.isfinite(values)]
            sizes = [known.min(), known.max(), known.mean()] if known.size else [np.nan] * 3
            ends = [values[0], values[-1]]
            texts = [number(float(value)) for value in (*ends, *sizes)]
            rows.append(
                [str(column), table.names[column], table.units[column], *texts, str(int(np.isnan(values).sum()))]
            )
        header = ("column", "name", "unit", "first", "last", "lowest", "highest", "mean", "holes")
        show_table(header, rows, "", right=header[3:])
    print("name the roles: time=COLUMN positions=[COLUMN] (velocities, accelerations, or states), inputs=[COLUMN]")


def _show_survey(found: "Survey", measured: "Measured") -> None:
    """Print one trajectory."""
    low, middle, high = found.spacing
    span = f"{number(float(found.times[0]))} to {number(float(found.times[-1]))} s"
    print(f"{found.label}: {found.times.size} rows from {span}, spacing {number(middle)} s", end="")
    print(f" ({number(low)} to {number(high)}), {found.gaps} gaps")
    rows = []
    for one in found.channels:
        sizes = [float(one.signal.min()), float(one.signal.max()), float(one.signal.mean())]
        shown = ", ".join(number(float(hertz)) for hertz in one.peaks) or "none"
        rows.append([one.name, one.unit, *map(number, sizes), str(one.holes), str(one.repeated), shown])
    for state, column in zip(measured.inputs, _inputs(measured, found.label), strict=True):
        rows.append([state.name, state.unit, *map(number, column), "0", "", "input"])
    header = ("channel", "unit", "lowest", "highest", "mean", "holes", "repeated", "peaks in Hz")
    show_table(header, rows, "", right=header[2:7])


def _inputs(measured: "Measured", label: str) -> list[list[float]]:
    drive = next(one.series.drive for one in measured.trajectories if one.label == label)
    if drive is None:
        return []
    return [[float(part(column)) for part in (np.min, np.max, np.mean)] for column in drive.values.T]


def _suggest(found: "Survey") -> None:
    """Print targets that the record suggests, with their spread."""
    if not found.modes:
        print("no oscillation stands out: no target is suggested")
        return
    single = found.decay
    if single is not None:
        low, high = single.frequency_range
        print(f"frequency {number(low)} to {number(high)} Hz along the record, {number(single.frequency)} at its end")
        low, high = single.damping_range
        print(f"damping ratio {number(single.damping)}, {number(low)} to {number(high)} along the record (decrement)")
    hertz = ",".join(f"{frequency:.4g}" for frequency, _ in found.modes)
    ratios = ",".join(f"{ratio:.2g}" for _, ratio in found.modes)
    print(f"suggestion: 'target.frequency=[{hertz}]' 'target.damping=[{ratios}]'")
