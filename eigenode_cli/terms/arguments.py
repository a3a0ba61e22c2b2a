"""What a term of the user's own asks for, read off the names of its arguments. Light: the command line is checked with it."""

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
    parameter = inspect.Parameter
    listed = list(inspect.signature(function).parameters.values())
    for one in listed:
        named = one.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        if one.default is parameter.empty and not (named and one.name in ARGUMENTS):
            raise ValueError(unknown("argument", one.name, ARGUMENTS))
    return tuple(one.name for one in listed if one.name in ARGUMENTS)
