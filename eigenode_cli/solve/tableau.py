"""Explicit Runge-Kutta methods with dense output, as data that both engines read.

Every method here is written with the first-same-as-last property: the last row of `a` is `b`, so the last stage is
the derivative at the end of the step. The fourth-order method of a fixed step gets such a stage for its dense output.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CONSISTENT = 1e-9
"""Largest error in the sum of the weights of a method."""


@dataclass(frozen=True, eq=False)  # one is itself alone: arrays have no hash
class Tableau:
    """One method with s stages.

    Attributes:
        name: as in `solver=`.
        order: order of the solution that is propagated.
        a: stage coefficients `(s, s)`, strictly lower triangular; its last row is the solution's weights b.
        error: weights of the error estimate `(s,)`; all zero for a fixed-step method.
        dense: `x(t + theta h) = x + h sum_i k_i sum_p dense[i, p] theta^(p+1)`, `(s, 4)`.
    """

    name: str
    order: int
    a: NDArray[np.float64]
    error: NDArray[np.float64]
    dense: NDArray[np.float64]

    @property
    def b(self) -> NDArray[np.float64]:
        """Weights of the solution `(s,)`."""
        return self.a[-1]

    @property
    def c(self) -> NDArray[np.float64]:
        """Times of the stages `(s,)`, as fractions of the step."""
        return self.a.sum(axis=1)

    @property
    def adaptive(self) -> bool:
        """Whether the method estimates its error."""
        return bool(np.any(self.error))


def _lower(rows: list[list[float]]) -> NDArray[np.float64]:
    a = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        a[i, : len(row)] = row
    return a


def _hermite(b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cubic through both ends with the derivatives at both ends, as `dense` weights."""
    start, end = np.eye(b.size)[0], np.eye(b.size)[-1]
    return np.stack([start, 3 * b - 2 * start - end, start + end - 2 * b, np.zeros(b.size)], axis=1)


def explicit(
    name: str, order: int, a: Sequence[Sequence[float]], b: Sequence[float], error: Sequence[float] | None = None
) -> Tableau:
    """Return the tableau of an explicit method from its Butcher tableau.

    Where the last row of `a` is not `b`, the derivative at the end of the step is added as a further stage. Between
    steps the solution is the cubic through both ends with the derivatives there: of third order.

    Args:
        name: of the method.
        order: of the solution.
        a: rows of the strictly lower triangle, the first one empty.
        b: weights of the solution `(s,)`.
        error: `b` minus the weights of the embedded method `(s,)`; None for a method of fixed steps.

    Raises:
        ValueError: rows are missing or too long, or the weights do not add up to 1 (of `error` to 0).
    """
    stages = len(b)
    if len(a) != stages or any(len(row) > i for i, row in enumerate(a)):
        raise ValueError(f"{name}: {stages} weights need {stages} rows of a, row i with at most i coefficients")
    if abs(sum(b) - 1.0) > CONSISTENT or abs(sum(error or ())) > CONSISTENT:
        raise ValueError(f"{name}: the weights of the solution must add up to 1, those of the error to 0")
    last = [*a[-1], *[0.0] * (stages - len(a[-1]))]
    same = b[-1] == 0.0 and list(b) == last
    rows = [list(row) for row in a] + ([] if same else [list(b)])
    matrix = _lower(rows)
    weights = np.zeros(len(rows))
    weights[:stages] = [0.0] * stages if error is None else list(error)
    return Tableau(name=name, order=order, a=matrix, error=weights, dense=_hermite(matrix[-1]))


