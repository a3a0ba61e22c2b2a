"""One run of a sweep, in whatever process a launcher starts it."""

import gc
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from eigenode_cli.batch.plan import read_plan
from eigenode_cli.batch.state import ERROR, State, recorded
from eigenode_cli.config.compose import finalise, typed
from eigenode_cli.config.composer import own_flags
from eigenode_cli.config.plugins import unforced
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.console import Display
from eigenode_cli.runs.atomic import WriteError, make_folder, write_text
from eigenode_cli.runs.lock import locked
from eigenode_cli.runs.runfile import RecordError
from eigenode_cli.training.ending import FINAL, FINISHED, INTERRUPTED, RUNNING

EXIT_INTERRUPTED = 130


def _nothing() -> None:
    """Prepare nothing."""


def work(config: DictConfig) -> int:
    """Run one job, as Hydra's launchers call it; returns its exit status.

    Raises:
        KeyboardInterrupt: it was interrupted; the worker must not take the next one.
    """
    job = HydraConfig.get()
    words = [*own_flags(), *unforced(job.overrides.task)]
    folder = Path(job.runtime.output_dir)
    status = contained(folder, lambda: attempt(typed(finalise(config)), folder, words))
    _settle()
    if status == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    return status


@cache
def _settle() -> None:
    """Once in a worker, after its first run: keep what is loaded by then out of garbage collection.

    joblib's workers collect garbage every second, and to walk through all objects of torch, Numba and Hydra took a
    quarter of their time.
    """
    gc.collect()
    gc.freeze()


def contained(folder: Path, action: Callable[[], int]) -> int:
    """Return what `action()` returns; 1 if it raises, which then stands in error.txt: the other runs go on."""
    try:
        return action()
    except Exception:
        keep_error(folder, traceback.format_exc())
        return 1


def attempt(config: TrainConfig, folder: Path, words: Sequence[str], watch: Display | None = None) -> int:
    """Bring the run in `folder` to its end: start it, go on with it, or leave it where it is finished.

    Args:
        config: the checked configuration.
        folder: the run's, within the sweep's.
        words: what makes this run, for its record.
        watch: is shown every record.

    Returns:
        The exit status: 0 done, 1 failed, stalled or diverged, 130 interrupted.
    """
    if not figures_chosen(words):
        config.trainer.figures = False
    ended = recorded(folder).status in FINAL
    status = complete(config, folder, words, partial(recorded, folder), watch)
    if status == 1 and not ended:
        error = folder / ERROR
        keep_error(folder, error.read_text() if error.exists() else recorded(folder).error)
    return status


def complete(
    config: TrainConfig,
    folder: Path,
    words: Sequence[str],
    state_of: Callable[[], State],
    watch: Display | None = None,
    prepare: Callable[[], None] = _nothing,
) -> int:
    """Bring a run to its end: start it, go on with it, or leave it where it has ended; another process is waited for.

    Args:
        config: the checked configuration.
        folder: the run's.
        words: what makes this run, for its record.
        state_of: reads how far it is.
        watch: is shown every record.
        prepare: called before a start.

    Returns:
        The exit status: 0 done, 1 failed, stalled or diverged, 130 interrupted.
    """
    from eigenode_cli.batch import run  # noqa: PLC0415  # torch, in the process that trains only

    make_folder(folder)
    with locked(folder, wait=True):
        state = state_of()
        if state.status in FINAL:
            return 0 if state.status == FINISHED else 1
        if state.status in (INTERRUPTED, RUNNING):
            with suppress(RecordError):  # what was saved is damaged: it starts again
                return run.resume(config, folder, state.record, quiet=True, watch=watch)
        prepare()
        return run.train(config, folder, list(words), quiet=True, watch=watch)


def figures_chosen(words: Sequence[str]) -> bool:
    """Whether the user said if runs are drawn; many runs are not, by default."""
    return any(word.startswith("trainer.figures=") for word in words)


def keep_error(folder: Path, text: str) -> None:
    """Write error.txt: the command that repeats the run, then what went wrong."""
    sweep = read_plan(folder.parent)
    commands = [sweep.repeat(job) for job in sweep.jobs if job.name == folder.name]
    with suppress(WriteError):  # what the disk has no room for can't be told there
        write_text(folder / ERROR, "\n".join(["repeat it with:", *commands, "", text.strip(), ""]))
