"""Measured trajectories from tables: which column is what, which rows train, which are held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.data.dataset import Series
from eigenode_cli.errors import UserError
from eigenode_cli.solve.drive import Drive
from eigenode_cli.systems.base import State
from eigenode_cli.tables import UNITS_OF_TIME, Column, Format, Selection, Table, read_table

FREE = "free"
FEWEST = 4
"""Rows that a trajectory needs at least."""


@dataclass(frozen=True)
class Roles:
    """Which column is what.

    Attributes:
        time: column of the times, None where there is none and `rate` (in Hz) gives them; time_unit: None for that
            which the name states, seconds where it states none.
        positions, velocities, accelerations: one entry a degree of freedom, None where not measured; structure
            `second_order`.
        states: of the structure `full`, in place of the three.
        inputs: of known inputs; hold: between their samples, `linear` | `zero`.
        hidden: further degrees of freedom, or states, that were not measured.
        trial: column whose value says which trajectory a row belongs to; trials: those that are taken, None for all.
        window: times in the unit of the file between which rows are taken; stride: every so many of them.
        offset: whether every measured channel shows a trained constant too.
        duplicates: what becomes of rows with the same time: error | first | last | mean.
    """

    time: Column | None = None
    time_unit: str | None = None
    rate: float | None = None
    positions: tuple[Column | None, ...] = ()
    velocities: tuple[Column | None, ...] = ()
    accelerations: tuple[Column | None, ...] = ()
    states: tuple[Column, ...] = ()
    inputs: tuple[Column, ...] = ()
    hold: str = "linear"
    hidden: int = 0
    trial: Column | None = None
    trials: tuple[float, ...] | None = None
    window: tuple[float, float] | None = None
    stride: int = 1
    offset: bool = False
    duplicates: str = "error"

    @property
    def structure(self) -> str:
        """Structure of the vector field that these channels belong to."""
        return "full" if self.states else "second_order"

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom, or of states with the structure `full`."""
        measured = (self.states,) if self.states else (self.positions, self.velocities, self.accelerations)
        return max(len(columns) for columns in measured) + self.hidden

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states `(n,)`."""
        if self.states:
            names = [_name(column, f"x{i + 1}") for i, column in enumerate(self.states)]
            return (*names, *(f"hidden{i + 1}" for i in range(self.hidden)))
        names = []
        for i in range(self.freedom - self.hidden):
            column = self.positions[i] if i < len(self.positions) else None
            names.append(_name(column, f"x{i + 1}"))
        names += [f"hidden{i + 1}" for i in range(self.hidden)]
        return (*names, *(f"{name}_dot" for name in names))

    @property
    def channels(self) -> dict[int, tuple[str, Column]]:
        """Option and column of each measured channel by its number: state i has i, its derivative n + i."""
        half, n = self.freedom, len(self.state_names)
        groups = (
            ("system.states", self.states, 0),
            ("system.positions", self.positions, 0),
            ("system.velocities", self.velocities, half),
            ("system.accelerations", self.accelerations, n + half),
        )
        return {
            first + i: (option, column)
            for option, columns, first in groups
            for i, column in enumerate(columns)
            if column is not None
        }

    @property
    def columns(self) -> tuple[Column, ...]:
        """Every column that is read, each once."""
        others = (self.time, self.trial)
        wanted = [
            *(column for column in others if column is not None),
            *(column for _, column in self.channels.values()),
        ]
        return tuple(dict.fromkeys([*wanted, *self.inputs]))

    @property
    def selection(self) -> Selection:
        """What is read: with several trials the stride counts the rows of each, afterwards."""
        return Selection(self.columns, self.time, self.window, 1 if self.trial is not None else self.stride)


@dataclass(frozen=True)
class Trajectory:
    """One measured trajectory in the user's units, times in s.

    Attributes:
        label: file and trial.
        series: all of its rows.
        rows: line of each in its file `(N,)`.
        trained: how many of the leading rows training sees; 0 for a trajectory that is held out as a whole.
    """

    label: str
    series: Series
    rows: Integers
    trained: int

    @property
    def seen(self) -> Series:
        """The rows that training sees, with the inputs over all rows: they are known."""
        return self.series.leading(self.trained)


@dataclass(frozen=True)
class Measured:
    """What was read.

    Attributes:
        trajectories: those that train first, then those that are held out as a whole.
        states, inputs: name, unit and symbol of each.
        unit: of the time in the file, s | ms | us | min | h | day | year.
        notes: one line for each file on how it was read.
    """

    trajectories: tuple[Trajectory, ...]
    states: tuple[State, ...]
    inputs: tuple[State, ...]
    unit: str
    notes: tuple[str, ...]

    @property
    def training(self) -> tuple[Trajectory, ...]:
        """Trajectories of which training sees at least a part."""
        return tuple(one for one in self.trajectories if one.trained > 0)


def read_measured(
    files: Sequence[Path],
    roles: Roles,
    form: Format,
    test: float = 0.0,
    test_files: Sequence[Path] = (),
) -> Measured:
    """Read trajectories from tables.

    Args:
        files: one or several tables.
        roles: which column is what.
        form: what settles a doubt about the format.
        test: share of each trajectory's rows, at its end, that is held out.
        test_files: tables that are held out as a whole.

    Raises:
        UserError: with a line for every fault that was found, each naming file, row, column and option.
    """
    found, faults, notes, tables = [], [], [], []
    for path in (*files, *test_files):
        share = 1.0 if path in test_files else test
        try:
            table = read_table(path, form, roles.selection)
            tables.append(table)
            notes.append(f"{table.summary}, {_told_unit(table, roles)}")
            found += [_held_out(one, share) for one in _trajectories(table, roles)]
        except UserError as error:
            faults += error.faults
    if faults:
        raise UserError(faults)
    first = tables[0]
    states, inputs = _described(first, roles)
    held_out = sorted(found, key=lambda one: one.trained == 0)
    return Measured(tuple(held_out), states, inputs, _unit(first, roles), tuple(notes))


def _held_out(trajectory: Trajectory, share: float) -> Trajectory:
    """Return the trajectory with a share of its rows, at the end, held out."""
    count = trajectory.series.times.size
    trained = count - round(share * count)
    if 0 < trained < FEWEST:
        raise UserError(f"system.test={share:g}: leaves {trained} of {count} rows of {trajectory.label} to train on")
    return replace(trajectory, trained=trained)


def _trajectories(table: Table, roles: Roles) -> list[Trajectory]:
    """Return the trajectories in one table, all of their rows counted as seen."""
    name = table.path.name
    if roles.trial is None:
        return [_trajectory(table, roles, np.arange(len(table.rows)), name)]
    trials = table.values[:, table.column(roles.trial, "system.trial")]
    present = list(dict.fromkeys(trials[np.isfinite(trials)].tolist()))
    wanted = present if roles.trials is None else list(roles.trials)
    absent = [trial for trial in wanted if trial not in present]
    if absent:
        shown = ", ".join(f"{trial:g}" for trial in present[:12])
        raise UserError(f"system.trials={[f'{t:g}' for t in absent]}: {name} has the trials {shown}")
    return [_trajectory(table, roles, np.flatnonzero(trials == trial), f"{name} trial {trial:g}") for trial in wanted]


def _trajectory(table: Table, roles: Roles, rows: Integers, label: str) -> Trajectory:
    """Return one trajectory: its times, checked, its channels and its inputs."""
    times, rows = _times(table, roles, rows)
    if rows.size < FEWEST:
        raise UserError(f"{label}: {rows.size} rows are left, at least {FEWEST} are needed; see system.window")
    n = len(roles.state_names)
    channels = np.full((rows.size, 2 * n), np.nan)
    for number, (option, column) in roles.channels.items():
        channels[:, number] = table.values[rows, table.column(column, option)]
        if not np.isfinite(channels[:, number]).any():
            raise UserError(f"{option}={column}: {label} has no number in this column")
    derivatives = any(number >= n for number in roles.channels)
    drive = _drive(table, roles, rows, times, label)
    first = _first_of_equal(times, rows, table, roles)
    channels, times = _merged(channels, first, roles.duplicates), times[first]
    series = Series(
        times,
        channels[:, :n],
        np.full(n, np.nan),
        channels[:, n:] if derivatives else None,
        np.array(sorted(roles.channels) if roles.offset else [], dtype=np.int64),
        drive,
    )
    return Trajectory(label, series, table.rows[rows[first]], times.size)


def _times(table: Table, roles: Roles, rows: Integers) -> tuple[Floats, Integers]:
    """Return times in s and the rows that are left of `rows`: those in the window, every so many."""
    factor = UNITS_OF_TIME[_unit(table, roles)]
    if roles.time is None:
        times = np.arange(rows.size) * roles.stride / float(roles.rate or 1.0)
        factor = 1.0
    else:
        times = table.values[rows, table.column(roles.time, "system.time")]
        holes = np.flatnonzero(~np.isfinite(times))
        if holes.size:
            raise UserError(f"system.time={roles.time}: {table.path.name}, row {table.rows[rows[holes[0]]]}: no time")
    if roles.trial is not None:
        times, rows = times[:: roles.stride], rows[:: roles.stride]
    back = np.flatnonzero(np.diff(times) < 0.0)
    if back.size:
        at = back[0] + 1
        raise UserError(
            f"system.time={roles.time}: {table.path.name}, row {table.rows[rows[at]]}: the time {times[at]:g} follows"
            f" {times[at - 1]:g}; where several trials follow each other name their column with system.trial, or take"
            " one with system.window"
        )
    return times * factor, rows


def _first_of_equal(times: Floats, rows: Integers, table: Table, roles: Roles) -> Integers:
    """Return the index of the first row of each time; refuse several where no rule is stated for them."""
    same = np.flatnonzero(np.diff(times) == 0.0)
    if same.size and roles.duplicates == "error":
        raise UserError(
            f"system.time={roles.time}: {table.path.name}, row {table.rows[rows[same[0] + 1]]}: the time is that of the"
            f" row before ({same.size} such rows); write system.duplicates=first, last or mean"
        )
    return np.flatnonzero(np.concatenate([[True], np.diff(times) > 0.0]))


def _merged(channels: Floats, first: Integers, rule: str) -> Floats:
    """Return one row for each time `(N, C)`, by the stated rule; a mean is one of the samples that there are."""
    if first.size == len(channels) or rule == "first":
        return channels[first]
    if rule == "last":
        return channels[np.concatenate([first[1:], [len(channels)]]) - 1]
    sums = np.add.reduceat(np.nan_to_num(channels), first, axis=0)
    counts = np.add.reduceat(np.isfinite(channels).astype(np.float64), first, axis=0)
    return np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan)


def _drive(table: Table, roles: Roles, rows: Integers, times: Floats, label: str) -> Drive | None:
    """Return the inputs, which must be known in every row."""
    if not roles.inputs:
        return None
    values = np.empty((rows.size, len(roles.inputs)))
    for i, column in enumerate(roles.inputs):
        values[:, i] = table.values[rows, table.column(column, "system.inputs")]
        holes = np.flatnonzero(~np.isfinite(values[:, i]))
        if holes.size:
            at = table.rows[rows[holes[0]]]
            raise UserError(
                f"system.inputs={column}: {label}, row {at}: no number; an input must be known in every row"
            )
    return Drive(times, values, roles.hold)


def _unit(table: Table, roles: Roles) -> str:
    """Return the unit of the time: stated, or of the column's name, else s."""
    if roles.time_unit is not None or roles.time is None:
        return roles.time_unit or "s"
    return table.unit_of_time(roles.time) or "s"


