"""One solve of a torch vector field: states at the output times, and how it ended."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchdiffeq._impl.interp import _interp_evaluate
from torchdiffeq._impl.misc import _compute_error_ratio, _select_initial_step

from eigenode_cli.solve.drive import Drive, steps_to_knots
from eigenode_cli.solve.rosenbrock import Attempt, Start
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.solve.status import Status
from eigenode_cli.solve.step_control import SolveStopped, StepControl
from eigenode_cli.solve.switching import STIFF
from eigenode_cli.solve.tableau import Tableau
from eigenode_cli.solve.times import checked_times, fixed_step_count, fixed_steps
from eigenode_cli.solve.torchdiffeq_solvers import ADAPTIVE, FIXED, of_tableau, rms_norm
from eigenode_cli.solve.way import Way

Field = Callable[..., Tensor]
Timed = Callable[..., Tensor]
ON_KNOT = 1e-6
"""A given step ends at a knot if it comes this near to it, relative to its size."""


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
    drive: Drive | None = None,
) -> Trajectory:
    """Integrate `dx/dt = field(x)` from `initial_state (n,)` and interpolate at `times (N,)` in s, ascending.

    With inputs it is `field(x, u(t))`. Differentiable in reverse and in forward mode with the steps held constant. A
    solve that fails is no error: the trajectory then ends early and its status says why.

    Args:
        field: vector field `(n,) -> (n,)`, of a state and the inputs `(k,)` where there are any.
        initial_state: state at `times[0]`.
        times: output times; they never change the steps.
        config: method and its options.
        steps: sizes of the steps to take in place of the controller's (methods of a tableau only).
        drive: the inputs; no step goes over the start of one of its pieces.

    Raises:
        ValueError: the times are not finite and ascending, or the method is unknown.
    """
    times = torch.from_numpy(checked_times(times))
    if drive is not None:
        return _solve_driven(field, initial_state, times, config, steps, drive)
    return _solve_piece(lambda _t, x: field(x), initial_state, times, config, steps, _way_of(config))


def _way_of(config: Solver) -> Way | None:
    return Way(config.name) if config.name in STIFF else None


def _solve_driven(
    field: Field, initial_state: Tensor, times: Tensor, config: Solver, steps: list[float] | None, drive: Drive
) -> Trajectory:
    """Solve from knot to knot of the inputs, along a straight piece each time."""
    starts, values, slopes, _ = drive.pieces
    begin, end = float(times[0]), float(times[-1])
    knots = [begin, *starts[(starts > begin) & (starts < end)].tolist(), *([end] if end > begin else [])]
    states, sizes, rejected, status = [initial_state] * int((times == begin).sum()), [], 0, Status.OK
    way = _way_of(config)
    if steps is None and isinstance(config, FixedStepSolver):
        steps = steps_to_knots(fixed_steps(config.step, begin, end), begin, drive).tolist()
    left = None if steps is None else [size for size in steps if size > 0.0]
    x = initial_state
    for here, there in pairwise(knots):
        piece = max(0, int(np.searchsorted(starts, here, side="right")) - 1)
        origin, value, slope = starts[piece], torch.from_numpy(values[piece]), torch.from_numpy(slopes[piece])
        inside = times[(times > here) & (times <= there)]
        last = there if inside.numel() == 0 or float(inside[-1]) < there else None
        outputs = torch.cat([times.new_tensor([here]), inside, times.new_tensor([] if last is None else [there])])

        def rate(t: float | Tensor, y: Tensor, origin=origin, value=value, slope=slope) -> Tensor:
            u = value + slope * (t - origin)
            return field(y, u if y.dim() == 1 else u.expand(*y.shape[:-1], u.shape[-1]))

        taken = None if left is None else _leading(left, there - here)
        found = _solve_piece(rate, x, outputs, config, taken, way)
        states += list(found.states[1 : 1 + inside.numel()])
        sizes, rejected, status = [*sizes, *found.steps], rejected + found.n_rejected, found.status
        if status is not Status.OK:
            break
        x = found.states[-1]
    return Trajectory(torch.stack(states), status, len(sizes), rejected, sizes)


def _leading(steps: list[float], length: float) -> list[float]:
    """Take the leading steps that add up to `length` from a list."""
    taken: list[float] = []
    while steps and sum(taken) < length - ON_KNOT * steps[0]:
        taken.append(steps.pop(0))
    return taken


def _solve_piece(
    field: Timed, initial_state: Tensor, times: Tensor, config: Solver, steps: list[float] | None, way: Way | None
) -> Trajectory:
    if isinstance(config, AdaptiveSolver) and way is not None:
        return _solve_stiff(field, initial_state, times, config, steps, way)
    if isinstance(config, AdaptiveSolver):
        return _solve_adaptive(field, initial_state, times, config, steps, config.tableau)
    if isinstance(config, FixedStepSolver) and config.tableau is not None:
        sizes = steps or fixed_steps(config.step, float(times[0]), float(times[-1])).tolist()
        return _solve_adaptive(field, initial_state, times, AdaptiveSolver(rtol=1.0, atol=1.0), sizes, config.tableau)
    if isinstance(config, FixedStepSolver):
        return _solve_fixed(field, initial_state, times, config, steps)
    raise ValueError(f"solver={config.name}: neither adaptive nor of fixed step")


def _solve_stiff(
    field: Timed, initial_state: Tensor, times: Tensor, config: AdaptiveSolver, replay: list[float] | None, way: Way
) -> Trajectory:
    """Integrate by a Rosenbrock method, or by two methods: control and statuses as those of the explicit ones."""
    control = StepControl(float(times[-1]), config.max_steps, replay)
    states, time, x = [initial_state] * int((times == times[0]).sum()), times[0], initial_state
    status = Status.OK
    try:
        control.proposed = _first_size(field, time, x, config, way.order)
        while len(states) < times.numel():
            size, clipped = control.size(float(time))
            start = way.start(field, time, x)
            while (tried := _accepted(way, field, start, size, config, control)) is None:
                size, clipped = control.size(float(time))
            end = times[-1] if clipped else time + size
            while len(states) < times.numel() and times[len(states)] <= end:
                states.append(_interp_evaluate(tried.dense, time, end, times[len(states)]))
            way.decide(size * tried.fastest)
            time, x = end, tried.end
    except SolveStopped as stopped:
        status = stopped.status
    return Trajectory(torch.stack(states), status, len(control.steps), control.n_rejected, control.steps)


@torch.no_grad()
def _first_size(field: Timed, time: Tensor, state: Tensor, config: AdaptiveSolver, order: int) -> float:
    """Return the size of the first step in s.

    Raises:
        SolveStopped: the field is not finite there.
    """
    rate = field(time, state)
    if not torch.isfinite(rate).all():
        raise SolveStopped(Status.NON_FINITE)
    state = state.detach()
    return float(_select_initial_step(field, time, state, order - 1, config.rtol, config.atol, rms_norm, f0=rate))


def _accepted(
    way: Way, field: Timed, start: Start, size: float, config: AdaptiveSolver, control: StepControl
) -> Attempt | None:
    """Try a step; None where it is rejected."""
    tried = way.attempt(field, start, size)
    ratio = float("inf")
    if tried is not None:
        with torch.no_grad():
            if bool(torch.isfinite(tried.end).all() and torch.isfinite(tried.error).all()):
                ratio = float(
                    _compute_error_ratio(tried.error, config.rtol, config.atol, start.state, tried.end, rms_norm)
                )
    return tried if control.accepts(size, ratio, way.order) else None


def _solve_adaptive(
    field: Timed,
    initial_state: Tensor,
    times: Tensor,
    config: AdaptiveSolver,
    steps: list[float] | None,
    tableau: Tableau | None,
) -> Trajectory:
    method = ADAPTIVE[config.name] if tableau is None else of_tableau(tableau)
    solver = method(func=field, y0=initial_state, rtol=config.rtol, atol=config.atol, norm=rms_norm)
    control = StepControl(float(times[-1]), config.max_steps, steps)
    solver.prepare(control)
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
    return Trajectory(torch.stack(states), status, len(control.steps), control.n_rejected, control.steps)


def _solve_fixed(
    field: Timed, initial_state: Tensor, times: Tensor, config: FixedStepSolver, steps: list[float] | None
) -> Trajectory:
    solver = FIXED[config.name](
        func=lambda t, y, **_: field(float(t), y), y0=initial_state, step_size=config.step, rtol=0.0, atol=0.0
    )
    start, end = float(times[0]), float(times[-1])
    grid = [start + i * config.step for i in range(fixed_step_count(config.step, start, end))] + [end]
    if steps is not None:
        grid = [start, *(start + np.cumsum(steps[:-1])).tolist(), end]
    y, states, taken = initial_state, [initial_state] * int((times == times[0]).sum()), 0
    status = Status.OK
    for here, there in pairwise(grid):
        t0, t1 = torch.tensor(here, dtype=torch.float64), torch.tensor(there, dtype=torch.float64)
        increment, f0 = solver._step_func(solver.func, t0, t1 - t0, t1, y)
        y1 = y + increment
        f1 = field(there, y1)
        if not (torch.isfinite(y1).all() and torch.isfinite(f1).all()):
            status = Status.NON_FINITE
            break
        taken += 1
        while len(states) < times.numel() and times[len(states)] <= t1:
            states.append(solver._cubic_hermite_interp(t0, y, f0, t1, y1, f1, times[len(states)]))
        y = y1
    sizes = [b - a for a, b in pairwise(grid)][:taken]
    return Trajectory(torch.stack(states), status, taken, 0, sizes)
