"""What a table is, what settles a doubt about its format, and units of time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.errors import UserError, unknown

Column = str | int
"""A column: its name, or its number from 0."""
UNITS_OF_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "day": 86400.0, "year": 31557600.0}
"""Units of time in s; a year is Julian."""
SPELT = {
    "s": ("s", "sec", "secs", "second", "seconds", "sek", "sekunden"),
    "ms": ("ms", "msec", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "microsecond", "microseconds"),
    "min": ("min", "mins", "minute", "minutes"),
    "h": ("h", "hr", "hrs", "hour", "hours"),
    "day": ("d", "day", "days"),
    "year": ("a", "yr", "yrs", "year", "years", "jahr"),
}
"""How people write them."""
ALONE = ("second", "seconds", "minute", "minutes", "hour", "hours", "day", "days", "year", "years", "jahr")
"""Units that are the whole name of a column without doubt."""
IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(<]\s*(?P<unit>[^\])>]*?)\s*[\])>]\s*$")
BEHIND = re.compile(r"^(?P<name>t|time|zeit)\s*(?:/|_|\s+in\s+)\s*(?P<unit>[a-zµμ]+)$", re.IGNORECASE)


@dataclass(frozen=True)
class Format:
    """What settles a doubt about the format of a file; None where it is to be recognised.

    Attributes:
        delimiter: `,` | `;` | `tab` | `space` | `|`.
        decimal: `.` | `,`.
        header: `none`, or the number of the header's line from 1.
        variable: path of a MAT file's variable.
    """

    delimiter: str | None = None
    decimal: str | None = None
    header: str | None = None
    variable: str | None = None


@dataclass(frozen=True)
class Selection:
    """What is wanted of a table.

    Attributes:
        columns: names or numbers; None for every column with numbers. What stands in others does not matter.
        time: the column of the times, whose cells may be dates.
        window: rows whose time, as it stands in the file, lies between the two; None for all.
        stride: every so many of these rows.
    """

    columns: tuple[Column, ...] | None = None
    time: Column | None = None
    window: tuple[float, float] | None = None
    stride: int = 1


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Attributes:
        path: of the file.
        names, units: of every column of the file, empty where it states none.
        numbers: which columns of the file were read `(K,)`.
        values: `(rows, K)`, NaN where a cell is empty.
        rows: line of each row in the file, from 1 `(rows,)`.
        notes: what was recognised, in a few words each.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    numbers: tuple[int, ...]
    values: Floats
    rows: Integers
    notes: tuple[str, ...] = field(default=())

    def column(self, key: Column, option: str) -> int:
        """Return where a column stands in `values`.

        Raises:
            UserError: there is no such column, or its name is not the only one.
        """
        number = find_column(self.names, key, option, self.path.name)
        if number not in self.numbers:
            raise UserError(f"{option}={key}: {self.path.name} has no numbers in this column")
        return self.numbers.index(number)

    def unit(self, key: Column, option: str) -> str:
        """Return the stated unit of a column; see `column`."""
        return self.units[find_column(self.names, key, option, self.path.name)]

    def unit_of_time(self, key: Column) -> str | None:
        """Return the unit of time that a column states in its name or below it; None where it states none."""
        number = find_column(self.names, key, "system.time", self.path.name)
        return time_unit(self.names[number], self.units[number])

    @property
    def summary(self) -> str:
        """One line on how it was read."""
        names = ", ".join(name or str(number) for number, name in enumerate(self.names))
        parts = [f"{self.path.name}: {len(self.rows)} rows, {len(self.names)} columns ({names})", *self.notes]
        return ", ".join(parts)


def find_column(names: Sequence[str], key: Column, option: str, file: str) -> int:
    """Return the number of a column in its file.

    Raises:
        UserError: there is no such column, or its name is not the only one.
    """
    if isinstance(key, int):
        if not 0 <= key < len(names):
            raise UserError(f"{option}={key}: {file} has the columns 0 to {len(names) - 1}")
        return key
    same = [number for number, name in enumerate(names) if name == key]
    if len(same) > 1:
        raise UserError(f"{option}={key}: {file} has this name in columns {', '.join(map(str, same))}; give the number")
    if same:
        return same[0]
    known = [name for name in names if name]
    if not known:
        raise UserError(
            f"{option}={key}: the columns of {file} have no names; give a number from 0 to {len(names) - 1}"
        )
    raise UserError(f"{option}={key}: {file}: {unknown('column', key, dict.fromkeys(known))}")


def split_unit(text: str) -> tuple[str, str]:
    """Return name and unit of a header's cell: `t [ms]` is `t` and `ms`; the unit is empty where none is stated."""
    match = IN_BRACKETS.match(text) or BEHIND.match(text)
    if match is None or not match["name"]:
        return text, ""
    if match.re is BEHIND:
        return text, match["unit"]
    return match["name"], match["unit"]


def time_unit(name: str, unit: str) -> str | None:
    """Return the unit of time that a name, or a unit beside it, states without doubt; None where there is none."""
    for text in (unit, name if name.lower() in ALONE else ""):
        found = next((known for known, words in SPELT.items() if text.strip("[]() ").lower() in words), None)
        if found is not None:
            return found
    return None
