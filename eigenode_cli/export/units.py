"""Units by their names, as powers of the SI's: what an FMU tells of a unit, where that is obvious."""

import re
from dataclasses import dataclass, field

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Units that FMI knows, in its order."""
UNITS: dict[str, dict[str, int]] = {
    **{name: {name: 1} for name in BASE},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "C": {"s": 1, "A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "1": {},
}
OTHERS: dict[str, tuple[float, str]] = {"g": (1e-3, "kg"), "deg": (0.017453292519943295, "rad"), "min": (60.0, "s")}
PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_TERM = re.compile(r"([A-Za-z]+|1)(?:\^?(-?\d+))?")


@dataclass(frozen=True)
class Unit:
    """A unit: its name, and the SI's powers and a factor of it where they are known."""

    name: str
    powers: dict[str, int] = field(default_factory=dict)
    factor: float = 1.0
    known: bool = False


def unit_of(name: str) -> Unit:
    """Return what a unit is, of the form `N m/s^2`, `kg*m2`, `1/s`, `mm/s`; else its name alone."""
    above, *below = name.split("/")
    if len(below) > 1 or any(sign in name for sign in "()"):
        return Unit(name)
    powers: dict[str, int] = {}
    factor = 1.0
    for sign, part in ((1, above), *((-1, part) for part in below)):
        for term in re.split(r"[ *.\u00b7]+", part.strip()):
            matched = _TERM.fullmatch(term)
            found = matched and _symbol(matched[1])
            if not (matched and found):
                return Unit(name)
            exponent = sign * int(matched[2] or 1)
            factor *= found[0] ** exponent
            for base, power in UNITS[found[1]].items():
                powers[base] = powers.get(base, 0) + exponent * power
    return Unit(name, {base: powers[base] for base in BASE if powers.get(base)}, factor, known=True)


def _symbol(text: str) -> tuple[float, str] | None:
    """Return the factor and the unit that a symbol stands for."""
    if text in UNITS:
        return 1.0, text
    if text in OTHERS:
        return OTHERS[text]
    prefix, rest = text[0], text[1:]
    if prefix in PREFIXES and rest in UNITS and rest not in ("1", "kg"):
        return PREFIXES[prefix], rest
    return None


def rate_unit(name: str) -> str:
    """Return the name of the unit of a derivative by the time in s."""
    if not name:
        return "1/s"
    above, *below = name.split("/")
    if not below:
        return f"{name}/s"
    last = re.fullmatch(r"s(?:\^?(\d+))?", below[0])
    if len(below) == 1 and last:
        return f"{above}/s{'^' if '^' in below[0] else ''}{int(last[1] or 1) + 1}"
    return f"({name})/s"
