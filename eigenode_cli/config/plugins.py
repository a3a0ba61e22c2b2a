"""Classes that a configuration names by `target: module:Class`: the shipped ones and the user's own.

A choice of such a group has the group's own options and the constructor's. The schema of a shipped class stands in
`config.schema`, so that a command line is checked without importing torch; that of any other class is made from its
constructor's signature, and both are checked in the same way.
"""

import importlib
import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, make_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf, open_dict

from eigenode_cli.config.optimizer_schema import OwnOptimizerConfig
from eigenode_cli.config.schema import (
    MlpConfig,
    NetworkConfig,
    OscillatorConfig,
    OwnSolverConfig,
    PolynomialConfig,
    SystemConfig,
    VanDerPolConfig,
)
from eigenode_cli.config.validators import Constraint
from eigenode_cli.errors import nearest, unknown

CUSTOM = "custom"
"""The choice that `GROUP=module:Class` stands for."""
BOUNDS = {"gt": "above", "ge": "at_least", "lt": "below", "le": "at_most"}
"""Attributes of `annotated_types.Gt` and its like, and the constraint that each one is."""

ALIASES = {
    "learning_rate": "lr",
    "step_size": "lr",
    "epochs": "steps",
    "iterations": "steps",
    "max_iter": "steps",
    "tol": "rtol",
    "relative_tolerance": "rtol",
    "absolute_tolerance": "atol",
    "layers": "hidden",
    "width": "hidden",
    "random_seed": "seed",
    "loss": "grads",
    "terms": "grads",
}
"""Names that other programs have for a setting."""


class PluginError(ValueError):
    """A `target` that does not lead to a class which this group can use; the message is one line."""


@dataclass(frozen=True)
class Group:
    """A config group whose choices name a class.

    Attributes:
        base: schema of the options that every choice has.
        shipped: schema of each shipped class, by its target.
        given: constructor arguments that the program passes, not the user.
        interface: `module:Class` that a user's class must derive from.
    """

    base: type
    shipped: Mapping[str, type]
    given: tuple[str, ...]
    interface: str


GROUPS: Mapping[str, Group] = {
    "system": Group(
        base=SystemConfig,
        shipped={
            "eigenode_cli.systems:Oscillator": OscillatorConfig,
            "eigenode_cli.systems:VanDerPol": VanDerPolConfig,
        },
        given=(),
        interface="eigenode_cli.systems:System",
    ),
    "network": Group(
        base=NetworkConfig,
        shipped={"eigenode_cli.model:Mlp": MlpConfig, "eigenode_cli.model:Polynomial": PolynomialConfig},
        given=("inputs", "outputs", "generator"),
        interface="torch.nn:Module",
    ),
    "solver": Group(
        base=OwnSolverConfig,
        shipped={},
        given=("name",),
        interface="eigenode_cli.solve.settings:RungeKutta",
    ),
    "optimizer": Group(
        base=OwnOptimizerConfig,
        shipped={},
        given=("lr",),
        interface="eigenode_cli.training.methods:OwnMethod",
    ),
}
"""The groups whose choices name a class."""


def expanded(words: Iterable[str]) -> list[str]:
    """Override words as Hydra composes them: `system=module:Class` is the choice `custom` with that target."""
    result = []
    for word in words:
        key, _, value = word.partition("=")
        if key in GROUPS and ":" in value and not value.startswith("["):
            result += [f"{key}={CUSTOM}", f"{key}.target={value}"]
        elif key.removesuffix(".target") in GROUPS and key.endswith(".target"):
            result += [f"{key.removesuffix('.target')}={CUSTOM}", word]
        else:
            result.append(word)
    return result


def forced(words: Iterable[str]) -> list[str]:
    """Return checked words as Hydra accepts them for the options of a user's class, which it does not know."""
    return [f"++{word}" if word.partition(".")[0] in GROUPS else word for word in words]


def unforced(words: Iterable[str]) -> list[str]:
    """Return words as the user typed them, of those that were `forced`."""
    return [word.removeprefix("++") if word.lstrip("+").partition(".")[0] in GROUPS else word for word in words]


def load_class(target: str) -> type[Any]:
    """Import the class that `module:Class` names.

    Raises:
        PluginError: there is no such module or class.
    """
    module, _, name = target.partition(":")
    if not module or not name:
        raise PluginError("not of the form module:Class")
    try:
        loaded = importlib.import_module(module)
    except Exception as error:  # the user's code may raise anything on import
        raise PluginError(f"cannot import {module} ({type(error).__name__}: {error})") from error
    found = getattr(loaded, name, None)
    if not isinstance(found, type):
        own = vars(loaded).items()
        classes = [key for key, value in own if isinstance(value, type) and value.__module__ == module]
        raise PluginError(f"module {module} has no such class; {unknown('class', name, classes)}")
    return found


