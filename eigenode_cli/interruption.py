"""Ctrl-C and SIGTERM: an exception at once, and a request that lasts.

Python drops an exception that comes up in a destructor or in a callback of a weak reference (matplotlib has many of
them). So the signal leaves a request as well, and long work asks for it from time to time.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_requested = threading.Event()


def check() -> None:
    """Raise KeyboardInterrupt if this command was interrupted, however the first one was lost."""
    if _requested.is_set():
        raise KeyboardInterrupt


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    del number, frame
    _requested.set()
    raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """While the body runs, SIGTERM ends a command as Ctrl-C does: resumable, and without workers left behind.

    Where Ctrl-C is ignored, as in a job that a shell started in the background, it stays so.
    """
    _requested.clear()
    if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
        yield
        return
    numbers = [signal.SIGTERM]
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        numbers.append(signal.SIGINT)
    before = {number: signal.signal(number, _interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
