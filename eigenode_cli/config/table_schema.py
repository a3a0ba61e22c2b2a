"""The typed schema of `system=table`: which column of a file is what."""
# option() is dataclasses.field() with a constraint

from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING

from eigenode_cli.config.validators import option

TIME_UNITS = ("s", "ms", "us", "min", "h", "day", "year")
HOLDS = ("linear", "zero")
OFFSETS = ("none", "free")
DUPLICATES = ("error", "first", "last", "mean")
DELIMITERS = (",", ";", "tab", "space", "|")
DECIMALS = (".", ",")


@dataclass
class TableConfig:
    """Measured data from files. A column is given by its name, or by its number from 0."""

    name: str = MISSING
    file: Any = MISSING
    """A file (CSV, TSV, blanks, Parquet, MAT), a list of files, or a pattern such as run*.csv: one trajectory each."""
    folder: str | None = MISSING
    """Folder that the files lie in; null for the current one."""
    time: Any = MISSING
    """Column of the times; null where there is none, then `rate` is needed."""
    time_unit: str | None = option(choices=TIME_UNITS)
    """s | ms | us | min | h | day | year; null for the one that the column's name states, seconds where none does."""
    rate: float | None = option(above=0)
    """Rows a second in Hz where there is no column of times."""
    positions: list[Any] = MISSING
    """Measured position of each degree of freedom, null where one was not measured."""
    velocities: list[Any] = MISSING
    """Measured velocities in the same order."""
    accelerations: list[Any] = MISSING
    """Measured accelerations in the same order."""
    states: list[Any] = MISSING
    """Measured states of a system without positions and velocities (network.structure=full)."""
    inputs: list[Any] = MISSING
    """Known inputs that drive the system."""
    input_hold: str = option(choices=HOLDS)
    """Between its samples an input is interpolated (linear) or keeps its value (zero)."""
    hidden: int = option(at_least=0)
    """Further degrees of freedom, or states, that nobody measured."""
    trial: Any = MISSING
    """Column whose value says which trajectory a row belongs to; null where a file is one trajectory."""
    trials: list[float] | None = MISSING
    """The trials that are taken; null for all."""
    window: list[float] | None = MISSING
    """[first, last] time of the rows that are taken, in the unit of the file; null for all."""
    stride: int = option(at_least=1)
    """Every so many rows are taken."""
    offset: str = option(choices=OFFSETS)
    """free: every measured channel shows a trained constant beside its state, as a sensor with a bias does."""
    duplicates: str = option(choices=DUPLICATES)
    """What becomes of rows with the same time: error | first | last | mean."""
    test: float = option(at_least=0, below=1)
    """Share of each trajectory, at its end, that is held out."""
    test_files: list[str] = MISSING
    """Files that are held out as a whole."""
    delimiter: str | None = option(choices=DELIMITERS)
    """, | ; | tab | space | "|"; null to recognise it."""
    decimal: str | None = option(choices=DECIMALS)
    """. or , ; null to recognise it."""
    header: Any = MISSING
    """none, or the number of the header's line from 1; null to recognise it."""
    variable: str | None = MISSING
    """Of a MAT file: path of the variable that holds the columns, for example run.data."""
