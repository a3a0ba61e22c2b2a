"""How a text file is laid out: delimiter, decimal sign, header, units, comments; recognised from its first lines."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from eigenode_cli.errors import UserError
from eigenode_cli.tables.cells import COMMA, OTHER_DATE, THOUSANDS, is_date, is_hole, is_number
from eigenode_cli.tables.table import Format, split_unit

DELIMITERS = {"tab": "\t", ";": ";", "|": "|", ",": ",", "space": " "}
"""Signs by their names in `system.delimiter`, in the order in which they are tried."""
COMMENTS = ("#", "%", "//", "!")
"""Signs that begin a line of comment."""
UNIT = re.compile(r"[\[(]?[a-zA-Zµμ°%Ω²³/*^0-9·\s_.-]{0,12}[\])]?")
MOST = 0.5
"""A column has numbers if more than this share of its cells are: what is not then is a fault, not a text."""


@dataclass(frozen=True)
class Line:
    """A line that is not blank: its number from 1, and its text."""

    number: int
    text: str


@dataclass(frozen=True)
class Layout:
    """How the rows of a file are read.

    Attributes:
        delimiter, decimal: signs.
        width: cells of a row, without an empty one behind a trailing delimiter (`trailing`).
        names, units: of the columns, empty strings where there are none.
        first: number of the first line with data.
        numeric: whether a column has numbers, or dates.
        notes: what was recognised.
    """

    delimiter: str
    decimal: str
    width: int
    trailing: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int
    numeric: tuple[bool, ...]
    notes: tuple[str, ...]


def split(text: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without blanks around them and without quotes."""
    if delimiter == " ":
        return [cell.strip('"') for cell in text.split()] if '"' not in text else _quoted(text.strip(), " ")
    if '"' in text:
        return _quoted(text.strip(" "), delimiter)
    return [cell.strip() for cell in text.split(delimiter)]


