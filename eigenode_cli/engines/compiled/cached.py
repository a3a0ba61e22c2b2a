"""Whether Numba would load a kernel from its cache on disk instead of compiling it.

The only module that reaches into Numba's internals: no public function tells, and a file in the cache does not either,
because Numba loads it only for the same source, signature, processor, Python and version of Numba. Tested with Numba
0.68. Where its internals have changed, or its index is damaged, the answer is no: then a compilation is announced that
may turn out to be a load.
"""

import pickle
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

Signature = tuple[Any, ...]
"""Numba's types of the arguments."""
CHANGED = (AttributeError, TypeError, OSError)
"""Raised where the internals have changed, or the cache cannot be read."""
DAMAGED = (pickle.UnpicklingError, EOFError, ImportError, ValueError, IndexError, KeyError)
"""Raised by an index that is not as Numba wrote it."""


def is_ready(dispatcher: Any, signature: Signature) -> bool:
    """Whether a jitted function is compiled for `signature` in this process, or would be loaded from the cache."""
    return signature in dispatcher.overloads or _in_cache(dispatcher, signature)


def not_ready(kernels: Any, signatures: Mapping[str, Signature]) -> dict[str, Signature]:
    """Those of `signatures`, by the kernel's name in the module `kernels`, that have to be compiled."""
    return {name: one for name, one in signatures.items() if not is_ready(getattr(kernels, name), one)}


def _in_cache(dispatcher: Any, signature: Signature) -> bool:
    """Look `signature` up as `numba.core.caching.Cache.load_overload` does, without loading the machine code."""
    try:
        cache, context = dispatcher._cache, dispatcher.targetctx
        context.refresh()
        file = cache._cache_file
        name = file._load_index().get(cache._index_key(signature, context.codegen()))
        return name is not None and Path(file._data_path(name)).is_file()
    except CHANGED:
        return False
    except DAMAGED:
        with suppress(OSError):
            dispatcher._cache.flush()  # Numba itself would fail to read it, at every compilation
        return False
