"""Who keeps the arrays alive that kernels hold the addresses of."""

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.engines.compiled.memory import address, aligned


class Owner:
    """Keeps arrays alive whose addresses kernels hold."""

    def __init__(self) -> None:
        self._arrays: list[NDArray] = []

    def keep(self, array: NDArray) -> int:
        """Address of a contiguous array, kept alive with this owner."""
        self._arrays.append(array)
        return address(array)

    def copy(self, values: NDArray, dtype: type) -> int:
        """Address of a contiguous copy as `dtype`."""
        return self.keep(np.array(values, dtype=dtype, order="C"))

    def floats(self, *shape: int) -> int:
        """Address of float64 zeros, at a cache line."""
        return self.keep(aligned(int(np.prod(shape))))

    def zeros(self, size: int, dtype: type) -> int:
        """Address of `size` zeros of `dtype`."""
        return self.keep(np.zeros(size, dtype=dtype))
