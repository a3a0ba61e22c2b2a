"""Where trajectories of a trained model go: many initial states on a grid, each simulated and told by its end.

What a training has not shown, another start may: a second equilibrium, a limit cycle, or states that run away.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
import pandas as pd

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import targets_of_spectra
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import REACH, Problem
from eigenode_cli.model import flat_parameters
from eigenode_cli.recorded import RecordedRun
from eigenode_cli.solve.drive import Drive
from eigenode_cli.solve.settings import TIGHT

RESTS, MOVES, LEAVES = "rests", "moves", "leaves"
"""How a trajectory ends: it hardly moves any more, it goes on within reach, it runs away or cannot be solved."""
STILL = 0.01
"""Share of the model's range of each state within which a state that rests stays over the last quarter of the time."""
WIDER = 1.5
"""The grid reaches so far from the middle of the model's trajectory, in half ranges of it."""
OUTPUTS = 201


@dataclass(frozen=True)
class Basins:
    """A map over initial states.

    Attributes:
        axes: names of the two states that vary.
        table: one row for each initial state: the two values, `end`, `size` (the largest distance of a state from the
            middle over the last quarter of the time, in half ranges; infinite for one that leaves), and the last state
            that was reached.
        trajectory: the model's own, in these two states `(D, 2)`.
    """

    axes: tuple[str, str]
    table: pd.DataFrame
    trajectory: Floats

    @property
    def counts(self) -> dict[str, int]:
        """How many trajectories end in which way."""
        return {end: int((self.table["end"].to_numpy() == end).sum()) for end in (RESTS, MOVES, LEAVES)}


def basins(run: RecordedRun, count: int = 15, horizon: float | None = None) -> Basins:
    """Simulate a model without inputs from a grid of initial states, in the user's units.

    A position and its velocity vary, or the first two states of the structure `full`; further states start in the
    middle of the model's own trajectory.

    Args:
        run: whose model is looked at.
        count: grid points of each of the two states.
        horizon: time in s, by default that of solution.csv: twice that of the training.

    Raises:
        ValueError: the model has one state only, or its own trajectory was not solved.
    """
    n = len(run.states)
    if n < 2:
        raise ValueError("a map needs two states, this model has one")
    own = run.solution[[f"model_{name}" for name in run.states]].to_numpy(dtype=np.float64)
    own = own[np.isfinite(own).all(axis=1)]
    if len(own) < 2:
        raise ValueError("the model's own trajectory could not be solved, so that there is no range for a map")
    times = run.solution["t"].to_numpy(dtype=np.float64)
    times = np.linspace(0.0, float(times[-1] - times[0]) if horizon is None else horizon, OUTPUTS)
    pair = (0, n // 2) if run.config.network.structure == "second_order" else (0, 1)
    low, high = own.min(axis=0), own.max(axis=0)
    middle, half = 0.5 * (low + high), np.where(high > low, 0.5 * (high - low), 1.0)
    starts = _grid(middle, half, pair, count)
    ends = [_simulated(run, start, times, middle, half) for start in starts]
    table = pd.DataFrame(
        {
            **{run.states[i]: starts[:, i] for i in pair},
            "end": [end for end, _, _ in ends],
            "size": [size for _, size, _ in ends],
            **{f"end_{name}": [float(last[i]) for *_, last in ends] for i, name in enumerate(run.states)},
        }
    )
    return Basins((run.states[pair[0]], run.states[pair[1]]), table, own[:, pair])


def _grid(middle: Floats, half: Floats, pair: tuple[int, int], count: int) -> Floats:
    """Return initial states `(count^2, n)`."""
    across, along = (np.linspace(-WIDER, WIDER, count) * half[i] + middle[i] for i in pair)
    starts = np.tile(middle, (count**2, 1))
    starts[:, pair[0]], starts[:, pair[1]] = (grid.ravel() for grid in np.meshgrid(across, along))
    return starts


def _simulated(
    run: RecordedRun, start: Floats, times: Floats, middle: Floats, half: Floats
) -> tuple[str, float, Floats]:
    """Return how the trajectory from a state `(n,)` ends, its size there, and its last state `(n,)`."""
    field, scaling = run.internal_field, run.scaling
    initial = start / scaling.states
    still = Drive(np.array([0.0, times[-1] / scaling.time]), np.zeros((2, field.inputs))) if field.inputs else None
    series = Series(np.zeros(1), initial[None], initial, drive=still)
    targets = targets_of_spectra(np.zeros((1, initial.size), dtype=np.complex128))
    problem = Problem(series, targets, terms=("sol",), solver=TIGHT, stabilise=False)
    found = build_engine(field, problem).evaluate(flat_parameters(field), times / scaling.time).dense * scaling.states
    reached = np.isfinite(found).all(axis=1) & (np.abs(found) <= REACH * (np.abs(start) + half)).all(axis=1)
    count = int(reached.size if reached.all() else np.argmin(reached))
    if count < reached.size:
        return LEAVES, float("inf"), cast(Floats, found[max(0, count - 1)])
    last = found[-OUTPUTS // 4 :]
    rests = (np.ptp(last, axis=0) <= 2.0 * STILL * half).all()
    return (RESTS if rests else MOVES), float((np.abs(last - middle) / half).max()), found[-1]
