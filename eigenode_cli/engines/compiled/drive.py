"""The input `u(t)` as the kernels read it: pieces of straight lines, with or without jumps between them."""

import math
from typing import NamedTuple

from eigenode_cli.engines.compiled.memory import doubles, integers
from eigenode_cli.jit import njit_inner

NEAR = 1e-12
"""A piece is entered when the time comes this near to its start, relative to the time."""


class Drive(NamedTuple):
    """Addresses of k inputs in S pieces; without an input there is one piece of nothing.

    Attributes:
        k, pieces: k and S.
        starts: of the pieces in s `(S,)`, ascending.
        values, slopes: of the inputs at the start of each piece, and their slopes in it `(S, k)`.
        jumps: whether any input jumps at the start of a piece `(S,)`.
        piece: number of the present one `(1,)`.
        now: values at the time that was set last `(k,)`.
    """

    k: int
    pieces: int
    starts: int
    values: int
    slopes: int
    jumps: int
    piece: int
    now: int


@njit_inner
def start_drive(drive, t):
    """Go to the piece that time `t` lies in, and set its values there."""
    piece, starts = integers(drive.piece, 0), doubles(drive.starts, 0)
    piece[0] = 0
    while piece[0] + 1 < drive.pieces and starts[piece[0] + 1] <= t:
        piece[0] += 1
    set_drive(drive, t)


@njit_inner
def next_knot(drive):
    """Return the start of the next piece, infinite in the last one."""
    following = integers(drive.piece, 0)[0] + 1
    return doubles(drive.starts, following)[0] if following < drive.pieces else math.inf


@njit_inner
def enter_pieces(drive, t):
    """Go on to the piece that begins at time `t`, if one does; returns whether an input jumps there."""
    jumped, piece = False, integers(drive.piece, 0)
    while next_knot(drive) <= t + NEAR * abs(t):
        piece[0] += 1
        jumped |= integers(drive.jumps, piece[0])[0] != 0
    return jumped


@njit_inner
def set_drive(drive, t):
    """Set the values at time `t` by the line of the present piece, at its end the limit from the left."""
    piece, k, now = integers(drive.piece, 0)[0], drive.k, doubles(drive.now, 0)
    values, slopes = doubles(drive.values, piece * k), doubles(drive.slopes, piece * k)
    for i in range(k):
        now[i] = values[i] + slopes[i] * (t - doubles(drive.starts, piece)[0])
