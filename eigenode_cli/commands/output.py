"""What a command prints and saves: standard output may go away, with the pipe, the terminal or a full disk.

A run is not lost with what it is shown on.
"""

import errno
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from eigenode_cli.runs.atomic import write_text

if TYPE_CHECKING:
    from pandas import DataFrame


class _Lasting:
    """A stream that takes whatever is written and forgets it from the first time on that it can't be.

    Attributes:
        lost: why something was forgotten, None while nothing was.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.lost: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write `text` where there is still somebody to read it."""
        with self._forgetting():
            return self._stream.write(text)
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write all `lines`."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Flush what was written."""
        with self._forgetting():
            self._stream.flush()

    @contextmanager
    def _forgetting(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.lost = self.lost or error
            with suppress(OSError, ValueError):  # a stream that is no file has no number
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())  # what is buffered, and what children write, goes there too
                os.close(nowhere)


@contextmanager
def lasting_output() -> Iterator[Callable[[], bool]]:
    """Let nothing fail within because it can't be printed; gives a function that tells whether a disk lost something.

    A reader that has seen enough, `eigenode list | head -1`, has lost nothing.
    """
    if sys.stdin is None:
        _reopened(0)
    streams = sys.stdout, sys.stderr
    closed = [_reopened(number) if stream is None else stream for number, stream in enumerate(streams, start=1)]
    out, err = (_Lasting(stream) for stream in closed)
    sys.stdout, sys.stderr = out, err  # pyright: ignore[reportAttributeAccessIssue]  # all of a stream that is used

    def lost() -> bool:
        out.flush()
        if out.lost is None or out.lost.errno == errno.EPIPE:
            return False
        print(f"eigenode: standard output: {out.lost.strerror}; what was printed is lost", file=sys.stderr)
        return True

    try:
        yield lost
    finally:
        out.flush()
        err.flush()
        sys.stdout, sys.stderr = streams


def _reopened(number: int) -> TextIO:
    """Return a stream to nowhere with the number of one that was closed: no file of a run may get it."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    if nowhere != number:
        os.dup2(nowhere, number)
        os.close(nowhere)
    return open(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False)  # a number, for the whole process


def save_table(table: "DataFrame", name: str) -> None:
    """Write a table into the CSV file of this name, as a whole or not at all, and say where it is."""
    write_text(Path(name), table.to_csv(index=False))
    print(name)
