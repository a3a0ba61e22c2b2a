"""Text tables of any size, read in blocks of lines."""

import gzip
import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.errors import UserError, nearest
from eigenode_cli.tables.cells import HOLES, OTHER_DATE, Clock, is_hole, to_number
from eigenode_cli.tables.layout import Layout, Line, comment_sign, recognise, split
from eigenode_cli.tables.table import Format, Selection, Table, find_column

HEAD = 2**18
"""Bytes that the layout is recognised from."""
BLOCK = 50_000
"""Lines of a block."""
LONGEST = 2**20
"""Characters of the longest line that a table has."""
MAGIC = {
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"%PDF": "a PDF",
    b"PK\x03\x04": "a workbook or an archive",
    b"\xd0\xcf\x11\xe0": "a workbook",
    b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a MAT file without its ending .mat",
    b"PAR1": "a Parquet file without its ending .parquet",
}
"""How files begin that are no text."""


def read_text_table(path: Path, form: Format, selection: Selection) -> Table:
    """Read a text table; see `tables.read_table`."""
    head, encoding, notes = _opening(path)
    newline = "\n" if "\n" in head else "\r"
    lines = [Line(number, text) for number, text in enumerate(head.split(newline), start=1)]
    if len(lines) > 1 and len(head) >= HEAD // 4:  # the last one may be cut off
        lines = lines[:-1]
    layout = recognise(
        [Line(one.number, _clean(one.text)) for one in lines if _clean(one.text).strip()], form, path.name
    )
    reader = _Reader(path.name, layout, selection)
    with _open(path) as raw, io.TextIOWrapper(raw, encoding, newline=newline) as text:
        try:
            for first, block in _blocks(text):
                reader.take(first, block)
        except UnicodeDecodeError as error:
            raise UserError(f"{path.name}: is no text in {encoding} (byte {error.start}); save it as UTF-8") from error
        except (EOFError, gzip.BadGzipFile) as error:
            raise UserError(f"{path.name}: the compressed file is damaged ({error})") from error
    return reader.table(path, (*notes, *layout.notes))


def _open(path: Path) -> Any:
    try:
        if path.suffix.lower() == ".gz":
            return gzip.open(path, "rb")
        return path.open("rb")
    except FileNotFoundError as error:
        known = [other.name for other in path.parent.iterdir()] if path.parent.is_dir() else []
        guess = nearest(path.name, known)
        hint = f", did you mean {guess}?" if guess else ""
        raise UserError(f"{path.name}: no such file in {path.parent}{hint}") from error
    except IsADirectoryError as error:
        raise UserError(f"{path.name}: is a folder; name a file, or a pattern such as {path.name}/*.csv") from error
    except OSError as error:
        raise UserError(f"{path.name}: cannot be read ({os.strerror(error.errno or 0)})") from error


