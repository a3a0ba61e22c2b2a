"""What the kernels read and write, made once for an engine: the problem as plain arrays, and all working space."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.compiled.algebra import BLOCK
from eigenode_cli.engines.compiled.bars import Bars
from eigenode_cli.engines.compiled.core import Core, Setup, Work
from eigenode_cli.engines.compiled.curvature import curve_size
from eigenode_cli.engines.compiled.debug_memory import label
from eigenode_cli.engines.compiled.drive import Drive as Pieces
from eigenode_cli.engines.compiled.jacobian import scratch_rows
from eigenode_cli.engines.compiled.memory import LINE, aligned, whole_lines
from eigenode_cli.engines.compiled.method import BOTH, EXPLICIT, IMPLICIT, Explicit, Implicit, Method, Steps
from eigenode_cli.engines.compiled.mlp import MlpShape, Net, build_net, layer_table
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.compiled.spectrum_buffers import build_eigen
from eigenode_cli.engines.problem import REACH, Problem
from eigenode_cli.solve.drive import Drive, steps_to_knots
from eigenode_cli.solve.rosenbrock_tableau import RosenbrockTableau
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.solve.switching import STIFF, tableaus_of
from eigenode_cli.solve.tableau import TABLEAUS, Tableau
from eigenode_cli.solve.times import fixed_steps
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.errors import MSE

FIRST_CAPACITY = 256
"""Steps that are recorded before room is made for more."""
NO_STEPS = np.empty(0)
"""Given steps where the solver chooses its own."""
CACHED = 2**16
"""Doubles of tangents that a block may have: half of a megabyte, a part of one core's cache."""


class Shared(NamedTuple):
    """The working space that Python reads or writes, as arrays: see `Work`; `theta (P,)`."""

    theta: Floats
    outcome: NDArray[np.int64]
    slopes: NDArray[np.complex128]
    user_slopes: Floats


def term_codes(names: tuple[str, ...]) -> NDArray[np.int64]:
    """Codes of the terms `(L,)`: that of one of the six, -1 - u for number u of the others."""
    own = [name for name in names if name not in NAMES]
    return np.array([NAMES.index(name) if name in NAMES else -1 - own.index(name) for name in names], dtype=np.int64)


def _explicit(owner: Owner, tableau: Tableau | None) -> Explicit:
    if tableau is None:
        return Explicit(0, 0, *(owner.floats(1) for _ in range(5)))
    return Explicit(
        stages=tableau.error.size,
        order=tableau.order,
        a=owner.copy(tableau.a, np.float64),
        transposed=owner.copy(tableau.a.T, np.float64),
        nodes=owner.copy(tableau.c, np.float64),
        error=owner.copy(tableau.error, np.float64),
        dense=owner.copy(tableau.dense, np.float64),
    )


def _implicit(owner: Owner, tableau: RosenbrockTableau | None) -> Implicit:
    if tableau is None:
        return Implicit(0, 0, 1.0, *(owner.floats(1) for _ in range(7)))
    arrays = (tableau.a, tableau.c, tableau.nodes, tableau.drift, tableau.end, tableau.error, tableau.dense)
    addresses = (owner.copy(array, np.float64) for array in arrays)
    return Implicit(tableau.nodes.size, tableau.order, tableau.gamma, *addresses)


def build_method(
    owner: Owner,
    explicit: Tableau | None,
    implicit: RosenbrockTableau | None = None,
    rtol: float = 0.0,
    atol: float = 1.0,
    max_steps: int = 0,
) -> Method:
    """Return the method of one tableau, or of both by turns, with its settings."""
    first, second = _explicit(owner, explicit), _implicit(owner, implicit)
    stages = max(first.stages, second.stages)
    return Method(
        kind=EXPLICIT if implicit is None else IMPLICIT if explicit is None else BOTH,
        stages=stages,
        fresh=stages - int(implicit is None),
        explicit=first,
        implicit=second,
        rtol=float(rtol),
        atol=float(atol),
        max_steps=int(max_steps),
    )


def solver_method(owner: Owner, solver: Solver) -> tuple[Method, float]:
    """Return the method of a solver's settings, and its step in s (0 for adaptive steps).

    Raises:
        ValueError: the settings do not fit the method, or it is unknown.
    """
    tableau, implicit = TABLEAUS.get(solver.name) if solver.tableau is None else solver.tableau, None
    if solver.name in STIFF:
        tableau, implicit = tableaus_of(solver.name)
    elif tableau is None:
        known = ", ".join((*TABLEAUS, *STIFF))
        raise ValueError(f"solver.name={solver.name}: the compiled engine knows {known}")
    adaptive = implicit is not None or (tableau is not None and tableau.adaptive)
    if adaptive and isinstance(solver, AdaptiveSolver):
        return build_method(owner, tableau, implicit, solver.rtol, solver.atol, solver.max_steps), 0.0
    if not adaptive and isinstance(solver, FixedStepSolver):
        return build_method(owner, tableau), float(solver.step)
    raise ValueError(f"solver.name={solver.name}: {type(solver).__name__} does not fit this method")


