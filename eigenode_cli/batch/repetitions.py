"""`repetitions=N`: N seeds side by side on threads of this process; while a kernel runs, the others have the GIL."""

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait

from omegaconf import DictConfig

from eigenode_cli.batch.job import attempt, contained, figures_chosen
from eigenode_cli.batch.plan import Sweep
from eigenode_cli.batch.run import EXIT, draw
from eigenode_cli.batch.state import recorded
from eigenode_cli.config.compose import typed
from eigenode_cli.config.composer import keep_composition
from eigenode_cli.config.sweep import Job, of_seed, settings_of
from eigenode_cli.console import QuietDisplay
from eigenode_cli.cpus import usable_cores
from eigenode_cli.training.ending import FINAL, INTERRUPTED


class _Stoppable(QuietDisplay):
    """Interrupts its run at the next record once `stop` is set: Ctrl-C reaches the main thread only."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop

    def record(self, step: int, losses: dict[str, float], rate: float | None) -> None:
        """See `Display.record`."""
        del step, losses, rate
        if self._stop.is_set():
            raise KeyboardInterrupt


def repeat(sweep: Sweep, pending: Sequence[Job], config: DictConfig, threads: int | None = None) -> None:
    """Run the pending repetitions and return when all have ended; how, stands in their folders.

    Each has an engine, an optimizer and random numbers of its own: nothing depends on the number of threads.

    Args:
        sweep: what they belong to.
        pending: those that are not finished.
        config: of the first, checked, with its `hydra` node.
        threads: runs at once, by default one a core.
    """
    stop = threading.Event()

    def run(job: Job) -> None:
        if not stop.is_set():
            folder = sweep.place(job)
            contained(folder, lambda: attempt(configs[job], folder, [*sweep.flags, *job.overrides], _Stoppable(stop)))

    seeds = {job: config.seed + index for index, job in enumerate(sweep.jobs)}
    configs = {job: typed(settings_of(config, seeds[job])) for job in pending}
    drawn = any(figures_chosen(job.overrides) and configs[job].trainer.figures for job in pending)
    for own in configs.values():
        own.trainer.figures = False  # matplotlib is not for several threads: they are drawn afterwards
    for job in pending:
        keep_composition(of_seed(config, seeds[job]), sweep.place(job), job.overrides)
    with ThreadPoolExecutor(threads or usable_cores(), thread_name_prefix="repetition") as pool:
        futures = [pool.submit(run, job) for job in pending]
        try:
            wait(futures)
        except KeyboardInterrupt:
            stop.set()
            raise
    for future in futures:
        future.result()
    if drawn:
        for job in pending:
            ended = recorded(sweep.place(job)).status in FINAL
            if ended and draw(sweep.place(job), quiet=True) == EXIT[INTERRUPTED]:
                raise KeyboardInterrupt
