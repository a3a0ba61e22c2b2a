"""How a solve ended. A numerical failure is a result with a name, not an exception."""

from enum import IntEnum


class Status(IntEnum):
    """The status of one solve; the order is fixed, compiled code returns the integer."""

    OK = 0
    UNDERFLOW = 1
    """The step size fell below what the time can resolve: the solution blows up or is too stiff."""
    MAX_STEPS = 2
    """`solver.max_steps` attempted steps did not reach the horizon."""
    NON_FINITE = 3
    """The field returned NaN or infinity at every step size that was tried."""
    UNSOLVED = 4
    """No solve was asked for: the spectral terms alone are taken, at the data states."""
    NO_EQUILIBRIUM = 5
    """The field has no equilibrium near the data, where `target.at=equilibrium` compares its spectrum."""

    @property
    def label(self) -> str:
        """The name as it stands in `metrics.csv`: ok, underflow, max_steps, ..."""
        return self.name.lower()


SOLVED = frozenset((Status.OK, Status.UNSOLVED))
"""What is no failure."""
