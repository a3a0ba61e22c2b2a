"""The spectral terms together: one call gives the values of several terms and their slopes in all spectra."""

from eigenode_cli.jit import njit
from eigenode_cli.spectra.pairs import find_partners, match_targets
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.comparison import Comparison
from eigenode_cli.terms.dmp import dmp
from eigenode_cli.terms.frq import frq
from eigenode_cli.terms.osc import osc
from eigenode_cli.terms.stb import stb
from eigenode_cli.terms.stf import stf
from eigenode_cli.terms.stp import stp

SOL, FRQ, DMP, STB, OSC, STF, STP = range(len(NAMES))
"""Codes of the terms: their places in the registry."""
COUNT = len(NAMES)


@njit
def spectral_terms(codes, spectra, levels, targets, margin, errors, delta, values, slopes, compared, space):
    """Fill the means over all spectra of the named spectral terms, and their derivatives in every eigenvalue.

    A spectrum that is not finite contributes nothing and is not counted. A term that has nothing to compare at any
    spectrum has the value and slopes zero; `compared` tells.

    Args:
        codes: terms to evaluate `(L,)`, each one of FRQ, DMP, STB, OSC, STF, STP; others are left at zero.
        spectra: eigenvalues `(T, n)` in 1/s.
        levels: up to where a part of an eigenvalue counts as zero (`pairs.rounding_level`), in 1/s `(T,)`.
        targets: as in `data.targets.Targets`, in its order: frequencies and damping ratios `(T, K)` in Hz and 1,
            number of pairs `(T,)`, corridor of the stiffness ratio `(T, 2)`, half-widths of the ranges `(T, K)`, and
            the region.
        margin: stability margin in 1/s.
        errors: error function of each term of the registry `(len(NAMES),)`; `delta` is Huber's threshold.
        values: filled with the terms `(L,)`.
        slopes: filled with `dl/dRe + i dl/dIm` `(L, T, n)`.
        compared: filled with the number of spectra at which each term had something to compare `(L,)`.
        space: partner and match of each eigenvalue, working space `(n,)` each.

    Returns the number of spectra that counted.
    """
    (frequency, damping), (partner, match) = targets[:2], space
    values[:] = 0.0
    slopes[:] = 0.0
    compared[:] = 0
    counted = 0
    for t in range(spectra.shape[0]):
        spectrum, level = spectra[t], levels[t]
        if not _is_finite(spectrum):
            continue
        counted += 1
        find_partners(spectrum, level, partner)
        matched = match_targets(spectrum, partner, frequency[t], damping[t], match)
        comparison = _comparison(targets, t, spectrum, level, partner, match, matched, margin)
        for k in range(codes.size):
            code, error, slope, value, defined = codes[k], errors[codes[k]], slopes[k, t], 0.0, False
            if code == FRQ:
                value, defined = frq(comparison, error, delta, slope)
            elif code == DMP:
                value, defined = dmp(comparison, error, delta, slope)
            elif code == STB:
                value, defined = stb(comparison, error, delta, slope)
            elif code == OSC:
                value, defined = osc(comparison, error, delta, slope)
            elif code == STF:
                value, defined = stf(comparison, error, delta, slope)
            elif code == STP:
                value, defined = stp(comparison, error, delta, slope)
            values[k] += value
            compared[k] += int(defined)
    if counted > 0:
        values /= counted
        _divide(slopes, counted)
    return counted


@njit
def _comparison(targets, t, spectrum, level, partner, match, matched, margin):
    """Return the spectrum number t beside its target."""
    frequency, damping, pairs, stiffness, wide, broad, region = targets
    own = frequency[t], damping[t], wide[t], broad[t]
    return Comparison(
        spectrum, level, partner, match, matched, own[0], own[1], own[2], own[3], pairs[t], stiffness[t], margin, region
    )


@njit
def _divide(slopes, number):
    """Divide in place; Numba divides a complex number by a real one as if both were complex, ten times slower."""
    for row in slopes:
        for spectrum in row:
            for i in range(spectrum.size):
                spectrum[i] = complex(spectrum[i].real / number, spectrum[i].imag / number)


@njit
def _is_finite(spectrum):
    finite = True
    for value in spectrum:
        # a difference with itself is zero but for NaN and infinity
        finite &= value.real - value.real == 0.0 and value.imag - value.imag == 0.0
    return finite