@cache
def schema_of(group: str, target: str) -> type:
    """Return the schema of the choice of a group that names the class `target`.

    Raises:
        PluginError: the class cannot be imported or used.
    """
    kind = GROUPS[group]
    if target in kind.shipped:
        return kind.shipped[target]
    plugin = load_class(target)
    if not issubclass(plugin, load_class(kind.interface)):
        raise PluginError(f"{plugin.__name__} does not derive from {kind.interface.replace(':', '.')}")
    taken = {entry.name for entry in fields(kind.base)}
    options = []
    hints = get_type_hints(plugin.__init__, include_extras=True)
    for name, parameter in inspect.signature(plugin).parameters.items():
        if name in kind.given:
            continue
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD, parameter.POSITIONAL_ONLY):
            raise PluginError(f"{plugin.__name__}: every argument needs a name, {parameter} has none")
        if name in taken:
            raise PluginError(f"{plugin.__name__}: its argument '{name}' has the name of an option of {group}")
        options.append(_option(plugin, name, hints.get(name), parameter.default))
    return make_dataclass(f"{plugin.__name__}Config", options, bases=(kind.base,))


def _option(plugin: type, name: str, hint: Any, default: Any) -> tuple[str, Any, "Field[Any]"]:
    """Return a field of a schema for one argument of a constructor."""
    constraint: dict[str, Any] = {}
    if get_origin(hint) is Annotated:
        hint, *notes = get_args(hint)
        for note in notes:
            constraint |= {word: getattr(note, bound) for bound, word in BOUNDS.items() if hasattr(note, bound)}
    if get_origin(hint) is Literal:
        constraint["choices"] = get_args(hint)
        hint = str
    plain = _plain_type(hint)
    if plain is None:
        raise PluginError(
            f"{plugin.__name__}: its argument '{name}' needs a type: float, int, str, bool, or a list of them"
        )
    metadata = {"constraint": Constraint(**constraint)}
    entry: Any  # a Field, which type checkers take for its default
    if default is inspect.Parameter.empty:
        entry = field(default=MISSING, metadata=metadata)
    elif isinstance(default, Sequence) and not isinstance(default, str):
        entry = field(default_factory=lambda: list(default), metadata=metadata)
    else:
        entry = field(default=default, metadata=metadata)
    return name, plain, entry


def _plain_type(hint: Any) -> Any:
    """Return the type that OmegaConf checks for an annotation, None for one that no configuration can hold."""
    if hint in (float, int, str, bool):
        return hint
    if get_origin(hint) in (Union, UnionType):
        inner = [part for part in get_args(hint) if part is not NoneType]
        plain = _plain_type(inner[0]) if len(inner) == 1 and len(get_args(hint)) == 2 else None
        return None if plain is None else plain | None
    if get_origin(hint) in (list, Sequence) and get_args(hint)[0] in (float, int, str, bool):
        return list[get_args(hint)[0]]
    return None


def typify(config: DictConfig) -> list[str]:
    """Give the nodes of the user's own classes their schema, in place; returns the faults, one line each."""
    faults = []
    for group in _present(config):
        if not OmegaConf.is_dict(config[group]):
            faults.append(f"{group}: {config[group]!r} is not a set of options")
        elif OmegaConf.get_type(config[group]) is dict:
            faults += _typify(config, group)
    return faults


def _typify(config: DictConfig, group: str) -> list[str]:
    node = config[group]
    if "target" not in node or OmegaConf.is_missing(node, "target"):
        return [f"{group}.target: missing, name your class, for example {group}=my_module:MyClass"]
    try:
        schema = schema_of(group, node.target)
    except PluginError as error:
        return [f"{group}.target={node.target}: {error}"]
    known = [entry.name for entry in fields(schema)]
    faults = []
    with open_dict(node):
        for name in [name for name in node if name not in known]:
            faults.append(f"{group}.{name}: {no_option(config, group, str(name), known)}")
            del node[name]
    if node.name == CUSTOM:
        node.name = node.target.rpartition(":")[2].lower()
    config[group] = OmegaConf.merge(OmegaConf.structured(schema), node)
    return faults


def unresolved(config: DictConfig) -> list[str]:
    """Return the groups whose class could not be found out, so that nothing can be said of their options."""
    nodes = {group: config[group] for group in _present(config)}
    return [group for group, node in nodes.items() if not OmegaConf.is_dict(node) or OmegaConf.get_type(node) is dict]


def _present(config: DictConfig) -> list[str]:
    """Return the groups that a configuration holds."""
    return [group for group in GROUPS if group in config and not OmegaConf.is_missing(config, group)]


def config_choice(config: DictConfig, group: str) -> str | None:
    """Name of the choice that was made of a group, None in a configuration without its `hydra` node."""
    return config.hydra.runtime.choices.get(group) if "hydra" in config else None


def no_option(config: DictConfig, group: str, name: str, options: Iterable[str]) -> str:
    """Return what to say of an option that the choice of a group does not have."""
    options = [option for option in options if option not in ("name", "target")]
    alias = ALIASES.get(name.lower())
    guess = alias if alias in options else nearest(name, options)
    hint = f", did you mean {group}.{guess}?" if guess else ""
    choice = config_choice(config, group) or config[group].name
    return f"{choice} has no option '{name}'{hint} (it has: {', '.join(options) or 'none'})"


def own_options(config: Any, base: type) -> dict[str, Any]:
    """Return the options of a typed node that its class adds to those of `base`: arguments of its constructor."""
    shared = {entry.name for entry in fields(base)}
    return {entry.name: getattr(config, entry.name) for entry in fields(config) if entry.name not in shared}