# Ch. Tsitouras, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying assumption,
# Computers & Mathematics with Applications 62 (2011) 770-775, Table 1 and Sec. 4 (the interpolant).
# The published digits leave up to 1.3e-14 in the order conditions. The weights b are therefore the solution of the five
# quadrature conditions at the published nodes, rounded once, and the last column of `dense` closes each row onto b:
# both within 1e-13 of the published values.
TSIT5 = Tableau(
    name="tsit5",
    order=5,
    a=_lower(
        [
            [],
            [0.161],
            [-0.008480655492356989, 0.335480655492357],
            [2.8971530571054935, -6.359448489975075, 4.3622954328695815],
            [5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525],
            [5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383],
            [
                0.09646076681806523,
                0.01,
                0.4798896504144996,
                1.3790085741037321,
                -3.290069515436154,
                2.324710524099857,
            ],
        ]
    ),
    error=np.array(
        [
            -0.00178001105222577714,
            -0.0008164344596567469,
            0.007880878010261995,
            -0.1447110071732629,
            0.5823571654525552,
            -0.45808210592918697,
            0.015151515151515152,
        ]
    ),
    dense=np.array(
        [
            [1.0, -2.763706197274826, 2.9132554618219126, -1.0530884977290216],
            [0.0, 0.13169999999999998, -0.2234, 0.1017],
            [0.0, 3.9302962368947516, -5.941033872131505, 2.490627285651253],
            [0.0, -12.411077166933676, 30.33818863028232, -16.548102889244912],
            [0.0, 37.50931341651104, -88.1789048947664, 47.37952196281921],
            [0.0, -27.896526289197286, 65.09189467479366, -34.87065786149652],
            [0.0, 1.5, -4.0, 2.5],
        ]
    ),
)

# J. R. Dormand, P. J. Prince, A family of embedded Runge-Kutta formulae, J. Comput. Appl. Math. 6 (1980) 19-26.
_DOPRI5_A = _lower(
    [
        [],
        [1 / 5],
        [3 / 40, 9 / 40],
        [44 / 45, -56 / 15, 32 / 9],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
# The midpoint weights of L. F. Shampine, Some practical Runge-Kutta formulas, Math. Comp. 46 (1986) 135-150.
_DOPRI5_MIDPOINT = 0.5 * np.array(
    [
        6025192743 / 30085553152,
        0.0,
        51252292925 / 65400821598,
        -2691868925 / 45128329728,
        187940372067 / 1594534317056,
        -1776094331 / 19743644256,
        11237099 / 235043384,
    ]
)


def _quartic(b: NDArray[np.float64], midpoint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quartic through both ends and the midpoint with the derivatives at both ends, as `dense` weights."""
    start, end = np.eye(b.size)[0], np.eye(b.size)[-1]
    square = end - 4 * start - 5 * b + 16 * midpoint
    cube = 5 * start - 3 * end + 14 * b - 32 * midpoint
    fourth = 2 * (end - start) - 8 * b + 16 * midpoint
    return np.stack([start, square, cube, fourth], axis=1)


DOPRI5 = Tableau(
    name="dopri5",
    order=5,
    a=_DOPRI5_A,
    error=_DOPRI5_A[-1] - np.array([1951 / 21600, 0.0, 22642 / 50085, 451 / 720, -12231 / 42400, 649 / 6300, 1 / 60]),
    dense=_quartic(_DOPRI5_A[-1], _DOPRI5_MIDPOINT),
)

# W. Kutta, Z. Math. Phys. 46 (1901) 435-453, the 3/8 rule (which torchdiffeq's `rk4` is too), with the derivative at
# the end as a fifth stage for the dense output.
_RK4_A = _lower([[], [1 / 3], [-1 / 3, 1.0], [1.0, -1.0, 1.0], [1 / 8, 3 / 8, 3 / 8, 1 / 8]])

RK4 = Tableau(name="rk4", order=4, a=_RK4_A, error=np.zeros(5), dense=_hermite(_RK4_A[-1]))

# P. Bogacki, L. F. Shampine, A 3(2) pair of Runge-Kutta formulas, Appl. Math. Lett. 2 (1989) 321-325.
BOSH3 = explicit(
    "bosh3",
    3,
    [[], [1 / 2], [0.0, 3 / 4], [2 / 9, 1 / 3, 4 / 9]],
    [2 / 9, 1 / 3, 4 / 9, 0.0],
    [2 / 9 - 7 / 24, 1 / 3 - 1 / 4, 4 / 9 - 1 / 3, -1 / 8],
)

# Heun's method with Euler's for the error: E. Hairer, S. P. Norsett, G. Wanner, Solving ODEs I, 2nd ed., Sec. II.4.
ADAPTIVE_HEUN = explicit("adaptive_heun", 2, [[], [1.0]], [1 / 2, 1 / 2], [-1 / 2, 1 / 2])

TABLEAUS: dict[str, Tableau] = {tableau.name: tableau for tableau in (TSIT5, DOPRI5, BOSH3, ADAPTIVE_HEUN, RK4)}
"""The methods that the compiled engine knows."""
