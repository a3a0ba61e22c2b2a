"""Compilation in a process of its own, into the cache on disk: what Numba and LLVM keep of it would stay in the run."""

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from eigenode_cli.engines.compiled import kernel
from eigenode_cli.jit import cache_folder


def compile_apart(signatures: Mapping[str, tuple[Any, ...]]) -> None:
    """Compile kernels, by name, for these argument types; where that fails, they are left to be compiled here."""
    subprocess.run(
        [sys.executable, "-m", "eigenode_cli.engines.compiled.apart"],
        input=pickle.dumps(dict(signatures)),
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache_folder())},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )


def main() -> None:
    """Compile what standard input asks for."""
    for name, signature in pickle.load(sys.stdin.buffer).items():
        getattr(kernel, name).compile(signature)


if __name__ == "__main__":
    main()
