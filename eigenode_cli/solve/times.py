"""Output times and fixed steps, the same for both engines."""

import math
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats


def checked_times(times: Any) -> Floats:
    """Output times in s as float64 `(N,)`: finite and ascending; one that repeats shows the same state again.

    Raises:
        ValueError: they are none.
    """
    array = np.asarray(times, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"times have the shape {array.shape}; write one after another (N,), at least the first")
    wrong = np.flatnonzero(~np.isfinite(array))
    if wrong.size > 0:
        raise ValueError(f"times[{wrong[0]}] is {array[wrong[0]]}; times must be finite")
    back = np.flatnonzero(np.diff(array) < 0.0)
    if back.size > 0:
        here = back[0] + 1
        raise ValueError(f"times[{here}] = {array[here]} s follows {array[here - 1]} s; times must ascend")
    return array


def fixed_step_count(step: float, start: float, end: float) -> int:
    """Count the steps of size `step` from `start` to `end` in s, the last one shorter: no sliver behind a multiple."""
    return max(1, math.ceil((end - start) / step - 1e-9)) if end > start else 0


def fixed_steps(step: float, start: float, end: float) -> Floats:
    """Return steps of one size from `start` to `end` in s, the last one shorter; no sliver where they fit."""
    count = fixed_step_count(step, start, end)
    steps = np.full(count, step)
    steps[-1:] = (end - start) - (count - 1) * step
    return steps
