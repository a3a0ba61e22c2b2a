"""What others add to the loss in place of eigenvalues, as terms of the user's own, for comparison (`ablation_peers`).

They are given what SOL is given and no more: the observed states and the initial state, never the truth.

    eigenode train +terms.jac=eigenode_cli.terms.peers:jacobian_norm grads=sol+jac scale.jac=0.01
    eigenode train +terms.match=eigenode_cli.terms.peers:derivative_matching grads=sol
        'stages=[{terms:match,steps:1000},{}]'
"""

from functools import lru_cache

import numpy as np
import torch
from scipy.interpolate import make_interp_spline
from torch import Tensor

from eigenode_cli.arrays import Floats
from eigenode_cli.model import VectorField
from eigenode_cli.spectra.jacobian import jacobian

ORDER = 3
"""Smoothing penalises the third derivative, for accelerations are wanted."""
DEGREE = 5
"""Of the spline through the smoothed values: its second derivative is a cubic spline."""
EDGE = 3
"""Data times at either end that are left out: derivatives of a spline are poor at its ends."""
WEIGHTS = np.logspace(-6.0, 8.0, 141)
"""Smoothing weights to choose from, in units of a penalty whose mean eigenvalue is 1."""


def jacobian_norm(trajectory: Tensor, field: VectorField) -> Tensor:
    """Mean squared Frobenius norm of `A = df/dx` along the trajectory, in 1/s^2.

    Finlay et al., "How to train your neural ODE" (ICML 2020), Equ. 9, which estimates the norm with one random vector
    and weighs it by 0.01; for a handful of states it is computed exactly.
    """
    method = "symbolic" if field.has_symbolic_jacobian else "autodiff"
    return jacobian(field, trajectory, method).square().sum(dim=(-2, -1)).mean()


def derivative_matching(times: Tensor, data: Tensor, field: VectorField) -> Tensor:
    """Mean squared deviation of the field from the derivatives of smoothed data, relative to their mean square.

    Two-stage collocation: Varah (1982); Roesch et al., "Collocation based training of neural ordinary differential
    equations" (2021). No differential equation is solved. Each observed state is smoothed and interpolated by a spline
    (see `smoothed`); a velocity that is not observed is the derivative of its position.

    Raises:
        ValueError: a state is not observed, and no position shows it; or too few data times show it.
    """
    states, rates = _collocation(times.numpy().tobytes(), data.numpy().tobytes(), field.structure == "second_order")
    return (field(states) - rates).square().mean() / rates.square().mean()


@lru_cache(maxsize=32)  # the data stays the same in a training
def _collocation(times: bytes, data: bytes, second_order: bool) -> tuple[Tensor, Tensor]:
    """States and their derivatives `(N - 2 EDGE, n)` at the inner data times."""
    t = np.frombuffer(times)
    seen = np.frombuffer(data).reshape(t.size, -1)
    n = seen.shape[1]
    inner = t[EDGE:-EDGE]
    states, rates = np.empty((2, inner.size, n))
    for i in range(n):
        column, order = (i, 0) if np.isfinite(seen[1:, i]).any() else (i - n // 2, 1)
        if column < 0 or (order == 1 and not second_order):
            raise ValueError(f"derivative matching: nothing shows state {i}; observe it")
        known = np.isfinite(seen[:, column])
        count = int(known.sum())
        if count < 2 * EDGE + DEGREE:
            raise ValueError(f"derivative matching: {count} data times of state {column} are too few for a spline")
        spline = make_interp_spline(t[known], smoothed(t[known], seen[known, column]), k=DEGREE)
        states[:, i], rates[:, i] = spline(inner, order), spline(inner, order + 1)
    return torch.from_numpy(states), torch.from_numpy(rates)


def smoothed(times: Floats, values: Floats) -> Floats:
    """Values `(N,)` at ascending `times (N,)` with their noise smoothed away.

    Minimises `|y - z|^2 + w |D z|^2`, D the divided differences of order `ORDER` (Whittaker 1923); the weight w by
    generalised cross-validation (Craven & Wahba 1979), so that no noise level need be known.
    """
    differences = np.eye(times.size)
    for k in range(1, ORDER + 1):
        differences = np.diff(differences, axis=0) * (k / (times[k:] - times[:-k]))[:, None]
    penalty = differences.T @ differences
    eigenvalues, vectors = np.linalg.eigh(penalty / np.trace(penalty) * times.size)
    rough = WEIGHTS[:, None] * np.maximum(eigenvalues, 0.0)
    removed = rough / (1.0 + rough)  # share of each component that smoothing takes away (W, N)
    components = vectors.T @ values
    scores = ((removed * components) ** 2).sum(axis=1) / removed.sum(axis=1) ** 2
    return vectors @ ((1.0 - removed[np.argmin(scores)]) * components)
