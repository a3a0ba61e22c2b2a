"""One solve of a torch vector field: states at the output times, and how it ended."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchdiffeq._impl.interp import _interp_evaluate

from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.tableau import Tableau
from eigenode_cli.solve.times import checked_times, fixed_step_count, fixed_steps
from eigenode_cli.solve.torchdiffeq_solvers import ADAPTIVE, FIXED, SolveStopped, of_tableau, rms_norm

Field = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Trajectory:
    """States of a solve.

    Attributes:
        states: at the output times that were reached `(reached, n)`, the first is the initial state.
        status: how the solve ended.
        n_accepted, n_rejected: steps.
        steps: sizes of the accepted steps in s.
    """

    states: Tensor
    status: Status
    n_accepted: int
    n_rejected: int
    steps: list[float]

    def padded(self, count: int) -> NDArray[np.float64]:
        """Return the states as an array `(count, n)`, NaN where the solve did not arrive."""
        states = self.states.detach().numpy()
        full = np.full((count, states.shape[1]), np.nan)
        full[: states.shape[0]] = states
        return full


def solve(
    field: Field,
    initial_state: Tensor,
    times: Tensor,
    config: Solver,
    steps: list[float] | None = None,
) -> Trajectory:
    """Integrate `dx/dt = field(x)` from `initial_state (n,)` and interpolate at `times (N,)` in s, ascending.

    Differentiable in reverse and in forward mode with the steps held constant. A solve that fails is no error: the
    trajectory then ends early and its status says why.

    Args:
        field: vector field `(n,) -> (n,)`.
        initial_state: state at `times[0]`.
        times: output times; they never change the steps.
        config: method and its options.
        steps: sizes of the steps to take in place of the controller's (adaptive methods only).

    Raises:
        ValueError: the times are not finite and ascending, or the method is unknown.
    """
    times = torch.from_numpy(checked_times(times))
    if isinstance(config, AdaptiveSolver):
        return _solve_adaptive(field, initial_state, times, config, steps, config.tableau)
    if isinstance(config, FixedStepSolver) and config.tableau is not None:
        sizes = fixed_steps(config.step, float(times[0]), float(times[-1])).tolist()
        return _solve_adaptive(field, initial_state, times, AdaptiveSolver(rtol=1.0, atol=1.0), sizes, config.tableau)
    if isinstance(config, FixedStepSolver):
        return _solve_fixed(field, initial_state, times, config)
    raise ValueError(f"solver={config.name}: neither adaptive nor of fixed step")


def _solve_adaptive(
    field: Field,
    initial_state: Tensor,
    times: Tensor,
    config: AdaptiveSolver,
    steps: list[float] | None,
    tableau: Tableau | None,
) -> Trajectory:
    method = ADAPTIVE[config.name] if tableau is None else of_tableau(tableau)
    solver = method(func=lambda _t, y: field(y), y0=initial_state, rtol=config.rtol, atol=config.atol, norm=rms_norm)
    solver.prepare(float(times[-1]), config.max_steps, steps)
    states = [initial_state] * int((times == times[0]).sum())
    status = Status.OK
    try:
        solver._before_integrate(times)
        for time in times[len(states) :]:
            while time > solver.rk_state.t1:
                solver.rk_state = solver._adaptive_step(solver.rk_state)
            states.append(_interp_evaluate(solver.rk_state.interp_coeff, solver.rk_state.t0, solver.rk_state.t1, time))
    except SolveStopped as stopped:
        status = stopped.status
    return Trajectory(torch.stack(states), status, len(solver.steps), solver.n_rejected, solver.steps)


def _solve_fixed(field: Field, initial_state: Tensor, times: Tensor, config: FixedStepSolver) -> Trajectory:
    solver = FIXED[config.name](
        func=lambda _t, y, **_: field(y), y0=initial_state, step_size=config.step, rtol=0.0, atol=0.0
    )
    start, end = float(times[0]), float(times[-1])
    grid = [start + i * config.step for i in range(fixed_step_count(config.step, start, end))] + [end]
    y, states, taken = initial_state, [initial_state] * int((times == times[0]).sum()), 0
    status = Status.OK
    for here, there in pairwise(grid):
        t0, t1 = torch.tensor(here, dtype=torch.float64), torch.tensor(there, dtype=torch.float64)
        increment, f0 = solver._step_func(solver.func, t0, t1 - t0, t1, y)
        y1 = y + increment
        f1 = field(y1)
        if not (torch.isfinite(y1).all() and torch.isfinite(f1).all()):
            status = Status.NON_FINITE
            break
        taken += 1
        while len(states) < times.numel() and times[len(states)] <= t1:
            states.append(solver._cubic_hermite_interp(t0, y, f0, t1, y1, f1, times[len(states)]))
        y = y1
    sizes = [b - a for a, b in pairwise(grid)][:taken]
    return Trajectory(torch.stack(states), status, taken, 0, sizes)
