"""A method and the record of its steps, as the kernels read them; arrays by their addresses."""

from typing import NamedTuple

from eigenode_cli.engines.compiled.memory import integers
from eigenode_cli.jit import njit_inner

EXPLICIT, IMPLICIT, BOTH = range(3)
"""Kinds of methods: of explicit steps, of implicit ones, of the one or the other (`solve.switching`)."""


class Explicit(NamedTuple):
    """A tableau of s stages (`solve.tableau.Tableau`).

    Attributes:
        stages, order: s, and order of the solution.
        a, transposed: stage coefficients `(s, s)` and their transpose.
        nodes: times of the stages `(s,)`, as fractions of the step.
        error, dense: weights `(s,)` and `(s, 4)`.
    """

    stages: int
    order: int
    a: int
    transposed: int
    nodes: int
    error: int
    dense: int


class Implicit(NamedTuple):
    """A tableau of s stages: see `solve.rosenbrock_tableau.RosenbrockTableau`."""

    stages: int
    order: int
    gamma: float
    a: int
    c: int
    nodes: int
    drift: int
    end: int
    error: int
    dense: int


class Method(NamedTuple):
    """Tableaus, and the controller's settings.

    Attributes:
        kind: whose steps are taken; a tableau that is not needed has no stages.
        stages: the larger number of both.
        fresh: evaluations that a step leaves: all but the first one of an explicit method, whose first stage is the
            last one of the step before, and as many as there are stages of the others.
        explicit, implicit: the tableaus.
        rtol, atol, max_steps: of the controller; not read where steps are given.
    """

    kind: int
    stages: int
    fresh: int
    explicit: Explicit
    implicit: Implicit
    rtol: float
    atol: float
    max_steps: int


class Steps(NamedTuple):
    """Addresses of a record of the accepted steps and of the outputs in each.

    Attributes:
        capacity: steps that there is room for.
        size: of each step in s `(capacity,)`.
        record: what every evaluation left `(1 + fresh capacity, width)`: stage j of step i is number i fresh + j.
        width: size of one record, or 0 to keep none: then there is room for one, which every evaluation overwrites.
        output_step: index of the step that each output lies in `(N,)`, -1 for the initial state.
        output_weights: `x(t) = x_i + h_i sum_j output_weights[o, j] k_j`, `(N, stages)`.
        k: derivatives at the stages of one step `(stages, n)`.
        x, trial, error: states of one step `(n,)`.
        kept: implicit steps that there is room for: the capacity, or 1.
        implicit: whether each step is `(capacity,)`.
        factors, pivots: of the matrix of each step `(kept, n, n)`, `(kept, n)`.
        solved: stages of each step `(kept, stages, n)`; slope: of the inputs in it `(kept, k)`.
        rate: a derivative `(n,)`.
        rows: of the Jacobian of the outputs `(m, n + k)`; scratch: `(2, widest)`.
        powers: of the Jacobian `(2, n, n)`.
    """

    capacity: int
    size: int
    record: int
    width: int
    output_step: int
    output_weights: int
    k: int
    x: int
    trial: int
    error: int
    kept: int
    implicit: int
    factors: int
    pivots: int
    solved: int
    slope: int
    rate: int
    rows: int
    scratch: int
    powers: int


@njit_inner
def is_implicit(steps, step):
    """Whether a step is one of the implicit method."""
    return integers(steps.implicit, step)[0] != 0


@njit_inner
def place(method, steps, step, stage):
    """Where the record of a stage of a step begins, in doubles from the first record."""
    return (step * method.fresh + stage) * steps.width


@njit_inner
def slot(steps, step):
    """Which of the kept implicit steps belongs to a step."""
    return step if steps.kept > 1 else 0
