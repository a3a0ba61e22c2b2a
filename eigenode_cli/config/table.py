"""What `system=table` describes: the files, the roles of their columns, and what is read from them."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.errors import UserError, nearest
from eigenode_cli.runs.paths import EXPERIMENT_DIR

if TYPE_CHECKING:
    from eigenode_cli.data.measured import Measured, Roles
    from eigenode_cli.tables import Format

SHIPPED = "shipped"
"""Folder of the shipped records."""
PATTERN = "*?["
"""Signs that make a file's name a pattern."""


def files_of(config: TableConfig) -> list[Path]:
    """Return the files that train, patterns expanded, each as an absolute path.

    Raises:
        UserError: there is none, or a pattern matches none.
    """
    names = [config.file] if isinstance(config.file, str) else list(config.file)
    return _expanded("system.file", names, config.folder)


def _expanded(option: str, names: list[Any], folder: str | None) -> list[Path]:
    found: list[Path] = []
    for own in map(str, names):
        name = str(_inside(folder) / own)
        pattern = bool(set(PATTERN) & set(name)) and not Path(name).exists()
        matches = sorted(Path(name).parent.glob(Path(name).name)) if pattern else [Path(name)]
        if not matches:
            raise UserError(f"{option}={name}: no file matches")
        found += [match.resolve() for match in matches]
    if not found:
        raise UserError(f"{option}=[]: name a file")
    for path in found:
        if not path.exists():
            known = [other.name for other in path.parent.iterdir()] if path.parent.is_dir() else []
            near = nearest(path.name, known)
            hint = f", did you mean {path.with_name(near).name}?" if near else ""
            raise UserError(f"{option}={path.name}: no such file in {path.parent}{hint}")
    return found


def _inside(folder: str | None) -> Path:
    """Return the folder of the files; `shipped:` stands for that of the shipped records."""
    if folder == SHIPPED:
        return EXPERIMENT_DIR / "measured"
    return Path(folder or ".")


def roles_of(config: TableConfig) -> "Roles":
    """Return which column is what."""
    from eigenode_cli.data.measured import FREE, Roles  # noqa: PLC0415  # SciPy, and a command line is checked without it

    return Roles(
        time=config.time,
        time_unit=config.time_unit,
        rate=config.rate,
        positions=tuple(config.positions),
        velocities=tuple(config.velocities),
        accelerations=tuple(config.accelerations),
        states=tuple(config.states),
        inputs=tuple(config.inputs),
        hold=config.input_hold,
        hidden=config.hidden,
        trial=config.trial,
        trials=None if config.trials is None else tuple(config.trials),
        window=None if config.window is None else (config.window[0], config.window[1]),
        stride=config.stride,
        offset=config.offset == FREE,
        duplicates=config.duplicates,
    )


def format_of(config: TableConfig) -> "Format":
    """Return what settles a doubt about the format."""
    from eigenode_cli.tables import Format  # noqa: PLC0415  # as above

    header = None if config.header is None else str(config.header)
    return Format(config.delimiter, config.decimal, header, config.variable)


def measured_of(config: TableConfig) -> "Measured":
    """Read what a configuration describes; one process reads the same files once.

    Raises:
        UserError: with a line for every fault.
    """
    files = files_of(config)
    tests = _expanded("system.test_files", list(config.test_files), config.folder) if config.test_files else []
    stamps = tuple((str(path), path.stat().st_mtime_ns) for path in (*files, *tests))
    return _read(tuple(files), tuple(tests), stamps, roles_of(config), format_of(config), config.test)


@lru_cache(maxsize=4)
def _read(
    files: tuple[Path, ...], tests: tuple[Path, ...], stamps: Any, roles: "Roles", form: "Format", test: float
) -> "Measured":
    from eigenode_cli.data.measured import read_measured  # noqa: PLC0415  # as above

    del stamps  # a file that has changed is read again
    return read_measured(files, roles, form, test, tests)


def role_faults(config: TableConfig, structure: str) -> Iterator[str]:
    """Yield what does not fit together in the roles, before any file is read."""
    second = [name for name in ("positions", "velocities", "accelerations") if getattr(config, name)]
    if config.states and second:
        yield f"system.states={list(config.states)}: either states, or {second[0]} of degrees of freedom"
    elif config.states and structure != "full":
        yield "system.states: states without velocities have the structure full; write network.structure=full"
    elif second and structure != "second_order":
        yield f"system.{second[0]}: belong to network.structure=second_order; name states with system.states"
    elif not config.states and not second:
        yield "system.positions=[]: nothing is measured; name the columns of positions, velocities or accelerations"
    lengths = {name: len(getattr(config, name)) for name in second}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{count} {name}" for name, count in lengths.items())
        yield f"system.{second[0]}: {shown}; give one entry for each degree of freedom, null where not measured"
    if config.time is None and config.rate is None:
        yield "system.time: name the column of the times, or state system.rate in Hz where there is none"
    if config.time is not None and config.rate is not None:
        yield f"system.rate={config.rate:g}: no effect, system.time={config.time} has the times"
    if config.rate is not None and config.time_unit is not None:
        yield f"system.time_unit={config.time_unit}: no effect, system.rate is in Hz"
    if config.window is not None and not (len(config.window) == 2 and config.window[0] < config.window[1]):
        yield f"system.window={list(config.window)}: must be [first,last], the first time before the last"
    if config.trials is not None and config.trial is None:
        yield "system.trials: no effect without system.trial, the column that tells the trials apart"
    if config.input_hold != "linear" and not config.inputs:
        yield f"system.input_hold={config.input_hold}: no effect without system.inputs"
    yield from _column_faults(config)


def _column_faults(config: TableConfig) -> Iterator[str]:
    """Yield a column that is neither a name nor a number, or has two roles."""
    taken: dict[Any, str] = {}
    for name in ("time", "trial", "positions", "velocities", "accelerations", "states", "inputs"):
        value = getattr(config, name)
        for column in value if isinstance(value, list) else [value]:
            if column is None:
                continue
            if not isinstance(column, str | int) or isinstance(column, bool) or (column != 0 and not column):
                yield f"system.{name}={column}: a column is a name, or a number from 0"
            elif column in taken:
                yield f"system.{name}={column}: is system.{taken[column]} already"
            else:
                taken[column] = name
