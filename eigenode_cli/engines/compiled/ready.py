"""Kernels that are compiled or loaded before their first call, announced, and in a process of their own."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from eigenode_cli.engines.compiled import kernels
from eigenode_cli.engines.compiled.cached import not_ready
from eigenode_cli.engines.compiled.subprocess_compile import compile_apart
from eigenode_cli.jit import PLAIN

_COMPILING = threading.Lock()
"""One thread compiles, the others wait for what it made."""


class Kernels:
    """The kernels that one engine calls.

    Args:
        signature: the argument types of a kernel by its name.
        announce: called with a line that the user should see.

    Attributes:
        seconds: time of compiling or of loading machine code in s.
    """

    def __init__(self, signature: Callable[[str], tuple[Any, ...]], announce: Callable[[str], None]) -> None:
        self._signature, self._announce = signature, announce
        self._loaded: set[str] = set()
        self.seconds = 0.0

    def ready(self, *names: str) -> None:
        """Compile or load the kernels of these names before their first call, and take the time."""
        fresh = [name for name in names if name not in self._loaded]
        if not fresh:
            return
        if PLAIN and not self._loaded:
            self._announce("NUMBA_DISABLE_JIT is set: kernels run as plain Python, very slowly, for debugging")
        signatures = {name: self._signature(name) for name in fresh if not PLAIN}
        start = time.perf_counter()
        with _COMPILING:
            self._compile(signatures)
        self._loaded.update(fresh)
        self.seconds += time.perf_counter() - start

    def _compile(self, signatures: Mapping[str, tuple[Any, ...]]) -> None:
        if missing := not_ready(kernels, signatures):
            self._announce("compiling the engine, once for this environment (a few minutes)")
            if fault := compile_apart(missing):
                self._announce(f"compiling it within this run, as it failed in a process of its own: {fault}")
        for name, signature in signatures.items():
            getattr(kernels, name).compile(signature)
