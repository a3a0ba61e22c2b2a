"""What a setting's value must satisfy besides its type, stated beside the setting in the schema."""

import math
from collections.abc import Iterable
from dataclasses import Field, dataclass, field
from typing import Any

from omegaconf import MISSING, OmegaConf

from eigenode_cli.errors import unknown


@dataclass(frozen=True)
class Constraint:
    """Bounds or the names to choose from; of a list, every element must satisfy them."""

    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()

    def fault(self, value: Any) -> str | None:
        """Return what is wrong with a value of the right type, or None; numbers must be finite in any case."""
        if isinstance(value, Iterable) and not isinstance(value, str):
            return next((fault for fault in map(self.fault, value) if fault), None)
        if isinstance(value, str):
            return unknown("name", value, self.choices) if self.choices and value not in self.choices else None
        if isinstance(value, int | float) and not (math.isfinite(value) and self._within(value)):
            return self._range()
        return None

    def _within(self, value: float) -> bool:
        return (
            (self.at_least is None or value >= self.at_least)
            and (self.above is None or value > self.above)
            and (self.at_most is None or value <= self.at_most)
            and (self.below is None or value < self.below)
        )

    def _range(self) -> str:
        bounds = (
            ("at least", self.at_least),
            ("above", self.above),
            ("at most", self.at_most),
            ("below", self.below),
        )
        parts = [f"{word} {bound:g}" for word, bound in bounds if bound is not None]
        return "must be " + (" and ".join(parts) or "a finite number")


def option(
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
    below: float | None = None,
    choices: tuple[str, ...] = (),
    default: Any = MISSING,
) -> Any:
    """Return a field of the schema with its constraint, and a default where one is given (a tuple for a list)."""
    metadata = {"constraint": Constraint(at_least, above, at_most, below, choices)}
    if isinstance(default, tuple):
        return field(default_factory=lambda: list(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def constraint_of(entry: "Field[Any]") -> Constraint:
    """Return the constraint of a field; one without still asks for finite numbers."""
    return entry.metadata.get("constraint", Constraint())


def show(value: Any) -> str:
    """Return a value as the user would type it."""
    if OmegaConf.is_list(value):
        return f"[{','.join(show(element) for element in value)}]"
    if isinstance(value, float):
        return f"{value:g}"
    return "null" if value is None else str(value)
