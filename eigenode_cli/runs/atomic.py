"""Files that are there whole or not at all, and one line where they cannot be written."""

import csv
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class WriteError(OSError):
    """A file could not be written: the disk is full, the folder read-only; the message names the file and the cause."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Whatever the system answers to writing `path`, as a `WriteError`."""
    try:
        yield
    except WriteError:
        raise
    except OSError as error:
        raise WriteError(f"cannot write {path}: {error.strerror or error}") from error


def make_folder(path: Path) -> None:
    """Make the folder `path`, with those above it, where there is none.

    Raises:
        WriteError: it can't be made.
    """
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file beside `path`, then put it in the place of `path` in one move.

    Raises:
        WriteError: it can't be written; what stood there is still there.
    """
    draft = path.with_name(path.name + ".draft")
    with writing(path):
        try:
            write(draft)
            draft.replace(path)
        except BaseException:
            draft.unlink(missing_ok=True)  # on a full disk, a half of it would take the room of the next
            raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content`, atomically."""
    write_atomically(path, lambda draft: draft.write_bytes(content))


def write_text(path: Path, text: str) -> None:
    """Write `text`, atomically."""
    write_bytes(path, text.encode())


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
    """Return a number as it stands in a CSV file: all digits, empty where it is not defined."""
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


class Reserve:
    """Room on the disk for the last word: taken while there is some, given back when it is needed.

    Args:
        folder: holds it as a hidden file meanwhile.
    """

    SIZE = 1 << 16

    def __init__(self, folder: Path) -> None:
        self._path = folder / ".reserve"

    def take(self) -> None:
        """Take the room.

        Raises:
            WriteError: there is none.
        """
        write_bytes(self._path, b"room for the end of run.json\n".ljust(self.SIZE, b"."))

    def give(self) -> None:
        """Give it back."""
        with writing(self._path):
            self._path.unlink(missing_ok=True)
