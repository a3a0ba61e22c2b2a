"""A user's own term on arrays, as the compiled engine takes it."""

from collections.abc import Callable
from dataclasses import dataclass

from eigenode_cli.arrays import Complexes, Floats


@dataclass(frozen=True)
class ArrayTerm:
    """A user's own term on arrays, with its derivatives, as the compiled engine takes it.

    Attributes:
        function: `(theta (P,), trajectory (N, n), spectra (T, n))` to value, `dl/dx (N, n)`, `dl/dRe + i dl/dIm
            (T, n)`, and the derivative in theta at constant trajectory and spectra `(P,)`, 0 where it has none.
        needs_solve: whether it looks at trajectory or spectra, so that it is undefined where a solve fails.
    """

    function: Callable[[Floats, Floats, Complexes], tuple[float, Floats, Complexes, Floats | float]]
    needs_solve: bool = True
