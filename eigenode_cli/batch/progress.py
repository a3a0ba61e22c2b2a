"""One view of all runs of a sweep: a bar on a terminal, plain lines in a pipe. It reads the runs' folders."""

import sys
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from eigenode_cli.batch.plan import Sweep
from eigenode_cli.batch.state import read_state
from eigenode_cli.console import LINES, duration
from eigenode_cli.training.ending import ENDED, UNSUCCESSFUL

INTERVAL = 1.0
"""Seconds between two looks at the folders."""


class Watcher:
    """Counts the runs of a sweep by status, again and again.

    Attributes:
        statuses: of every run, by its folder's name.
    """

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        self._started = monotonic()
        self.statuses = {job.name: read_state(sweep.place(job)).status for job in sweep.jobs}
        self._ended_before = self.ended

    @property
    def count(self) -> Counter[str]:
        """Number of runs by status."""
        return Counter(self.statuses.values())

    def look(self) -> None:
        """Read the folders of all runs that have not ended."""
        for job in self._sweep.jobs:
            if self.statuses[job.name] not in ENDED:
                self.statuses[job.name] = read_state(self._sweep.place(job)).status

    @property
    def ended(self) -> int:
        """Number of runs that nobody works on any more."""
        return sum(self.count[status] for status in ENDED)

    def describe(self) -> str:
        """The counts and the time left in one line."""
        count = self.count
        failed = sum(count[status] for status in UNSUCCESSFUL)
        parts = [f"{count['finished']} finished", f"{failed} failed", f"{count['running']} running"]
        done = self.ended - self._ended_before
        left = len(self.statuses) - self.ended
        if done > 0 and left > 0:
            parts.append(f"{duration((monotonic() - self._started) / done * left)} left")
        return ", ".join(parts)


@contextmanager
def watched(sweep: Sweep) -> Iterator[None]:
    """Show the progress of a sweep while the body runs."""
    watcher, stop = Watcher(sweep), threading.Event()
    show = _bar if sys.stdout.isatty() else _lines
    thread = threading.Thread(target=show, args=(watcher, stop), name="progress of the sweep", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def _lines(watcher: Watcher, stop: threading.Event) -> None:
    """About twenty lines, and one at the end."""
    total = len(watcher.statuses)
    every = max(1, total // LINES)
    shown = watcher.ended
    while not stop.wait(INTERVAL):
        watcher.look()
        if watcher.ended >= shown + every and watcher.ended < total:
            shown = watcher.ended
            print(f"sweep  {shown}/{total}  {watcher.describe()}", flush=True)
    watcher.look()
    print(f"sweep  {watcher.ended}/{total}  {watcher.describe()}", flush=True)


def _bar(watcher: Watcher, stop: threading.Event) -> None:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[counts]}"),
    )
    with Progress(*columns, console=Console()) as progress:
        task = progress.add_task("sweep", total=len(watcher.statuses), completed=watcher.ended, counts="")
        ended = False
        while not ended:
            ended = stop.wait(INTERVAL)
            watcher.look()
            progress.update(task, completed=watcher.ended, counts=watcher.describe())