def _told_unit(table: Table, roles: Roles) -> str:
    if roles.time is None:
        return f"no time column, {roles.rate:g} Hz"
    stated = roles.time_unit is not None or table.unit_of_time(roles.time) is not None
    return f"time in {_unit(table, roles)}" + ("" if stated else " (not stated)")


def _described(table: Table, roles: Roles) -> tuple[tuple[State, ...], tuple[State, ...]]:
    """Return name, unit and symbol of every state and of every input."""
    n, units = len(roles.state_names), [""] * len(roles.state_names)
    for number, (option, column) in roles.channels.items():
        if number < n:
            units[number] = table.unit(column, option)
    if roles.structure == "second_order":
        for i in range(n // 2):
            if units[i] and not units[n // 2 + i]:
                units[n // 2 + i] = f"{units[i]}/s"
    states = [State(name, unit, _symbol(name)) for name, unit in zip(roles.state_names, units, strict=True)]
    inputs = [
        State(name, table.unit(column, "system.inputs"), _symbol(name))
        for name, column in ((_name(column, f"u{i + 1}"), column) for i, column in enumerate(roles.inputs))
    ]
    return tuple(states), tuple(inputs)


def _name(column: Column | None, otherwise: str) -> str:
    """Return a column's name as that of a state: letters, digits and _; `otherwise` for one without a name."""
    if not isinstance(column, str):
        return otherwise
    plain = column.partition("[")[0].partition("(")[0].strip() or column
    name = "".join(letter if letter.isalnum() else "_" for letter in plain).strip("_")
    return name if name and not name[0].isdigit() else otherwise


def _symbol(name: str) -> str:
    """Return the name as it stands in figures, in math text; an underscore would be a subscript there."""
    text = r"\mathrm{" + name.removesuffix("_dot").replace("_", r"\_") + "}"
    return rf"\dot{{{text}}}" if name.endswith("_dot") else text
