"""Where a training stands, and a copy of all that the rest of it depends on."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.console import duration


@dataclass
class Progress:
    """Where a training stands, besides its parameters and the optimizer's state."""

    step: int = 0
    train_seconds: float = 0.0
    unsolvable_steps: int = 0
    """Steps whose solve failed."""
    unsolvable_since: int | None = None
    """First step of the failures that go on now, None while solves succeed."""
    guard_count: int = 0
    """Eigenvalue sensitivities that the condition guard has bounded so far."""
    wall_seconds: float = 0.0
    """Time since the start of the run, without the time that it lay interrupted."""
    first_sol: float | None = None
    """SOL before the first step, None where that solve failed."""
    converged_at: int | None = None
    """Step from which on nothing changes since the terms have no lower point, None while something does."""
    best_step: int | None = None
    """Step of the record with the lowest sum of the scaled terms, None before there is one."""
    best_total: float | None = None
    """That sum."""
    records_since_best: int = 0
    """Records since then."""
    ended: tuple[str, str] | None = None
    """Status and reason of a training that ended before its last step."""


@dataclass(frozen=True)
class Snapshot:
    """A copy of everything that the rest of a training depends on, taken between two steps.

    Attributes:
        progress: where the training stands.
        theta: parameters `(P,)`.
        optimizer: the optimizer's state by name.
        random_state: of torch: a user's term may draw.
        best: parameters of the best record `(P,)`, never changed in place; None before there is one.
    """

    progress: Progress
    theta: Floats
    optimizer: dict[str, Floats]
    random_state: torch.Tensor
    best: Floats | None

    @classmethod
    def take(cls, progress: Progress, theta: Floats, optimizer: dict[str, Floats], best: Floats | None) -> "Snapshot":
        """Return a copy of these and of torch's random state."""
        arrays = {name: array.copy() for name, array in optimizer.items()}
        return cls(replace(progress), theta.copy(), arrays, torch.get_rng_state(), best)

    def restore(self, theta: Floats, optimizer: dict[str, Floats]) -> None:
        """Put the copy back: into these arrays, and into torch's random state."""
        theta[:] = self.theta
        for name, array in optimizer.items():
            array[:] = self.optimizer[name]
        torch.set_rng_state(self.random_state)

    def repeats(self, other: "Snapshot") -> bool:
        """Whether a step from here has to do what one from `other` did: all is the same but the progress."""
        return (
            np.array_equal(self.theta, other.theta)
            and all(np.array_equal(array, other.optimizer[name]) for name, array in self.optimizer.items())
            and torch.equal(self.random_state, other.random_state)
        )


def summary(row: dict[str, Any], progress: Progress) -> str:
    """Return the result of a run in one line."""
    known = [name for name in ("dense_error", "test_error") if not math.isnan(row.get(name, math.nan))]
    errors = [f"{name.replace('_', ' ')} {row[name]:.4g}" for name in known]
    parts = [f"sol {row['sol']:.4g}", *errors, f"max real {row['max_real']:.3g} 1/s"]
    if progress.unsolvable_steps:
        parts.append(f"{progress.unsolvable_steps} unsolvable steps")
    if progress.converged_at is not None:
        parts.append(f"converged at step {progress.converged_at}")
    return ", ".join(parts) + f" after {progress.step} steps in {duration(progress.train_seconds)}"