def _opening(path: Path) -> tuple[str, str, list[str]]:
    """Return the first characters of a file, its encoding, and what to tell of it."""
    with _open(path) as file:
        try:
            head = file.read(HEAD)
        except (OSError, EOFError) as error:
            raise UserError(f"{path.name}: the compressed file is damaged ({error})") from error
    if not head.strip():
        raise UserError(f"{path.name}: is empty")
    for magic, kind in MAGIC.items():
        if head.startswith(magic):
            raise UserError(f"{path.name}: is {kind}, not a table; save the table as CSV")
    notes = ["gzip"] if path.suffix.lower() == ".gz" else []
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return head.decode("utf-16", errors="ignore"), "utf-16", [*notes, "UTF-16"]
    zeros = head.count(b"\0")
    if zeros > max(16, len(head) // 20) or sum(byte < 9 for byte in head[:4096]) - head[:4096].count(b"\0") > 16:
        raise UserError(f"{path.name}: is no text; save the table as CSV")
    notes += ["NUL bytes left out"] if zeros else []
    if head.startswith(b"\xef\xbb\xbf"):
        return head[3:].decode("utf-8", errors="ignore"), "utf-8-sig", notes
    try:
        return head.decode("utf-8"), "utf-8", notes
    except UnicodeDecodeError as error:
        if len(head) == HEAD and error.start > HEAD - 4:  # a character that the head cuts
            return head[: error.start].decode("utf-8"), "utf-8", notes
    return head.decode("latin-1"), "latin-1", [*notes, "Latin-1"]


def _clean(text: str) -> str:
    return text.replace("\0", "").rstrip("\r\n")


def _blocks(text: IO[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the first line of each block, and its lines."""
    first, block = 1, []
    for line in text:
        if len(line) > LONGEST:
            raise UserError(f"line {first + len(block)} has {len(line)} characters: not a table of lines")
        block.append(_clean(line))
        if len(block) == BLOCK:
            yield first, block
            first, block = first + BLOCK, []
    if block:
        yield first, block


@dataclass
class _Reader:
    """Takes blocks of lines and keeps the numbers that are wanted.

    Attributes:
        file: its name, for messages.
        layout: of the file.
        selection: what is wanted.
    """

    file: str
    layout: Layout
    selection: Selection

    def __post_init__(self) -> None:
        layout, wanted = self.layout, self.selection.columns
        names = layout.names
        if wanted is None:
            self._columns = [number for number, numeric in enumerate(layout.numeric) if numeric]
        else:
            faults, self._columns = [], []
            for key in dict.fromkeys(wanted):
                try:
                    self._columns.append(find_column(names, key, "column", self.file))
                except UserError as error:
                    faults += error.faults
            if faults:
                raise UserError(faults)
        time = self.selection.time
        self._time = None if time is None else find_column(names, time, "system.time", self.file)
        if self._time is not None and self._time not in self._columns:
            self._columns.insert(0, self._time)
        self._clock = Clock()
        self._values: list[Floats] = []
        self._rows: list[np.ndarray] = []
        self._seen = self._comments = 0
        self._exponents = False

    def take(self, first: int, block: Sequence[str]) -> None:
        """Take the lines of a block, the first of them number `first`."""
        kept = [
            (number, line)
            for number, line in enumerate(block, start=first)
            if number >= self.layout.first and line.strip() and comment_sign(line) is None
        ]
        self._comments += sum(
            1 for n, line in enumerate(block, start=first) if n > self.layout.first and comment_sign(line) is not None
        )
        if not kept:
            return
        values = self._fast([line for _, line in kept])
        if values is None:
            values = np.array([self._row(number, line) for number, line in kept])
        rows = np.array([number for number, _ in kept], dtype=np.int64)
        infinite = np.argwhere(np.isinf(values))
        if infinite.size:
            row, column = infinite[0]
            raise UserError(f"{self.file}, row {rows[row]}, {self._label(self._columns[column])}: is infinite")
        self._keep(values, rows)

    def _keep(self, values: Floats, rows: np.ndarray) -> None:
        """Keep the rows in the window, every so many of them."""
        if self.selection.window is not None and self._time is not None:
            low, high = self.selection.window
            times = values[:, self._columns.index(self._time)]
            inside = ~((times < low) | (times > high))
            values, rows = values[inside], rows[inside]
        start = -self._seen % self.selection.stride
        self._seen += len(rows)
        self._values.append(values[start :: self.selection.stride].copy())
        self._rows.append(rows[start :: self.selection.stride].copy())

    def _fast(self, lines: list[str]) -> Floats | None:
        """Return the numbers by pandas' parser; None where a line needs a closer look."""
        import pandas as pd  # noqa: PLC0415  # half a second

        layout = self.layout
        if any('"' in line for line in lines):
            return None
        if layout.delimiter == " ":
            counts = {len(line.split()) for line in lines}
        else:
            counts = {line.count(layout.delimiter) + 1 for line in lines}
        if counts != {layout.width + int(layout.trailing)}:
            return None
        try:
            frame = pd.read_csv(
                io.StringIO("\n".join(lines)),
                sep=r"\s+" if layout.delimiter == " " else layout.delimiter,
                decimal=layout.decimal,
                header=None,
                usecols=sorted(self._columns),
                na_values=[hole for own in HOLES for hole in (own, own.upper(), own.capitalize())],
                keep_default_na=False,
                skipinitialspace=True,
                dtype=np.float64,
                quoting=3,
            )
        except (ValueError, OverflowError):
            return None
        return frame[self._columns].to_numpy()

    def _row(self, number: int, line: str) -> list[float]:
        """Return the numbers of one line, or say what is wrong with it."""
        layout, cells = self.layout, split(line, self.layout.delimiter)
        count = len(cells)
        if layout.trailing and count == layout.width + 1 and cells[-1] == "":
            cells = cells[:-1]
        if len(cells) != layout.width:
            raise UserError(
                f"{self.file}, row {number}: {count} cells where the others have {layout.width}: '{line.strip()[:40]}';"
                " take the row out of the file, or leave it out with system.window"
            )
        return [self._number(number, column, cells[column]) for column in self._columns]

    def _number(self, row: int, column: int, cell: str) -> float:
        value = to_number(cell, self.layout.decimal)
        if value is None and column == self._time:
            value = self._clock.seconds(cell)
            if value is None and OTHER_DATE.fullmatch(cell):
                raise UserError(
                    f"{self.file}, row {row}, {self._label(column)}: '{cell}' may be one of two dates; write dates as"
                    " 2024-01-31 12:00:00, or give another system.time"
                )
        if value is None:
            raise UserError(
                f"{self.file}, row {row}, {self._label(column)}: '{cell[:40]}' is not a number{self._why(cell)}"
            )
        self._exponents |= not is_hole(cell) and "d" in cell.lower()
        return value

    def _why(self, cell: str) -> str:
        if cell.lower().strip("+-") in ("inf", "infinity"):
            return ", it is infinite"
        if "," in cell and self.layout.decimal == ".":
            return "; write system.decimal=',' if the comma is a decimal sign"
        return ""

    def _label(self, column: int) -> str:
        name = self.layout.names[column]
        return f"column {column} ({name})" if name else f"column {column}"

    def table(self, path: Path, notes: Sequence[str]) -> Table:
        """Return what was kept."""
        layout, more = self.layout, []
        rows = np.concatenate(self._rows) if self._rows else np.empty(0, dtype=np.int64)
        if self._clock.kind:
            more.append(f"time as {self._clock.kind}, in seconds from the first row")
        if self._exponents:
            more.append("exponents with D")
        if self._comments:
            more.append(f"{self._comments} comments between rows")
        values = np.concatenate(self._values) if self._values else np.empty((0, len(self._columns)))
        if not rows.size and self.selection.window is not None:
            low, high = self.selection.window
            raise UserError(f"system.window=[{low:g},{high:g}]: {self.file} has no rows there")
        units = list(layout.units)
        if self._clock.kind and self._time is not None:
            units[self._time] = "s"
        return Table(path, layout.names, tuple(units), tuple(self._columns), values, rows, (*notes, *more))
