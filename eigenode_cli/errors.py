"""Mistakes of the user: collected, said in one line each, answered with the exit code 2."""

import difflib
from collections.abc import Iterable, Sequence

MOST = 12
"""Longest list of options that one line of an error shows."""
LEAST, OTHERWISE = 0.6, 0.85
"""How like (0 to 1) a name must be to be offered, and how like if it begins with another letter."""


class UserError(Exception):
    """What the user asked for cannot be done; one line for each fault, none of them a traceback."""

    def __init__(self, faults: str | Sequence[str]) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))


def nearest_first(name: str, options: Iterable[str]) -> list[str]:
    """Return the options, those most like `name` first."""

    def unlikeness(option: str) -> float:
        return -difflib.SequenceMatcher(None, name.lower(), option.lower()).ratio()

    return sorted(options, key=unlikeness)


def nearest(name: str, options: Iterable[str]) -> str | None:
    """Return the option that `name` was probably meant to be, or None."""
    spelt = {option.lower(): option for option in options}
    close = difflib.get_close_matches(name.lower(), list(spelt), n=1, cutoff=LEAST)
    if close and close[0][:1] != name[:1].lower():
        close = difflib.get_close_matches(name.lower(), close, cutoff=OTHERWISE)
    return spelt[close[0]] if close else None


def unknown(kind: str, name: str, options: Iterable[str]) -> str:
    """`unknown <kind> '<name>'` with the nearest option, if one is near, and all of them."""
    ordered = nearest_first(name, options)
    guess = nearest(name, ordered)
    hint = f", did you mean {guess}?" if guess else ";"
    more = ", ..." if len(ordered) > MOST else ""
    return f"unknown {kind} '{name}'{hint} choose from {', '.join(ordered[:MOST])}{more}"
