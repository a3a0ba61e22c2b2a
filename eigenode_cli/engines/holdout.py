"""How well a model predicts what training did not see."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.channels import shown_channels
from eigenode_cli.model import VectorField


@dataclass(frozen=True)
class Part:
    """One trajectory of which some rows are held out.

    Attributes:
        series: all of its rows, in internal units.
        trained: number of leading rows that training sees.
        engine: solves the model from the trajectory's initial state, with its inputs.
        own: picks the parameters of this trajectory out of all `(P,)`.
        offsets: the trained offsets of its channels `(C,)`, out of all parameters.
    """

    series: Series
    trained: int
    engine: Engine
    own: Callable[[Floats], Floats]
    offsets: Callable[[Floats], Floats]


class Holdout:
    """Predictions of all trajectories, and their error where data were held out.

    Args:
        field: the vector field.
        parts: the trajectories.
    """

    def __init__(self, field: VectorField, parts: Sequence[Part]) -> None:
        self._field, self.parts = field, tuple(parts)
        channels = [part.series.channels for part in parts]
        moduli = np.concatenate([np.abs(one) for one in channels])
        moduli[~np.isfinite(moduli)] = 0.0
        size = moduli.max(axis=0)
        self._sizes = np.where(size > 0.0, size, 1.0)

    @property
    def held_out(self) -> bool:
        """Whether there is anything to predict."""
        return any(part.trained < part.series.times.size for part in self.parts)

    def predictions(self, theta: Floats) -> list[Floats]:
        """Return what the model says of the channels of each trajectory `(N, C)` at the parameters `theta (P,)`."""
        return [
            shown_channels(
                self._field,
                part.series,
                part.engine.evaluate(part.own(theta), part.series.times).dense,
                part.offsets(theta),
                theta,
            )
            for part in self.parts
        ]

    def error(self, theta: Floats) -> float:
        """Return the root mean square error over all that was held out; see `error_of`."""
        return self.error_of(self.predictions(theta))

    def error_of(self, predictions: Sequence[Floats]) -> float:
        """Return the root mean square over the held-out channels, each in units of its largest modulus.

        Infinite where a prediction does not reach all that was held out, NaN where nothing was.
        """
        squares = []
        for part, shown in zip(self.parts, predictions, strict=True):
            rest = slice(part.trained, None)
            seen = part.series.channel_mask[rest]
            wrong = ((shown[rest] - part.series.channels[rest]) / self._sizes)[seen]
            squares.append(wrong**2)
        every = np.concatenate(squares)
        if not every.size:
            return float("nan")
        return float(np.sqrt(every.mean())) if np.isfinite(every).all() else float("inf")
