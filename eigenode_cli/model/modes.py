"""Initial values of the linear part: a system with the stated modes, or the least-squares fit of the measurements.

One degree of freedom has the matrix of its pair exactly: `x'' = -|lambda|^2 x + 2 Re(lambda) x'`. Several need the
shapes of the modes, which come from a linear fit of the measured rates: `A = V L V^-1` has the eigenvectors V of the
fit and the stated eigenvalues L in place of those of its own that lie closest (the paper's solvable initialisation asks
for eigenvalues alone).
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.data.reconstruct import Estimate
from eigenode_cli.data.targets import Targets
from eigenode_cli.spectra.pairs import target_eigenvalue

SPREAD = 0.2
"""Largest distance of a pair from its median, relative to its modulus, for it to be one of a linear system."""
LEADING = 0.25
"""Share of the record that a linear fit sees: a nonlinear system is nearly linear over a short time at best."""
FEWEST = 4
"""Least number of rows of that fit in numbers of states."""


def stated_pairs(targets: Targets) -> Complexes:
    """Return the upper members of the pairs that targets state `(K,)` in 1/s, their medians over the spectra.

    Only a pair that is there at every spectrum and stays about the same counts: one that comes and goes, or moves
    through the plane along the trajectory, belongs to no linear system.
    """
    count = int(targets.pairs.min(initial=0 if targets.pairs.size == 0 else targets.pairs.max()))
    pairs = []
    for k in range(count):
        along = [target_eigenvalue(f, z) for f, z in zip(targets.frequency[:, k], targets.damping[:, k], strict=True)]
        middle = complex(np.median(np.real(along)), np.median(np.imag(along)))
        if np.abs(np.array(along) - middle).max() <= SPREAD * abs(middle):
            pairs.append(middle)
    return np.array(pairs, dtype=np.complex128)


def modal_matrix(pairs: Complexes, estimate: Estimate, structure: str) -> Floats:
    """Return a linear part `(m, n)` that has the pairs `(K,)` of upper eigenvalues in 1/s; zeros where there are none.

    Args:
        pairs: stated.
        estimate: of the states and their rates at the data times, for shapes of several modes.
        structure: of the vector field.

    Raises:
        ValueError: there are more pairs than the states have room for.
    """
    n = estimate.states.shape[1]
    m = n // 2 if structure == "second_order" else n
    if 2 * pairs.size > n:
        raise ValueError(f"{pairs.size} pairs do not fit into {n} states")
    if pairs.size == 0:
        return np.zeros((m, n))
    if structure == "second_order" and n == 2:
        return np.array([[-(abs(pairs[0]) ** 2), 2.0 * pairs[0].real]])
    fitted = _whole(fitted_matrix(estimate, structure), n)
    values, vectors = np.linalg.eig(fitted)
    wanted = np.concatenate([pairs, pairs.conj()])
    own, stated = linear_sum_assignment(np.abs(values[:, None] - wanted[None, :]))
    values = values.astype(np.complex128)
    values[own] = wanted[stated]
    if structure == "second_order":  # the lower half of a vector is the rate of the upper one
        vectors = np.vstack([vectors[: n // 2], vectors[: n // 2] * values])
    if np.linalg.cond(vectors) > 1e8 or not np.allclose(_conjugates(values, vectors), 0.0, atol=1e-6):
        return _blocks(pairs, n, structure)
    return (vectors @ np.diag(values) @ np.linalg.inv(vectors)).real[n - m :]


def with_inputs(matrix: Floats, estimate: Estimate, driven: Floats) -> Floats:
    """Return a linear part `(m, n)` with a column for each input `(m, n + k)`, fitted to what it leaves of the rates.

    Args:
        matrix: of the states.
        estimate: of the states and their rates at the data times.
        driven: inputs there `(N, k)`.
    """
    if driven.shape[1] == 0:
        return matrix
    m = matrix.shape[0]
    left = (estimate.rates - _rates_of(matrix, estimate.states))[:, -m:]
    known = np.isfinite(left).all(axis=1)
    if not known.any():
        return np.hstack([matrix, np.zeros((m, driven.shape[1]))])
    fitted = np.linalg.lstsq(driven[known], left[known], rcond=1e-8)[0].T
    return np.hstack([matrix, fitted]).astype(np.float64)


def _rates_of(matrix: Floats, states: Floats) -> Floats:
    """Return the rates `(N, n)` that a linear part gives; those of positions stay zero."""
    rates = np.zeros_like(states)
    rates[:, -matrix.shape[0] :] = states @ matrix.T
    return rates


def fitted_matrix(estimate: Estimate, structure: str, driven: Floats | None = None) -> Floats:
    """Return the linear part `(m, n + k)` that fits the rates to states and inputs over the first part of the record.

    Args:
        estimate: of the states and their rates at the data times.
        structure: of the vector field.
        driven: inputs there `(N, k)`, None where there are none.
    """
    states, rates = estimate.states, estimate.rates
    n = states.shape[1]
    m = n // 2 if structure == "second_order" else n
    arguments = states if driven is None else np.hstack([states, driven])
    count = min(len(states), max(FEWEST * n, int(np.ceil(LEADING * len(states)))))
    known = np.isfinite(states[:count]).all(axis=1) & np.isfinite(rates[:count]).all(axis=1)
    if not known.any():
        return np.zeros((m, arguments.shape[1]))
    found = np.linalg.lstsq(arguments[:count][known], rates[:count][known][:, n - m :], rcond=1e-8)[0].T
    return found.astype(np.float64)


def _whole(rows: Floats, n: int) -> Floats:
    """Return `A (n, n)` with the last rows given."""
    lead = n - len(rows)
    return np.vstack([np.eye(n)[n - lead :], rows]) if lead else rows


def _conjugates(values: Complexes, vectors: Complexes) -> Floats:
    """Return the imaginary part of `V L V^-1` relative to its size: zero where pairs stayed pairs."""
    matrix = vectors @ np.diag(values) @ np.linalg.inv(vectors)
    return matrix.imag / max(1e-300, np.abs(matrix).max())


def _blocks(pairs: Complexes, n: int, structure: str) -> Floats:
    """Return a matrix of uncoupled modes, where the fit gives no shapes."""
    matrix = np.zeros((n, n))
    if structure == "second_order":
        for k, pair in enumerate(pairs):
            matrix[n // 2 + k, k], matrix[n // 2 + k, n // 2 + k] = -(abs(pair) ** 2), 2.0 * pair.real
        return matrix[n // 2 :]
    for k, pair in enumerate(pairs):
        block = [[pair.real, pair.imag], [-pair.imag, pair.real]]
        matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return matrix
