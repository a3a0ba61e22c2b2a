"""Files that are there whole or not at all."""

import csv
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a file beside `path`, then put it in the place of `path` in one move."""
    draft = path.with_name(path.name + ".draft")
    write(draft)
    draft.replace(path)


def write_text(path: Path, text: str) -> None:
    """Write `text`, atomically."""

    def write(draft: Path) -> None:
        draft.write_text(text)

    write_atomically(path, write)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write `content` as JSON, atomically; NaN and infinity become null."""
    write_text(path, json.dumps(_plain(content), indent=2, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def cell(value: float | int | str) -> str:
    """A number as it stands in a CSV file: all digits, empty where it is not defined."""
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    return str(value)


def write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[float | int | str]]) -> None:
    """Write a CSV file with all digits, atomically."""

    def write(draft: Path) -> None:
        with draft.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            writer.writerows([cell(value) for value in row] for row in rows)

    write_atomically(path, write)
