"""Which eigenvalue is which from one time to the next, and which one a target belongs to."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eigenode_cli.arrays import Complexes
from eigenode_cli.spectra.pairs import UNMATCHED

Indices = NDArray[np.int64]

TIE = 1e-9
"""Weight of the canonical order in the cost of an assignment: it settles ties and nothing else."""


def track(spectra: Complexes, vectors: Complexes, prediction: Complexes | None = None) -> Indices:
    """Order `(N, n)` such that `spectra[t, order[t, k]]` is the same mode k at all times t.

    Neighbouring times are joined by the assignment of smallest total cost: distance of the eigenvalues, relative to
    the largest modulus of both spectra, plus 1 - MAC (modal assurance criterion) of the eigenvectors, which is 0 for
    parallel and 1 for orthogonal ones. Modes are numbered as they stand in canonical order (see `canonical_order`) at
    the first time that has a spectrum, so that nothing depends on the order of the input. Where a pair splits into
    real eigenvalues or forms from them the cost cannot tell the two members apart; they take canonical order then.

    Args:
        spectra: eigenvalues `(N, n)` in 1/s. A row with NaN, in values or vectors, keeps the identity order, and the
            rows around it are joined across it.
        vectors: right eigenvectors `(N, n, n)`, one a column, of any norm and phase.
        prediction: where each eigenvalue of row t is expected in row t + 1 `(N - 1, n)`, as from `predict`; without
            it, or where it is NaN, where it is now.
    """
    count, n = spectra.shape
    order = np.tile(np.arange(n), (count, 1))
    usable = np.flatnonzero(np.isfinite(spectra).all(1) & np.isfinite(vectors).all((1, 2)))
    if usable.size == 0:
        return order
    order[usable[0]] = canonical_order(spectra[usable[0]])
    for before, now in pairwise(usable):
        expected = spectra[before]
        if prediction is not None and now == before + 1:
            expected = np.where(np.isfinite(prediction[before]), prediction[before], expected)
        cost = _distances(expected, spectra[now]) / _size(spectra[before], spectra[now])
        cost += 1.0 - _mac(vectors[before], vectors[now])
        order[now] = _follow(cost[order[before]], canonical_order(spectra[now]))
    return order


def predict(
    matrices: Complexes | NDArray[np.float64], spectra: Complexes, vectors: Complexes, left: Complexes
) -> Complexes:
    """First-order prediction of the next spectrum `(N - 1, n)`: `lambda_i + w_i^H dA v_i / (w_i^H v_i)`.

    NaN where a defective matrix has no first order.

    Args:
        matrices: A at each time `(N, n, n)` in 1/s; dA is the difference to the next.
        spectra: their eigenvalues `(N, n)` in 1/s.
        vectors: right eigenvectors `(N, n, n)`, one a column.
        left: left eigenvectors `(N, n, n)`, one a column.
    """
    step = np.diff(matrices, axis=0)
    overlap = (left[:-1].conj() * vectors[:-1]).sum(1)
    change = (left[:-1].conj() * (step @ vectors[:-1])).sum(1)
    slope = np.full_like(change, np.nan)
    np.divide(change, overlap, out=slope, where=np.abs(overlap) > np.finfo(np.float64).eps)
    return spectra[:-1] + slope


def assign(spectrum: Complexes, target: Complexes) -> Indices:
    """Index `(K,)` of the eigenvalue that each target belongs to, with the smallest sum of distances.

    Args:
        spectrum: eigenvalues `(n,)` in 1/s; one that is NaN is given to no target.
        target: targets `(K,)` in 1/s; one that is NaN gets `UNMATCHED`, and so do the farthest if there are more
            targets than eigenvalues.
    """
    match = np.full(target.size, UNMATCHED, dtype=np.int64)
    wanted = np.flatnonzero(np.isfinite(target))
    present = np.flatnonzero(np.isfinite(spectrum))
    rows, columns = linear_sum_assignment(_distances(target[wanted], spectrum[present]))
    match[wanted[rows]] = present[columns]
    return match


def canonical_order(spectrum: Complexes) -> Indices:
    """Order `(n,)` of a spectrum by frequency, then real part from the right, upper member of a pair first."""
    return np.lexsort((-spectrum.imag, -spectrum.real, np.abs(spectrum.imag)))


def _follow(cost: NDArray[np.float64], canonical: Indices) -> Indices:
    """Eigenvalue `(n,)` of each mode for the costs `(n modes, n eigenvalues)`."""
    n = canonical.size
    rank = np.empty(n, dtype=np.int64)
    rank[canonical] = np.arange(n)
    tie = TIE * ((np.arange(n)[:, None] - rank[None, :]) / n) ** 2
    return linear_sum_assignment(cost + tie)[1]


def _distances(a: Complexes, b: Complexes) -> NDArray[np.float64]:
    return np.abs(a[:, None] - b[None, :])


def _size(a: Complexes, b: Complexes) -> float:
    """Largest modulus of two spectra, 1 where all is zero."""
    return max(float(np.abs(a).max()), float(np.abs(b).max())) or 1.0


def _mac(a: Complexes, b: Complexes) -> NDArray[np.float64]:
    """Modal assurance criterion `|a_i^H b_j|^2 / (|a_i|^2 |b_j|^2)` of the columns `(n, n)`."""
    norms = np.linalg.norm(a, axis=0)[:, None] * np.linalg.norm(b, axis=0)[None, :]
    return (np.abs(a.conj().T @ b) / norms) ** 2
