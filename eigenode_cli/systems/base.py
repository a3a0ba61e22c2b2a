"""What a system is: dynamics, analytic Jacobian, states with units."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from eigenode_cli.arrays import Floats


@dataclass(frozen=True)
class State:
    """One state: its name in files, its unit, and its symbol in figures (matplotlib math text)."""

    name: str
    unit: str
    symbol: str


@dataclass(frozen=True)
class Parameter:
    """One parameter of a system with its value and unit."""

    name: str
    value: float
    unit: str


class System(ABC):
    """The ground truth `dx/dt = f(x)`, autonomous, with everything about it that is known exactly.

    Its class and its parameters are all that it is: two with the same are equal.
    """

    title: str
    """Name for people, as it stands over a figure."""
    states: tuple[State, ...]
    parameters: tuple[Parameter, ...]

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.parameters == other.parameters  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((type(self), self.parameters))

    @abstractmethod
    def dynamics(self, x: Floats) -> Floats:
        """State derivative `(..., n)` at the states `x (..., n)`."""

    @abstractmethod
    def jacobian(self, x: Floats) -> Floats:
        """Analytic `A = df/dx (..., n, n)` at the states `x (..., n)`."""
