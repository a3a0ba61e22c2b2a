"""Rosenbrock methods as data that both engines read: linearly implicit, for stiff fields.

With the Jacobian J at the start of a step, `M = I / gamma - h J`, the solutions k of

    M k_i = f(t + nodes_i h, x + h sum_j a_ij k_j) + sum_j c_ij k_j + h drift_i df/dt

give the state at the end, `x + h sum_j end_j k_j`: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II,
2nd ed., Sec. IV.7, Eq. (7.25) with `k = u / h`. Nothing is iterated, and there is one factorisation a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eigenode_cli.arrays import Floats


@dataclass(frozen=True, eq=False)  # one is itself alone: arrays have no hash
class RosenbrockTableau:
    """One method with s stages.

    Attributes:
        name: as in `solver=`.
        order: that of step-size control, one above that of the error estimate.
        gamma: of M.
        a, c: stage coefficients `(s, s)`, strictly lower triangular.
        nodes: times of the stages as fractions of the step, and `drift` the weights of `df/dt`, both `(s,)`.
        end, error: weights of the solution and of its error `(s,)`.
        dense: `x(t + theta h) = x + h sum_i k_i sum_p dense[i, p] theta^(p+1)`, `(s, 4)`.
    """

    name: str
    order: int
    gamma: float
    a: Floats
    c: Floats
    nodes: Floats
    drift: Floats
    end: Floats
    error: Floats
    dense: Floats


def _lower(rows: Sequence[Sequence[float]]) -> Floats:
    matrix = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


_A = (
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946),
)
_C = (
    (),
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
    (
        30.91273214028599,
        -3.1208243349937974,
        77.79954646070892,
        34.28646028294783,
        -19.097331116725623,
        -28.087943162872662,
    ),
    (
        37.80277123390563,
        -3.2571969029072276,
        112.26918849496327,
        66.9347231244047,
        -40.06618937091002,
        -54.66780262877968,
        -9.48861652309627,
    ),
)
_NODES = (0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0)
_DRIFT = (
    0.21193756319429014,
    -0.42387512638858027,
    -0.3384627126235924,
    1.8046452872882734,
    2.325825639765069,
    0.0,
    0.0,
    0.0,
)
_DENSE: Floats = np.array(
    [
        [
            25.948786856663858,
            -2.5579724845846235,
            10.433815404888879,
            -2.3679251022685204,
            0.524948541321073,
            1.1241088310450404,
            0.4272876194431874,
            -0.17202221070155493,
        ],
        [
            -9.91568850695171,
            -0.9689944594115154,
            3.0438037242978453,
            -24.495224566215796,
            20.176138334709044,
            15.98066361424651,
            -6.789040303419874,
            -6.710236069923372,
        ],
        [
            11.419903575922262,
            2.8879645146136994,
            72.92137995996029,
            80.12511834622643,
            -52.072871366152654,
            -59.78993625266729,
            -0.15582684282751913,
            4.883087185713722,
        ],
    ]
)


def _rodas5p() -> RosenbrockTableau:
    """Order 5, stiffly accurate, L-stable, dense output of order 4.

    G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia
    Differential Equations package, BIT Numer. Math. 63 (2023) 27, https://doi.org/10.1007/s10543-023-00967-x. The
    seventh and the eighth stage, and the end, each add the solution of the stage before.
    """
    seventh = [*_A[5], 1.0]
    eighth = [*seventh, 1.0]
    end = np.array([*eighth, 1.0])
    first, second, third = _DENSE
    return RosenbrockTableau(
        name="rodas5p",
        order=5,
        gamma=0.21193756319429014,
        a=_lower([*_A, seventh, eighth]),
        c=_lower(_C),
        nodes=np.array(_NODES),
        drift=np.array(_DRIFT),
        end=end,
        error=np.eye(8)[7],
        dense=np.stack([end + first, second - first, third - second, -third], axis=1),
    )


def _rosenbrock23() -> RosenbrockTableau:
    """Order 2 with an error estimate of third order, L-stable, dense output of order 2.

    L. F. Shampine, M. W. Reichelt, The MATLAB ODE suite, SIAM J. Sci. Comput. 18 (1997) 1-22, `ode23s`,
    https://doi.org/10.1137/S1064827594276424. Its stages are combined so that M stands on the left only: with theirs,
    `k_1`, `d (k_2 - k_1)` and `d (k_3 - (6 + sqrt 2) (k_2 - k_1) - 2 k_1)`, the first one times d.
    """
    d = 1.0 / (2.0 + 2.0**0.5)
    e = 6.0 + 2.0**0.5
    slope, bend = np.array([1.0 - 2.0 * d, -2.0 * d, 0.0]), np.array([0.0, 1.0, 0.0])
    return RosenbrockTableau(
        name="rosenbrock23",
        order=3,
        gamma=d,
        a=_lower([[], [0.5 / d], [1.0 / d, 1.0 / d]]),
        c=_lower([[], [-1.0 / d], [-2.0 / d, -e / d]]),
        nodes=np.array([0.0, 0.5, 1.0]),
        drift=np.array([d, 0.0, -d]),
        end=np.array([1.0, 1.0, 0.0]) / d,
        error=np.array([1.0, e - 2.0, 1.0]) / (6.0 * d),
        dense=np.stack([slope, bend, np.zeros(3), np.zeros(3)], axis=1) / (d * (1.0 - 2.0 * d)),
    )


ROSENBROCK = {tableau.name: tableau for tableau in (_rodas5p(), _rosenbrock23())}
"""The methods by the name that `solver=` takes."""
