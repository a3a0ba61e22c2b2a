"""When `solver=auto` goes from its explicit method to its implicit one and back, written once for both engines.

An explicit step is limited by stability where `|h lambda|` of the fastest eigenvalue is at the border of the method's
stability region. On explicit steps it is estimated from the last two stages, which lie at the same time: E. Hairer, G.
Wanner, Solving Ordinary Differential Equations II, 2nd ed., Sec. IV.2. On implicit steps the Jacobian is at hand.
"""

from eigenode_cli.jit import njit
from eigenode_cli.solve.rosenbrock_tableau import ROSENBROCK, RosenbrockTableau
from eigenode_cli.solve.tableau import TABLEAUS, Tableau

AUTO = "auto"
STIFF = (*ROSENBROCK, AUTO)
"""The methods with implicit steps by the name that `solver=` takes."""
EXPLICIT, IMPLICIT = "tsit5", "rodas5p"
"""The two methods of `auto`."""
BORDER = 3.5068
"""End of the explicit method's stability region on the negative real axis."""
SHARE = 0.9
"""Share of the border from which on a step counts as limited by stability."""
OVER, BACK = 10, 3
"""So many such steps in a row lead to the implicit method, so many others back (the defaults of
OrdinaryDiffEq.jl, https://docs.sciml.ai/OrdinaryDiffEq/)."""
SQUARINGS = 4
"""Powers of the Jacobian up to 2^4: `|J^16|^(1/16)` is at most a third above the spectral radius where `|J|` is a
hundred times as large, as in second-order systems, whose states have different units."""


def tableaus_of(name: str) -> tuple[Tableau | None, RosenbrockTableau]:
    """Return the explicit tableau, None where there is none, and the implicit one of a method of `STIFF`."""
    if name == AUTO:
        return TABLEAUS[EXPLICIT], ROSENBROCK[IMPLICIT]
    return None, ROSENBROCK[name]


@njit
def switched(implicit: bool, count: int, reach: float) -> tuple[bool, int]:
    """Return whether the next step is implicit, and the new count, after an accepted step.

    Args:
        implicit: whether that step was.
        count: steps in a row that spoke for a change.
        reach: `|h lambda|` of its fastest eigenvalue; NaN counts as slow.
    """
    stiff = reach > SHARE * BORDER
    count = count + 1 if stiff != implicit else 0
    if count >= (BACK if implicit else OVER):
        return not implicit, 0
    return implicit, count
