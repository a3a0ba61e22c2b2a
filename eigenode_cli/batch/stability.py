"""Whether a trained model is as stable as `stb` asks for: along its trajectory, and at its equilibrium."""

import math

from eigenode_cli.arrays import Floats
from eigenode_cli.config.names import training_terms
from eigenode_cli.config.setup import Setup
from eigenode_cli.engines.base import Evaluation
from eigenode_cli.spectra.equilibrium import spectrum_at

WHERE = {"trajectory": "along the trajectory", "equilibrium": "at the equilibrium"}
"""Places at which stability is looked at, in words."""


def stability(setup: Setup, along: Evaluation, rest: Floats | None) -> dict[str, float | None]:
    """Return the largest real part in 1/s along the trajectory and at the equilibrium.

    None where the solve failed, or no equilibrium is found.

    Args:
        setup: the parts of the run, its field with the trained parameters.
        along: the trajectory.
        rest: the equilibrium `(n,)`, None where there is none.
    """
    unit = setup.source.scaling.time
    return {
        "trajectory": None if math.isnan(along.max_real) else along.max_real / unit,
        "equilibrium": None if rest is None else float(spectrum_at(setup.field, rest).real.max()) / unit,
    }


def not_stable(setup: Setup, found: dict[str, float | None]) -> str | None:
    """Return what to say of a model that `stb` trained and that does not keep to its margin; None of any other."""
    if "stb" not in training_terms(setup.config):
        return None
    limit = -setup.problem.margin / setup.source.scaling.time
    outside = [f"{real:.3g} 1/s {WHERE[place]}" for place, real in found.items() if real is not None and real > limit]
    return f"stb does not hold: the largest real part is {' and '.join(outside)}" if outside else None
