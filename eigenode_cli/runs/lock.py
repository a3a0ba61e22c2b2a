"""The lock of a run's folder: one process works in it at a time, on any machine that shares the disk.

The system holds it for the process, so that a kill frees it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from eigenode_cli.errors import UserError
from eigenode_cli.runs.atomic import writing

LOCK = ".lock"
"""File that is locked. It stays: to delete it could free a lock that another process has just taken."""
PATIENCE = 0.5
"""Seconds to wait for who only looks whether the lock is held."""


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[None]:
    """Keep all others out of `folder`; who holds the lock may take it again within.

    Args:
        folder: exists.
        wait: whether to wait until the folder is free.

    Raises:
        UserError: another process, or another thread, works in it.
        WriteError: nothing can be written into it.
    """
    lock = _lock(folder)
    with writing(folder / LOCK):
        try:
            lock.acquire(timeout=-1 if wait else PATIENCE)
        except Timeout as error:
            raise UserError(f"{folder}: another process works in it; wait until it ends, or stop it") from error
    try:
        yield
    finally:
        lock.release()


def held(folder: Path) -> bool:
    """Whether a process works in `folder`; not as far as can be told where nothing can be written."""
    if not (folder / LOCK).exists():
        return False
    lock = _lock(folder)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    except OSError:
        return False
    lock.release()
    return False


def _lock(folder: Path) -> BaseFileLock:
    return FileLock(folder.resolve() / LOCK, is_singleton=True)
