"""What a term of the user's own asks for, read off the names of its arguments.

Light: the command line is checked with it.
"""

import inspect
from collections.abc import Callable
from typing import Any

from eigenode_cli.errors import unknown

ARGUMENTS = ("trajectory", "spectra", "times", "data", "field")
"""What there is to ask for: see `terms.user.UserTerm`."""


def arguments_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the `ARGUMENTS` that a function takes, in its own order; others it may have if they have defaults.

    Raises:
        ValueError: it asks for something that there is not, or not by name, or its signature cannot be read.
    """
    kind = inspect.Parameter
    rest = (kind.VAR_POSITIONAL, kind.VAR_KEYWORD)
    listed = [one for one in inspect.signature(function).parameters.values() if one.kind not in rest]
    for one in listed:
        if one.kind is kind.POSITIONAL_ONLY:
            raise ValueError(f"argument '{one.name}' can't be given by name; take the / out of the function's head")
        if one.default is kind.empty and one.name not in ARGUMENTS:
            raise ValueError(unknown("argument", one.name, ARGUMENTS))
    return tuple(one.name for one in listed if one.name in ARGUMENTS)
