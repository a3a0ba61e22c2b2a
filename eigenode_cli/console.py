"""What a person sees while a run goes on: a bar with the current losses on a terminal, plain lines in a pipe."""

import math
import re
import sys
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LINES = 20
"""About as many plain lines a run writes into a pipe."""


class Display(Protocol):
    """Shows the progress of one run; used as a context manager."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """A record was written after `step`; `rate` is the time of one step in s, None before the first."""
        ...

    def say(self, message: str) -> None:
        """One line that must not be lost."""
        ...


def describe(losses: dict[str, float]) -> str:
    """The losses in one short line, `sol 0.578  frq 0.0123`; a dash where one is not defined."""
    return "  ".join(f"{name} -" if math.isnan(value) else f"{name} {value:.3g}" for name, value in losses.items())


def counted(count: int, thing: str) -> str:
    """How many there are: 1 seed, 2 seeds."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def minus(text: str) -> str:
    """The text of a page with true minus signs before numbers and in exponents, as its figures have them."""
    return re.sub(r"(?<![\w.)\]-])-(?=\.?\d)|(?<=\de)-(?=\d)", "\N{MINUS SIGN}", text)


def duration(seconds: float) -> str:
    """A time span for people: 0.8 s, 42 s, 3 min 20 s, 1 h 5 min."""
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


class BarDisplay:
    """A progress bar with time left and current losses, for terminals."""

    def __init__(self, label: str, start: int, steps: int) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[losses]}"),
            console=Console(),
        )
        self._task = self._progress.add_task(label, total=steps, completed=start, losses="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""
        del rate  # the bar estimates the time left by itself
        self._progress.update(self._task, completed=step, losses=describe(losses))

    def say(self, message: str) -> None:
        """See `Display.say`."""
        self._progress.console.print(message, markup=False, highlight=False)


class LineDisplay:
    """Plain lines, about twenty a run, for pipes and files."""

    def __init__(self, label: str, start: int, steps: int) -> None:
        self._label = label
        self._steps = steps
        self._next = start
        self._every = max(1, steps // LINES)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.stdout.flush()

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""
        if step < self._next and step != self._steps:
            return
        self._next = step + self._every
        left = "" if rate is None or step == self._steps else f"  ({duration(rate * (self._steps - step))} left)"
        self.say(f"{self._label}  step {step}/{self._steps}  {describe(losses)}{left}")

    def say(self, message: str) -> None:
        """See `Display.say`."""
        print(message, flush=True)


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
    """The display that fits standard output."""
    return BarDisplay(label, start, steps) if sys.stdout.isatty() else LineDisplay(label, start, steps)
