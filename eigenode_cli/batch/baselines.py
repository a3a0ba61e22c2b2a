"""What simple models make of the same data: whether a network was worth it.

`linear`: the best linear system of the same order, trained on the same data with the same terms, targets and start.
`repetition`: the last period of the training is repeated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.config.prediction import holdout_of
from eigenode_cli.config.setup import Setup, initial_linear
from eigenode_cli.data.reconstruct import reconstruct
from eigenode_cli.data.spectrum import dominant_frequency
from eigenode_cli.engines.holdout import Holdout, Part
from eigenode_cli.fitting import fit
from eigenode_cli.model import Mlp, VectorField
from eigenode_cli.terms import NAMES

LINEAR, REPETITION = "linear", "repetition"


@dataclass(frozen=True)
class Baseline:
    """A simple model.

    Attributes:
        predictions: channels of each trajectory `(N, C)` in internal units; NaN where it says nothing.
        error: over what was held out, see `Holdout.error_of`; NaN where it says nothing of it.
    """

    predictions: Sequence[Floats]
    error: float


def baselines(setup: Setup, holdout: Holdout) -> dict[str, Baseline]:
    """Return the baselines of a run on measured data, by name."""
    found = {LINEAR: _linear(setup), REPETITION: _repetition(setup, holdout)}
    return {name: baseline for name, baseline in found.items() if baseline is not None}


def summary(found: Mapping[str, Baseline]) -> dict[str, float | None]:
    """Return the errors by name, None where a baseline says nothing."""
    return {name: None if np.isnan(baseline.error) else baseline.error for name, baseline in found.items()}


def _linear(setup: Setup) -> Baseline | None:
    """Train an affine field; None where it cannot be built."""
    structure, dataset = setup.config.network.structure, setup.dataset
    estimate = reconstruct(dataset.series[0], structure)
    matrix = initial_linear(setup.config, setup.problem, estimate)
    n, k = setup.problem.data.states, setup.problem.data.inputs
    network = Mlp(n + k, (), n // 2 if structure == "second_order" else n)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        if matrix is not None:
            next(network.parameters())[:] = torch.from_numpy(matrix)
    field = VectorField(network, structure, inputs=k)
    terms = [term for term in setup.problem.terms if term in NAMES]
    scales = {name: float(setup.config.scale[name]) for name in terms}
    found = fit(field, dataset, setup.target, terms, scales, solver=setup.problem.solver, at=setup.config.target.at)
    holdout = holdout_of(setup, field)
    if holdout is None:
        return None
    predictions = holdout.predictions(found.theta)
    return Baseline(predictions, holdout.error_of(predictions))


def _repetition(setup: Setup, holdout: Holdout) -> Baseline:
    """Repeat the last period of each trajectory that training sees the beginning of."""
    stated = setup.problem.targets.frequency
    known = stated[np.isfinite(stated)]
    predictions = [_repeated(part, float(known.min()) if known.size else None) for part in holdout.parts]
    error = holdout.error_of(predictions)
    return Baseline(predictions, float("nan") if np.isinf(error) else error)


def _repeated(part: Part, frequency: float | None) -> Floats:
    """Return what was measured up to the end of the training, and its last period over and over behind it."""
    series, shown = part.series, part.series.channels.copy()
    shown[part.trained :] = np.nan
    if part.trained == 0:
        return shown
    seen, later = series.times[: part.trained], series.times[part.trained :]
    for channel in range(shown.shape[1]):
        known = np.isfinite(shown[: part.trained, channel])
        if known.sum() < 2:
            continue
        signal = shown[: part.trained, channel][known]
        hertz = frequency or dominant_frequency(seen[known], signal)
        if hertz is None:
            continue
        period = min(1.0 / hertz, float(seen[-1] - seen[0]))
        back = np.ceil((later - seen[-1]) / period) * period
        shown[part.trained :, channel] = np.interp(later - back, seen[known], signal)
    return shown