def given_steps(step: float, times: Floats, drive: Drive | None = None) -> Floats:
    """Return the steps of a solve over `times` by a method of that step size, none for adaptive steps (step 0)."""
    if step == 0.0:
        return NO_STEPS
    steps = fixed_steps(step, float(times[0]), float(times[-1]))
    return steps if drive is None else steps_to_knots(steps, float(times[0]), drive)


class Room:
    """Room for the steps of a solve.

    Args:
        net, method: of the solve.
        capacity: accepted steps that fit.
        outputs: N.
        recorded: whether every evaluation leaves a record.

    Attributes:
        steps: addresses; sizes: of the accepted steps in s `(capacity,)`; outputs: N.
    """

    def __init__(self, net: Net, method: Method, capacity: int, outputs: int, recorded: bool) -> None:
        self._owner = Owner()
        self.outputs = outputs
        self.sizes = np.zeros(capacity)
        # one step's at least: the choice of the first step writes there, even where no step is allowed
        evaluations = 1 + method.fresh * max(1, capacity) if recorded else 1
        implicit = method.kind != EXPLICIT
        kept = (max(1, capacity) if recorded else 1) * implicit
        steps = Steps(
            capacity=capacity,
            size=self._owner.keep(self.sizes),
            record=self._owner.floats(evaluations, net.width),
            width=net.width if recorded else 0,
            output_step=self._owner.zeros(outputs, np.int64),
            output_weights=self._owner.floats(outputs, method.stages),
            k=self._owner.floats(method.stages, net.n),
            x=self._owner.floats(net.n),
            trial=self._owner.floats(net.n),
            error=self._owner.floats(net.n),
            kept=kept,
            implicit=self._owner.zeros(capacity, np.int64),
            factors=self._owner.floats(kept, net.n, net.n),
            pivots=self._owner.zeros(kept * net.n, np.int64),
            solved=self._owner.floats(kept, method.stages, net.n),
            slope=self._owner.floats(kept, net.k),
            rate=self._owner.floats(net.n),
            rows=self._owner.floats(net.m, net.n + net.k),
            scratch=self._owner.floats(2, net.widest),
            powers=self._owner.floats(2, net.n, net.n),
        )
        self.steps = label(steps)


def block_columns(count: int, net: Net) -> int:
    """States in a block, in whole cache lines: all `count` of them unless their tangents would fill the cache."""
    fitting = CACHED // max(1, net.tangents) // LINE * LINE
    return min(whole_lines(count), max(LINE, fitting))


