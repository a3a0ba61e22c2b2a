"""One view of all runs of a sweep: a bar on a terminal, plain lines in a pipe. It reads the runs' folders."""

import collections
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

from eigenode_cli.batch.plan import Sweep
from eigenode_cli.batch.state import read_state
from eigenode_cli.console import Counter, counter, duration
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
    def count(self) -> collections.Counter[str]:
        """Number of runs by status."""
        return collections.Counter(self.statuses.values())

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
        """Return the counts and the time left in one line."""
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
    with counter("sweep ", len(watcher.statuses), watcher.ended + 1) as shown:
        thread = threading.Thread(target=_show, args=(watcher, shown, stop), name="progress of the sweep", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def _show(watcher: Watcher, shown: Counter, stop: threading.Event) -> None:
    """Look at the folders again and again, and show what changed."""
    before = watcher.ended
    while not stop.wait(INTERVAL):
        watcher.look()
        if before != watcher.ended < len(watcher.statuses):
            before = watcher.ended
            shown.show(watcher.ended, watcher.describe())
    watcher.look()
    shown.show(watcher.ended, watcher.describe())
