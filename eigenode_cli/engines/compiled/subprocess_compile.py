"""Compilation in a process of its own, into the cache on disk: what Numba and LLVM keep of it would stay in the run."""

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping

from eigenode_cli.engines.compiled import kernels
from eigenode_cli.engines.compiled.cached import Signature, not_ready
from eigenode_cli.jit import cache_folder


def compile_apart(signatures: Mapping[str, Signature]) -> str | None:
    """Compile kernels, by name, for these argument types.

    Returns:
        None if they lie in the cache now; else why not, in one line, and they are left to be compiled here.
    """
    # -P and the same path: the child imports what this process imports, whatever lies in the current folder
    script = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import main; main()"
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", script],
            input=pickle.dumps(dict(signatures)),
            env=os.environ | {"NUMBA_CACHE_DIR": str(cache_folder())},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            check=False,
        )
    except OSError as error:
        return f"{type(error).__name__}: {error}"
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        return said[-1] if said else f"its process ended with status {done.returncode}"
    missing = not_ready(kernels, signatures)
    return f"{', '.join(missing)} did not get into the cache {cache_folder()}" if missing else None


def main() -> None:
    """Compile what standard input asks for; on a fault its line is the last of standard error, the status 1."""
    try:
        for name, signature in pickle.load(sys.stdin.buffer).items():
            getattr(kernels, name).compile(signature)
    except Exception as error:  # of the compiler or the linker, a full disk
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        sys.exit(": ".join([type(error).__name__, *lines[:2]]))  # Numba's first line names the pass, the second why
