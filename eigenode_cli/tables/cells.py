"""Cells of a text table: numbers, holes, dates."""

import re
from dataclasses import dataclass

import numpy as np

NAN = float("nan")
HOLES = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "?")
"""Cells without a number, in lower case."""
POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
COMMA = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eEdD][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+")
ISO = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}([.,]\d+)?)?(Z|[+-]\d{2}:?\d{2})?)?")
CLOCK = re.compile(r"\d{1,2}:\d{2}:\d{2}([.,]\d+)?")
OTHER_DATE = re.compile(r"\d{1,2}[/.-]\d{1,2}[/.-]\d{2,4}(\s.*)?|\d{4}/\d{1,2}/\d{1,2}(\s.*)?")


def is_hole(cell: str) -> bool:
    """Whether a cell says that there is no number."""
    return cell.lower() in HOLES


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal sign."""
    return (POINT if decimal == "." else COMMA).fullmatch(cell) is not None


def to_number(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, NaN for a hole, None where it is neither."""
    if is_hole(cell):
        return NAN
    if not is_number(cell, decimal):
        return None
    return float(cell.replace(",", ".").replace("d", "e").replace("D", "e"))


@dataclass
class Clock:
    """Times written as dates or as the time of day: seconds from the first row.

    Attributes:
        first: of the first cell, None before there is one.
        kind: how it is written, `date` | `time of day`.
    """

    first: "np.datetime64 | float | None" = None
    kind: str = ""

    def seconds(self, cell: str) -> float | None:
        """Return the seconds that a cell is behind the first one; None where it is no date without doubt."""
        if CLOCK.fullmatch(cell) and self.kind != "date":
            hours, minutes, rest = cell.replace(",", ".").split(":")
            value = 3600.0 * int(hours) + 60.0 * int(minutes) + float(rest)
            self.first = value if self.first is None else self.first
            self.kind = "time of day"
            return value - float(self.first)  # type: ignore[arg-type]
        if ISO.fullmatch(cell) and self.kind != "time of day":
            import pandas as pd  # noqa: PLC0415  # only for dates

            stamp = pd.Timestamp(cell.replace(",", "."))
            moment = (stamp.tz_convert(None) if stamp.tzinfo else stamp).to_datetime64()
            self.first = moment if self.first is None else self.first
            self.kind = "date"
            return float((moment - self.first) / np.timedelta64(1, "ns")) * 1e-9  # type: ignore[operator]
        return None


def is_date(cell: str) -> bool:
    """Whether a cell is a date or a time of day that can be read without doubt."""
    return bool(ISO.fullmatch(cell) or CLOCK.fullmatch(cell))
