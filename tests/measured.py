"""Measurements for tests, from states that are known."""

from typing import Any

import numpy as np

from eigenode_cli.data.dataset import Series


def series(times: Any, states: np.ndarray, mask: np.ndarray | None = None) -> Series:
    """Those of the states `(N, n)` that the mask shows, by default all, and the initial state."""
    shown = states if mask is None else np.where(mask, states, np.nan)
    return Series(times, shown, states[0])
