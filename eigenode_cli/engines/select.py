"""Which engine a run gets, and the user's own terms."""

import importlib
from typing import cast

from eigenode_cli.engines.torch_engine import TorchEngine, UserTerm
from eigenode_cli.field import VectorField
from eigenode_cli.problem import Problem


def load_user_terms(paths: dict[str, str]) -> dict[str, UserTerm]:
    """The user's own terms, imported from their `module:function`.

    Raises:
        ValueError: a path that does not lead to a function.
    """
    terms: dict[str, UserTerm] = {}
    for name, path in paths.items():
        module, _, function = path.partition(":")
        try:
            candidate = cast(UserTerm, getattr(importlib.import_module(module), function))
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"terms.{name}={path}: {error}") from error
        if not callable(candidate):
            raise ValueError(f"terms.{name}={path}: not a function")
        terms[name] = candidate
    return terms


def build_engine(name: str, field: VectorField, problem: Problem, user_terms: dict[str, UserTerm]) -> TorchEngine:
    """The engine that `engine=` asks for."""
    del name
    return TorchEngine(field, problem, user_terms)