def _quoted(text: str, delimiter: str) -> list[str]:
    rows = list(csv.reader([text], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in rows[0]] if rows else []


def comment_sign(text: str) -> str | None:
    """Return the sign that makes a line a comment, None of any other line."""
    stripped = text.lstrip()
    return next((sign for sign in COMMENTS if stripped.startswith(sign)), None)


def recognise(lines: Sequence[Line], form: Format, file: str) -> Layout:
    """Return the layout of a file from its leading lines that are not blank.

    Raises:
        UserError: there are no rows of numbers, or something is in doubt.
    """
    notes: list[str] = []
    declared = form.delimiter
    if lines and lines[0].text.lower().startswith("sep=") and len(lines[0].text) == 5:
        sign = lines[0].text[4]
        declared = declared or next((name for name, own in DELIMITERS.items() if own == sign), None)
        lines = lines[1:]
    body = [line for line in lines if comment_sign(line.text) is None]
    if not body:
        raise UserError(f"{file}: holds no rows of numbers" + (" below its comments" if lines else ""))
    candidates = [declared] if declared else list(DELIMITERS)
    tried = [found for name in candidates if (found := _try(body, name, form)) is not None]
    if not tried:
        raise UserError(f"{file}: no rows of numbers are recognised in it{_hint(body)}")
    best = max(tried, key=lambda found: (found.rows, found.numbers))
    _check_decimal(best, form, file)
    if best.delimiter != "," or best.width > 1:
        shown = next(name for name, sign in DELIMITERS.items() if sign == best.delimiter)
        notes.append(f"delimiter {'blanks' if shown == 'space' else shown}" if best.width > 1 else "one column")
    if best.decimal == ",":
        notes.append("decimal comma")
    if best.trailing:
        notes.append("trailing delimiter")
    names, units, told = _header(lines, best, form, file)
    comments = sum(comment_sign(line.text) is not None for line in lines if line.number < best.first)
    if comments:
        notes.append(f"{comments} comment line{'s' * (comments > 1)}")
    _doubt_commas(best, names, told, form, file)
    numeric = tuple(best.numeric)
    return Layout(
        best.delimiter, best.decimal, best.width, best.trailing, names, units, best.first, numeric, (*notes, *told)
    )


@dataclass(frozen=True)
class _Found:
    """What a delimiter makes of the lines: see `Layout`; `rows` of data, `numbers` of columns, `cells` of all rows."""

    delimiter: str
    decimal: str
    width: int
    trailing: bool
    first: int
    rows: int
    numbers: int
    numeric: list[bool]
    cells: list[list[str]]


def _try(body: Sequence[Line], name: str, form: Format) -> _Found | None:
    """Return what a delimiter makes of the lines, None where no rows of numbers come out."""
    delimiter = DELIMITERS[name]
    every = [split(line.text, delimiter) for line in body]
    tail = every[len(every) // 3 :]
    width = Counter(map(len, tail)).most_common(1)[0][0]
    whole = [cells for cells in tail if len(cells) == width]
    decimal = form.decimal or _decimal(whole, delimiter)
    trailing = width > 1 and all(cells[-1] == "" for cells in whole)
    width -= int(trailing)
    numeric = [_is_numeric([cells[i] for cells in whole], decimal) for i in range(width)]
    if not any(numeric):
        return None

    def fits(cells: list[str]) -> bool:
        if len(cells) != width + int(trailing) and len(cells) != width:
            return False
        known = [_is_value(cells[i], decimal) for i in range(width) if numeric[i]]
        return all(known) and any(not is_hole(cells[i]) for i in range(width) if numeric[i])

    data = [number for number, cells in enumerate(every) if fits(cells)]
    if not data:
        return None
    first = body[data[0]].number
    if form.header is not None and form.header != "none":
        below = [line.number for line in body if line.number > int(form.header)]
        first = max(first, below[0]) if below else first
    return _Found(delimiter, decimal, width, trailing, first, len(data), sum(numeric), numeric, whole)


def _decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    """Return the decimal sign of the cells: a comma where cells have one and no point."""
    if delimiter == ",":
        quoted = [cell for cells in rows for cell in cells if "," in cell]
        points = any("." in cell and is_number(cell, ".") for cells in rows for cell in cells)
        return "," if quoted and not points and all(COMMA.fullmatch(cell) for cell in quoted) else "."
    commas = sum(COMMA.fullmatch(cell) is not None and "," in cell for cells in rows for cell in cells)
    points = sum(is_number(cell, ".") and "." in cell for cells in rows for cell in cells)
    return "," if commas > points else "."


def _is_value(cell: str, decimal: str) -> bool:
    return is_number(cell, decimal) or is_hole(cell) or is_date(cell)


def _is_numeric(cells: Sequence[str], decimal: str) -> bool:
    """Whether a column has numbers or dates in most of its cells."""
    filled = [cell for cell in cells if not is_hole(cell)]
    fitting = sum(is_number(cell, decimal) or is_date(cell) for cell in filled)
    return bool(filled) and fitting > MOST * len(filled)


def _check_decimal(found: _Found, form: Format, file: str) -> None:
    """Refuse commas that may be decimal signs or group thousands."""
    if form.decimal is not None or found.decimal != ",":
        return
    commas = [cell for cells in found.cells for cell in cells if "," in cell]
    if commas and all(THOUSANDS.fullmatch(cell) for cell in commas):
        raise UserError(
            f"{file}, row {found.first}: '{commas[0]}' may be {commas[0].replace(',', '')} or"
            f" {commas[0].replace(',', '.')}; write system.decimal=',' or system.decimal=."
        )


def _doubt_commas(found: _Found, names: Sequence[str], told: Sequence[str], form: Format, file: str) -> None:
    """Refuse whole numbers between commas where twice as few names stand above them: the comma may be both."""
    settled = form.delimiter is not None or form.decimal is not None
    if settled or found.delimiter != "," or any(names):
        return
    count = next((int(note.split()[2]) for note in told if note.startswith("header names")), 0)
    whole = all(re.fullmatch(r"[+-]?\d*", cell) for cells in found.cells for cell in cells)
    if count and found.width == 2 * count and whole:
        raise UserError(
            f"{file}, row {found.first}: {count} names and {found.width} cells; the comma may be delimiter and decimal"
            " sign. Write system.delimiter=, if it only parts cells, else save the file with another delimiter"
        )


def _header(
    lines: Sequence[Line], found: _Found, form: Format, file: str
) -> tuple[tuple[str, ...], tuple[str, ...], list[str]]:
    """Return names and units of the columns, empty where there are none, and what to tell of them."""
    empty = ("",) * found.width
    above = [line for line in lines if line.number < found.first]
    if form.header is not None and form.header != "none":
        above = [line for line in above if line.number <= int(form.header)]
        if not above or above[-1].number != int(form.header):
            raise UserError(
                f"system.header={form.header}: {file} has no header in this line, data begin in {found.first}"
            )
    if not above or form.header == "none":
        return empty, empty, ["no header"]
    cells, units = _names(above[-1].text, found), empty
    if len(above) > 1 and len(cells) == found.width and all(UNIT.fullmatch(cell) for cell in cells):
        before = _names(above[-2].text, found)
        if len(before) == found.width and any(before) and form.header is None and _looks_like_units(cells):
            units, cells, above = tuple(cell.strip("[]() ") for cell in cells), before, above[:-1]
    free = len(above) - sum(comment_sign(line.text) is not None for line in above) - 1
    if len(cells) != found.width:
        if comment_sign(above[-1].text) is None and len(cells) == 1 and found.width > 1:
            return empty, empty, ["no header", f"{free + 1} line{'s' * (free > 0)} of text"]
        return empty, empty, [f"header names {len(cells)} of {found.width} columns: columns by number"]
    parts = [split_unit(cell) for cell in cells]
    names = tuple(name for name, _ in parts)
    stated = tuple(own or unit for (_, own), unit in zip(parts, units, strict=True))
    notes = [f"header in line {above[-1].number}"] + (["unit row"] if units is not empty else [])
    return names, stated, notes + ([f"{free} line{'s' * (free > 1)} of text"] if free > 0 else [])


def _names(text: str, found: _Found) -> list[str]:
    """Return the names in a line, a sign of comment before the first one taken away."""
    sign = comment_sign(text)
    bare = text.lstrip()[len(sign) :] if sign else text
    cells = split(bare.strip() if found.delimiter != "\t" else bare.strip(" "), found.delimiter)
    return cells[:-1] if len(cells) == found.width + 1 and cells[-1] == "" else cells


def _looks_like_units(cells: Sequence[str]) -> bool:
    """Whether cells are units: in brackets, or short with one that is well known."""
    known = (
        "s",
        "ms",
        "us",
        "µs",
        "min",
        "h",
        "m",
        "mm",
        "cm",
        "n",
        "nm",
        "v",
        "mv",
        "g",
        "hz",
        "a",
        "ma",
        "rad",
        "deg",
    )
    plain = [cell.strip("[]() ").lower() for cell in cells]
    bracketed = all(cell[:1] in "[(" or not cell for cell in cells)
    return bracketed or sum(cell in known or "/" in cell for cell in plain) >= (len(plain) + 1) // 2


def _hint(body: Sequence[Line]) -> str:
    """Return what may be wrong with a file without rows of numbers."""
    cells = [cell for line in body[-3:] for cell in re.split(r"[;,\t ]", line.text)]
    if any(OTHER_DATE.fullmatch(cell) for cell in cells):
        return "; dates must be written as 2024-01-31 12:00:00"
    return f"; its last line begins with '{body[-1].text.strip()[:30]}'"