def build_core(
    owner: Owner,
    shape: MlpShape,
    problem: Problem,
    method: Method,
    terms: int,
    own_terms: int,
    forward_way: bool,
    columns: int = 0,
) -> tuple[Core, Shared]:
    """Return everything but the steps, for L terms of which `own_terms` are the user's.

    What only forward sensitivities need has no room unless `forward_way`. `columns` are the states in a block of
    spectra, 0 for as many as the cache has room for.
    """
    n, m, size = shape.states, shape.sizes[-1], shape.parameters + problem.data.trained
    outputs, count = problem.data.times.size, problem.spectral_index.size
    shared = Shared(
        theta=aligned(size),
        outcome=np.zeros(6, dtype=np.int64),
        slopes=np.zeros(max(terms, len(NAMES)) * 2 * count * n, dtype=np.complex128),
        user_slopes=np.zeros((own_terms, outputs, n)),
    )
    drive = build_drive(owner, problem.data, shape.inputs)
    net, batch = _build_nets(owner, shape, (shared.theta, aligned(size)), drive.now)
    columns = columns or block_columns(count, batch)
    blocks = -(-count // columns)
    setup = _build_setup(owner, problem, shape.parameters)
    work = Work(
        columns=columns,
        blocks=blocks,
        records=owner.floats(2 * blocks, batch.width, columns),
        tangents=owner.floats(batch.tangents, columns),
        pushed=owner.zeros(1, np.int64),
        a=owner.floats(n, n),
        bar=owner.floats(m, n),
        rows=owner.floats(m * n, columns),
        bar_x=owner.floats(n, columns),
        scratch=owner.floats(scratch_rows(batch), columns),
        slopes=owner.keep(shared.slopes),
        states=owner.floats(0 if setup.plain else outputs, n),
        shown=owner.floats(0 if setup.plain else outputs, setup.channels),
        solution_slope=owner.floats(outputs, setup.channels),
        user_slopes=owner.keep(shared.user_slopes),
        compared=owner.zeros(max(terms, len(NAMES)), np.int64),
        square=owner.floats(1),
        squares=owner.copy(np.full(len(NAMES), MSE), np.int64),
        partner=owner.zeros(n, np.int64),
        match=owner.zeros(n, np.int64),
        channel=owner.zeros(terms, np.int64),
        outcome=owner.keep(shared.outcome),
    )
    bars = _build_bars(owner, net, method, setup, terms, forward_way)
    eigen = build_eigen(owner, n, 2 * count, problem.max_condition)
    return label(Core(net, batch, drive, method, eigen, bars, setup, work)), shared


def _build_nets(owner: Owner, shape: MlpShape, memory: tuple[Floats, Floats], drive: int) -> tuple[Net, Net]:
    """Return the net of single states and that of blocks; `memory` is theta and its mirror."""
    scales = tuple(np.array(scale, dtype=np.float64) for scale in (shape.input_scale, shape.output_scale))
    tables = [layer_table(shape, blocks) for blocks in (False, True)]
    for array in (*memory, *scales, *tables):
        owner.keep(array)
    net, batch = (
        build_net(shape, blocks, table, (scales[0], scales[1]), memory, drive)
        for blocks, table in zip((False, True), tables, strict=True)
    )
    return net, batch


def build_drive(owner: Owner, data: Series, inputs: int) -> Pieces:
    """Return the pieces of the inputs of a trajectory, one of nothing where there are none.

    Raises:
        ValueError: the field has another number of inputs.
    """
    if data.inputs != inputs:
        raise ValueError(f"the data has {data.inputs} inputs, the field {inputs}")
    if data.drive is None:
        starts, values = np.zeros(1), np.zeros((1, 0))
        slopes, jumps = values, np.zeros(1, dtype=np.bool_)
    else:
        starts, values, slopes, jumps = data.drive.pieces
    return Pieces(
        k=inputs,
        pieces=starts.size,
        starts=owner.copy(starts, np.float64),
        values=owner.copy(values, np.float64),
        slopes=owner.copy(slopes, np.float64),
        jumps=owner.copy(jumps, np.int64),
        piece=owner.zeros(1, np.int64),
        now=owner.floats(inputs),
    )


def _build_setup(owner: Owner, problem: Problem, parameters: int) -> Setup:
    data, targets = problem.data, problem.targets
    references = np.full_like(data.values, np.nan) if problem.states is None else problem.states

    def twice(rows: NDArray, dtype: type) -> int:
        return owner.copy(np.concatenate([rows, rows]), dtype)

    return Setup(
        outputs=data.times.size,
        measured=problem.measured,
        rows=problem.spectral_index.size,
        pair_count=targets.frequency.shape[1],
        times=owner.copy(data.times, np.float64),
        start=owner.copy(data.initial_state, np.float64),
        unknown=owner.copy(data.unknown, np.int64),
        unknown_count=data.unknown.size,
        initial=parameters,
        channels=data.channels.shape[1],
        data=owner.copy(data.channels, np.float64),
        mask=owner.copy(data.channel_mask, np.bool_),
        offset=owner.copy(data.offsets, np.int64),
        offset_count=data.offsets.size,
        plain=data.rates is None and data.offsets.size == 0,
        driven=owner.copy(data.driven, np.float64),
        indices=owner.copy(problem.spectral_index, np.int64),
        references=owner.copy(references[problem.spectral_index], np.float64),
        limit=owner.copy(REACH * problem.sizes, np.float64),
        frequency=twice(targets.frequency, np.float64),
        damping=twice(targets.damping, np.float64),
        pairs=twice(targets.pairs, np.int64),
        stiffness=twice(targets.stiffness, np.float64),
        frequency_tolerance=twice(targets.frequency_tolerance, np.float64),
        damping_tolerance=twice(targets.damping_tolerance, np.float64),
        region=owner.copy(targets.region, np.float64),
        region_size=targets.region.size,
        margin=float(problem.margin),
        errors=owner.copy(problem.errors, np.int64),
        delta=float(problem.huber_delta),
        stabilise=bool(problem.stabilise),
        solved=bool(problem.solved),
    )


def _build_bars(owner: Owner, net: Net, method: Method, setup: Setup, terms: int, forward_way: bool) -> Bars:
    n, m, q, outputs = net.n, net.m, terms * net.n, setup.outputs
    columns, stride = net.size if forward_way else 0, whole_lines(net.size)
    return Bars(
        states=owner.floats(outputs, q),
        packed=owner.floats(terms, net.size),
        stage_rates=owner.floats(method.stages, q),
        stage_states=owner.floats(method.stages, q),
        start=owner.floats(q),
        carried=owner.floats(q),
        seeds=owner.keep(np.eye(m)),
        rows_x=owner.floats(m, n),
        waiting=owner.zeros(1, np.int64),
        rows=owner.floats(BLOCK, stride if m < terms else 0),
        factors=owner.floats(BLOCK, terms),
        stride=stride,
        scratch=owner.floats(2 * net.widest),
        directions=owner.floats(0 if method.kind == EXPLICIT else terms, m, n + net.k),
        curves=owner.floats(0 if method.kind == EXPLICIT else curve_size(net)),
        tangent_state=owner.floats(n, columns),
        tangent_stage=owner.floats(n, columns),
        tangent_k=owner.floats(method.stages, n, columns),
        tangent_output=owner.floats(n, columns),
        unknown=setup.unknown,
        unknown_count=setup.unknown_count,
        initial=setup.initial,
        record=owner.floats(net.width),
        rate=owner.floats(n),
        bar_rate=owner.floats(q),
        tangent_shown=owner.floats(0 if setup.plain else setup.channels, columns),
    )
