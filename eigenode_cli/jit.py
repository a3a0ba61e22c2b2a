"""The one place that decides how kernels are compiled, and where the machine code is kept.

Numba's own disk cache keys a function by the file it stands in, so that a change in a kernel which it calls goes
unnoticed, and it writes beside the source, which a read-only site-packages refuses. So the cache lies in a folder of
the user's, named after a hash of every source file of this package that has to do with kernels, and of the versions
that made the machine code. What else decides, Numba's index in it knows: where the source lies, and the processor.

With `NUMBA_DISABLE_JIT=1` kernels stay plain Python, for a debugger (`engines.compiled.debug_memory`).
"""

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

import llvmlite
import numba
import numpy as np
from numba.core import config  # also `numba.config`; tested with 0.68.1: `CACHE_DIR`, `DISABLE_JIT`, both read late

_PACKAGE = Path(__file__).resolve().parent


def _key() -> str:
    """Return what the machine code depends on, but for the processor."""
    versions = (numba.__version__, llvmlite.__version__, sys.implementation.cache_tag)
    digest = hashlib.sha256(repr(versions).encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"njit" in text or b"import numba" in text or b"from numba" in text:
            digest.update(source.relative_to(_PACKAGE).as_posix().encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def _chosen_folder() -> Path:
    """Return the user's cache; where that can't be written, a folder that is gone when the process ends."""
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(base) / "eigenode" / _key()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, RuntimeError):  # the latter without a home
        folder = Path(tempfile.mkdtemp(prefix="eigenode-cache-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def cache_folder() -> Path:
    """Where the machine code is kept."""
    return Path(config.CACHE_DIR)  # pyright: ignore[reportAttributeAccessIssue]  # Numba sets it by name


if not os.environ.get("NUMBA_CACHE_DIR"):
    config.CACHE_DIR = str(_chosen_folder())  # pyright: ignore[reportAttributeAccessIssue]

njit = numba.njit(cache=True, nogil=True, error_model="numpy")
"""Decorator of every kernel: cached on disk, GIL released, IEEE division. No fastmath: NaN must be seen."""

PLAIN = bool(config.DISABLE_JIT)  # pyright: ignore[reportAttributeAccessIssue]
"""Whether functions stay plain Python, for a debugger."""

if PLAIN:
    njit = np.errstate(all="ignore")  # as silent as machine code is about a division by zero

_INNER = {
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}

njit_inner = numba.njit(**_INNER)
"""For functions that only kernels call: no entry from Python and nothing on disk, which saves compilation."""

njit_fused = numba.njit(**_INNER, fastmath={"contract"})
"""The same for elementary functions: a product and a sum may become one fused operation, nothing else may move."""

njit_sums = numba.njit(**_INNER, fastmath={"contract", "reassoc"})
"""The same for sums of products: their order may change, so that reductions vectorise. NaN and infinity still count."""
