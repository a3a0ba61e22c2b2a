"""What a spectral term sees: one spectrum beside its target."""

from typing import NamedTuple

from eigenode_cli.arrays import Complexes, Floats, Integers


class Comparison(NamedTuple):
    """One spectrum and the target at the same time.

    A kernel of a spectral term is called as `term(comparison, error, delta, slope)` with its error function (see
    `errors`) and Huber's threshold. It fills `slope (n,)` with `dl/dRe + i dl/dIm` of every eigenvalue, and returns the
    term and whether it has something to compare here.

    Attributes:
        spectrum: eigenvalues `(n,)` in 1/s.
        level: up to where a part of an eigenvalue counts as zero, in 1/s.
        partner: index of each eigenvalue's conjugate `(n,)`, `REAL` for a real one.
        match: index of the target of each eigenvalue `(n,)`, `UNMATCHED` for none; `matched` how many have one.
        frequency: of the target's pairs `(K,)` in Hz, ascending, NaN behind the last.
        damping: damping ratios of the same pairs `(K,)`, in [-1, 1].
        frequency_tolerance, damping_tolerance: half-widths of their ranges `(K,)`; zero for values to be met.
        pairs: number of pairs of the target.
        stiffness: smallest and largest accepted stiffness ratio `(2,)`; equal for a value to be met.
        margin: stability margin in 1/s.
        region: step in s and coefficients of the stability function of a solver, shorter than 2 for none.
    """

    spectrum: Complexes
    level: float
    partner: Integers
    match: Integers
    matched: int
    frequency: Floats
    damping: Floats
    frequency_tolerance: Floats
    damping_tolerance: Floats
    pairs: int
    stiffness: Floats
    margin: float
    region: Floats
