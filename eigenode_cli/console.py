"""What a person sees: progress as a bar on a terminal and plain lines in a pipe, tables, numbers in text."""

import math
import re
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from rich.text import Text

LINES = 20
"""About as many plain lines of progress go into a pipe."""
NOTHING = "\N{EN DASH}"
"""Stands where there is no number."""
LONGEST_WHOLE = 1e6
"""Numbers from a thousand up to this one are written without an exponent."""


class Display(Protocol):
    """Shows the progress of one run; used as a context manager."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """Show the record after `step`; `rate` is the time of one step in s, None before the first."""
        ...

    def say(self, message: str) -> None:
        """One line that must not be lost."""
        ...


def describe(losses: dict[str, float]) -> str:
    """Return the losses in one short line, `sol 0.578  frq 0.0123`; a dash where one is not defined."""
    return "  ".join(f"{name} -" if math.isnan(value) else f"{name} {value:.3g}" for name, value in losses.items())


def number(value: float | None) -> str:
    """Return a number as text: three significant digits, whole from a thousand on, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:.0f}" if 1000.0 <= abs(value) < LONGEST_WHOLE else f"{value:.3g}"


def spread(low: float, middle: float, high: float) -> str:
    """Return a median with its quartiles, `0.5 [0.4, 0.7]`; the median alone where they are equal or there are none."""
    if low == high or not math.isfinite(middle):
        return number(middle)
    return f"{number(middle)} [{number(low)}, {number(high)}]"


def show_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", right: Sequence[str] = ()
) -> None:
    """Print a table: wrapped to the width of a terminal, a line a row in a pipe.

    Args:
        header: titles of the columns; none where it is empty.
        rows: texts of the cells.
        title: a line above.
        right: columns whose texts are flush right.
    """
    console = Console()
    table = Table(box=None, header_style="bold", show_header=bool(header), pad_edge=False, padding=(0, 2, 0, 0))
    for index in range(max(len(header), *map(len, rows))):
        name = header[index] if header else ""
        table.add_column(name, justify="right" if name in right else "left", no_wrap=not console.is_terminal)
    for row in rows:
        table.add_row(*map(Text, row))
    if not console.is_terminal:
        console = Console(
            width=1 + sum(2 + max(map(len, texts)) for texts in zip(header or rows[0], *rows, strict=True))
        )
    if title:
        print(f"\n{title}")
    with console.capture() as capture:
        console.print(table)
    print("\n".join(line.rstrip() for line in capture.get().splitlines()))


def counted(count: int, thing: str) -> str:
    """How many there are: 1 seed, 2 seeds."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def minus(text: str) -> str:
    """Return the text of a page with true minus signs before numbers and in exponents, as its figures have them."""
    return re.sub(r"(?<![\w.)\]-])-(?=\.?\d)|(?<=\de)-(?=\d)", "\N{MINUS SIGN}", text)


def duration(seconds: float) -> str:
    """Return a time span for people: 0.8 s, 42 s, 3 min 20 s, 1 h 5 min."""
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


class Counter(Protocol):
    """Counts what is done of something long; used as a context manager."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def show(self, done: int, text: str = "", left: float | None = None) -> None:
        """So many are done; `text` says more, `left` is an estimate of the time that is left in s."""
        ...

    def say(self, message: str) -> None:
        """One line that must not be lost."""
        ...


class BarCounter:
    """A progress bar, for terminals."""

    def __init__(self, label: str, total: int, start: int = 0) -> None:
        columns = ("{task.description}", "{task.fields[text]}", "{task.fields[left]}")
        label_column, text_column, left_column = map(TextColumn, columns)
        self._progress = Progress(
            *(label_column, BarColumn(20), MofNCompleteColumn(), left_column, text_column),
            console=Console(),
        )
        self._task = self._progress.add_task(label, total=total, completed=start, text="", left="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show(self, done: int, text: str = "", left: float | None = None) -> None:
        """See `Counter.show`."""
        remaining = "" if left is None else f"{duration(left)} left"
        self._progress.update(self._task, completed=done, text=text, left=remaining)

    def say(self, message: str) -> None:
        """See `Counter.say`."""
        self._progress.console.print(message, markup=False, highlight=False)


class LineCounter:
    """Plain lines, about twenty in all, for pipes and files."""

    def __init__(self, label: str, total: int, start: int = 0) -> None:
        self._label, self._total = label, total
        self._next, self._every = start, max(1, total // LINES)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.stdout.flush()

    def show(self, done: int, text: str = "", left: float | None = None) -> None:
        """See `Counter.show`."""
        if done < self._next and done != self._total:
            return
        self._next = done + self._every
        remaining = "" if left is None or done == self._total else f"  ({duration(left)} left)"
        self.say(f"{self._label} {done}/{self._total}  {text}{remaining}".rstrip())

    def say(self, message: str) -> None:
        """See `Counter.say`."""
        print(message, flush=True)


def counter(label: str, total: int, start: int = 0) -> Counter:
    """Return the counter that fits standard output.

    Args:
        label: what is counted.
        total: how many there are; start: how many of them were done before.
    """
    return BarCounter(label, total, start) if sys.stdout.isatty() else LineCounter(label, total, start)


class RunDisplay:
    """The progress of one run, on a counter of its steps."""

    def __init__(self, steps: int, counter: Counter) -> None:
        self._steps, self._counter = steps, counter

    def __enter__(self) -> Self:
        self._counter.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._counter.__exit__(kind, error, trace)

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""
        self._counter.show(step, describe(losses), None if rate is None else rate * (self._steps - step))

    def say(self, message: str) -> None:
        """See `Display.say`."""
        self._counter.say(message)


class QuietDisplay:
    """Shows nothing: one run among many, whose folder tells everything."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""

    def say(self, message: str) -> None:
        """See `Display.say`."""


def display(label: str, start: int, steps: int) -> Display:
    """Return the display of a run that fits standard output."""
    return RunDisplay(steps, counter(f"{label}  step", steps, start))
