"""What the kernels of a loss Jacobian share: the problem, the field, and all working space, by addresses."""

from typing import NamedTuple

from eigenode_cli.engines.compiled.bars import Bars
from eigenode_cli.engines.compiled.drive import Drive
from eigenode_cli.engines.compiled.method import Method
from eigenode_cli.engines.compiled.mlp import Net
from eigenode_cli.engines.compiled.spectrum import Eigen

STATUS, ACCEPTED, REJECTED, REACHED, SPECTRA, GUARDED = range(6)
"""Entries of `Work.outcome`: how the solve ended, steps, outputs that were reached, spectra that the terms are taken
over, firings of the guard."""


class Setup(NamedTuple):
    """The problem as the kernels read it, for N data times, T spectra, K pairs; arrays by their addresses.

    Attributes:
        outputs, rows, pair_count: N, T, K; `measured` the number of measured values.
        times: data times `(N,)`.
        start: initial state `(n,)`; its unknown entries are filled from theta.
        unknown, unknown_count: indices of these entries; their parameters stand at `initial` in theta.
        channels: C, what is measured at a time: n states, or these and their n derivatives.
        data, mask: observations `(N, C)`.
        offset, offset_count: channels with a trained offset; their parameters are the last ones.
        plain: whether the channels are the states themselves: no derivative, no offset.
        driven: the inputs at the data times `(N, k)`.
        indices: data times at which spectra are taken `(T,)`.
        references: states of the data there `(T, n)`, at which a failed solve takes the spectral terms as well.
        limit: moduli of the states up to which it takes them at the states that it reached `(n,)`.
        frequency, damping, pairs, stiffness, frequency_tolerance, damping_tolerance: targets, one row for each of the
            T spectra and then again `(2 T, ...)`.
        region, region_size: of the term `stp`.
        margin, errors, delta: of the terms.
        stabilise: whether a failed solve gives spectral terms.
        solved: whether there is a solve at all.
    """

    outputs: int
    measured: int
    rows: int
    pair_count: int
    times: int
    start: int
    unknown: int
    unknown_count: int
    initial: int
    channels: int
    data: int
    mask: int
    offset: int
    offset_count: int
    plain: bool
    driven: int
    indices: int
    references: int
    limit: int
    frequency: int
    damping: int
    pairs: int
    stiffness: int
    frequency_tolerance: int
    damping_tolerance: int
    region: int
    region_size: int
    margin: float
    errors: int
    delta: float
    stabilise: bool
    solved: bool


class Work(NamedTuple):
    """Working space between the forward kernel and the pullback, for L terms; arrays by their addresses.

    Spectra are taken in blocks of so many states (`jacobian`): those along the trajectory, then those at `references`.

    Attributes:
        columns: states in a block, in whole cache lines.
        blocks: number of blocks along the trajectory.
        records: of all blocks `(2 blocks, batch.width, columns)`.
        tangents: of one block `(batch.tangents, columns)`; `pushed` its number, -1 for none `(1,)`.
        a: a Jacobian `(n, n)`; `bar` the cotangent of its last m rows `(m, n)`.
        rows: the last m rows of the Jacobians of a block, or their cotangents `(m n, columns)`.
        bar_x: cotangents of the states of a block `(n, columns)`.
        scratch: of the pullback of a block.
        slopes: of the terms in the eigenvalues `(L, T, n)`, or `(L, 2 T, n)` after a failed solve.
        states, shown: trajectory `(N, n)`, and what the model says of the channels `(N, C)` where these are not it.
        solution_slope: of SOL in the channels `(N, C)`; `user_slopes` of the user's terms `(U, N, n)`.
        compared: at how many spectra each term had something to compare `(L,)`.
        square: value of one term at one spectrum with squares as errors `(1,)`; `squares` their codes `(6,)`.
        partner, match: of the terms `(n,)`.
        channel: number of the channel of each term in the pullback, -1 for none `(L,)`.
        outcome: see above `(6,)`.
    """

    columns: int
    blocks: int
    records: int
    tangents: int
    pushed: int
    a: int
    bar: int
    rows: int
    bar_x: int
    scratch: int
    slopes: int
    states: int
    shown: int
    solution_slope: int
    user_slopes: int
    compared: int
    square: int
    squares: int
    partner: int
    match: int
    channel: int
    outcome: int


class Core(NamedTuple):
    """What stays the same from call to call; `net` has the table of single states, `batch` that of blocks."""

    net: Net
    batch: Net
    drive: Drive
    method: Method
    eigen: Eigen
    bars: Bars
    setup: Setup
    work: Work
