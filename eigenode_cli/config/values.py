"""Checks of a composed configuration: missing and unknown settings, ranges, names, and what must fit together."""

import importlib
import re
from collections.abc import Callable, Iterator
from dataclasses import Field, fields
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.plugins import unresolved
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.validators import constraint_of
from eigenode_cli.engines.support import obstacle
from eigenode_cli.errors import nearest, unknown
from eigenode_cli.runs.paths import hidden
from eigenode_cli.terms import NAMES, split_grads, training_terms
from eigenode_cli.terms.arguments import arguments_of

NO_SYMBOLIC_JACOBIAN = ("polynomial",)
"""Networks without a Jacobian in closed form."""


def value_faults(config: DictConfig) -> list[str]:
    """All faults of a resolved configuration, one line each."""
    faults = list(_node_faults(config, TrainConfig, ""))
    if OmegaConf.missing_keys(config) or unresolved(config):
        return faults  # what must fit together can only be asked of a whole
    faults += [fault for check in CHECKS for fault in check(config)]
    if not config.terms or faults:
        return faults
    from eigenode_cli.config.rehearsal import rehearse  # noqa: PLC0415  # torch, only where there is an own term

    return list(rehearse(config))


def show(value: Any) -> str:
    """A value as the user would type it."""
    if OmegaConf.is_list(value):
        return f"[{','.join(show(element) for element in value)}]"
    if isinstance(value, float):
        return f"{value:g}"
    return "null" if value is None else str(value)


def _node_faults(node: DictConfig, schema: type[Any], prefix: str) -> Iterator[str]:
    """Faults of one node and of those below it."""
    known = {entry.name: entry for entry in fields(schema)}
    for name in node:
        if name not in known:
            guess = nearest(str(name), known)
            hint = f", did you mean {prefix}{guess}?" if guess else "; 'eigenode train --cfg job' lists all settings"
            yield f"{prefix}{name}={show(node[name])}: nothing reads this setting{hint}"
    for name, entry in known.items():
        key = f"{prefix}{name}"
        if not prefix and name in unresolved(node):
            continue  # `typify` has said why
        if name not in node or OmegaConf.is_missing(node, name):
            yield f"{key}: missing, write {key}=..."
            continue
        yield from _value_faults(node[name], entry, key)


def _value_faults(value: Any, entry: "Field[Any]", key: str) -> Iterator[str]:
    below = OmegaConf.get_type(value) if OmegaConf.is_dict(value) else None
    if below is not None and below is not dict:
        yield from _node_faults(value, below, f"{key}.")
    elif below is dict:
        for name, inner in value.items():
            yield from _value_faults(inner, entry, f"{key}.{name}")
    else:
        fault = constraint_of(entry).fault(value)
        if fault:
            yield f"{key}={show(value)}: {fault}"


def _terms(config: DictConfig) -> Iterator[str]:
    """Every word of `grads` and `trainer.pretrain`, every scale and every own term has a name that exists."""
    known = [*NAMES, *config.terms]
    for key, text in (("grads", config.grads), ("trainer.pretrain", config.trainer.pretrain)):
        words = [] if text is None else split_grads(text)
        for word in dict.fromkeys(words):
            if not word:
                yield f"{key}={text}: an empty term; join terms with +, for example {key}=sol+frq"
            elif word not in known:
                yield f"{key}={text}: {unknown('term', word, known)}"
            elif words.count(word) > 1:
                yield f"{key}={text}: term '{word}' is repeated; write it once"
    for name, factor in config.scale.items():
        if name not in known:
            yield f"scale.{name}={show(factor)}: {unknown('term', name, known)}"
    for name in NAMES:
        if name not in config.scale:
            yield f"scale.{name}: missing, write scale.{name}=..."


def _own_terms(config: DictConfig) -> Iterator[str]:
    """An own term has a name of its own and leads to a function; the user's module is imported here."""
    for name, path in config.terms.items():
        line = f"terms.{name}={path}"
        if name in NAMES:
            yield f"{line}: {name} is one of the six terms; choose another name"
        elif not re.fullmatch(r"[a-z][a-z0-9_]*", name):
            yield f"{line}: a term's name has lower-case letters, digits and _ only"
        elif not re.fullmatch(r"[\w.]+:\w+", path):
            yield f"{line}: not of the form module:function"
        else:
            fault = _import_fault(*path.split(":"))
            if fault:
                yield f"{line}: {fault}"


def _import_fault(module: str, function: str) -> str | None:
    own = hidden(module)
    if own is not None:
        return f"an installed module {module.partition('.')[0]} is taken, not {own}; rename yours"
    try:
        loaded = importlib.import_module(module)
    except Exception as error:  # the user's code may raise anything on import
        return f"cannot import {module} ({type(error).__name__}: {error})"
    candidate = getattr(loaded, function, None)
    if callable(candidate):
        try:
            arguments_of(candidate)
        except ValueError as error:
            return f"{function} of {module}: {error}"
        return None
    functions = [name for name, value in vars(loaded).items() if callable(value) and not name.startswith("_")]
    return f"module {module} has no such function; {unknown('function', function, functions)}"


def _system(config: DictConfig) -> Iterator[str]:
    """The dynamics exist, and states are named and counted right."""
    from eigenode_cli.config.build import build_system  # noqa: PLC0415  # NumPy, only for a line that is otherwise right

    system = config.system
    if any(_node_faults(system, OmegaConf.get_type(system), "system.")):
        return  # it may not be possible to build it
    try:
        states = [state.name for state in build_system(OmegaConf.to_object(system)).states]
    except Exception as error:  # the user's own constructor may raise anything
        yield f"system={system.name}: {error}"
        return
    if len(system.initial_state) != len(states):
        yield (
            f"system.initial_state={show(system.initial_state)}: {system.name} has {len(states)} states"
            f" ({', '.join(states)}), give one value for each"
        )
    if not system.observed:
        yield f"system.observed=[]: nothing is observed; choose from {', '.join(states)}"
    for name in dict.fromkeys(system.observed):
        if name not in states:
            yield f"system.observed={show(system.observed)}: {unknown('state', name, states)}"
        elif list(system.observed).count(name) > 1:
            yield f"system.observed={show(system.observed)}: state '{name}' is repeated; write it once"


def _network(config: DictConfig) -> Iterator[str]:
    """Structure and Jacobian are possible with this system and network."""
    states = len(config.system.initial_state)
    if config.network.structure == "second_order" and states % 2:
        yield (
            f"network.structure=second_order: needs as many velocities as positions, {config.system.name} has"
            f" {states} states; write network.structure=full"
        )
    if config.eigen.jacobian == "symbolic" and config.network.name in NO_SYMBOLIC_JACOBIAN:
        yield (
            f"eigen.jacobian=symbolic: {config.network.name} has no Jacobian in closed form;"
            " choose from autodiff, finite_difference"
        )


def _eigen(config: DictConfig) -> Iterator[str]:
    """There are at least as many data times as `every` counts."""
    if config.eigen.every > config.system.points:
        yield f"eigen.every={config.eigen.every}: must be at most system.points={config.system.points}"


def _trainer(config: DictConfig) -> Iterator[str]:
    """A growing horizon grows, up to the whole of it, and pre-training has terms and a part of the steps."""
    horizons = list(config.trainer.horizons)
    if not horizons or horizons != sorted(set(horizons)) or horizons[-1] != 1.0:
        yield (
            f"trainer.horizons={show(config.trainer.horizons)}: must be growing fractions that end with 1,"
            " for example [0.25,0.5,1]"
        )
    terms, share, steps = config.trainer.pretrain, config.trainer.pretrain_steps, config.trainer.steps
    if terms is None and share > 0:
        yield f"trainer.pretrain_steps={share}: no terms to train with; name them, for example trainer.pretrain=frq+dmp"
    if terms is not None and share == 0:
        yield f"trainer.pretrain={terms}: how long? write trainer.pretrain_steps=... (of trainer.steps={steps})"
    if 0 < steps <= share:
        yield f"trainer.pretrain_steps={share}: must be below trainer.steps={steps}, grads={config.grads} has the rest"
    trainer = config.trainer
    if trainer.spectral_steps > 0 and share > 0:
        yield (
            f"trainer.pretrain_steps={share}: trainer.spectral_steps={trainer.spectral_steps} is a pre-training, too;"
            " set one of them to 0"
        )
    if 0 < trainer.spectral_steps >= trainer.steps:
        yield (
            f"trainer.spectral_steps={trainer.spectral_steps}: must be below trainer.steps={trainer.steps},"
            " or nothing is ever solved"
        )


def _engine(config: DictConfig) -> Iterator[str]:
    """The compiled engine can do what is asked of it."""
    reason = obstacle(cast(TrainConfig, config))
    if config.engine.name == "compiled" and reason is not None:
        yield f"engine=compiled: it has no {reason}; write engine=torch or engine=auto"


def _target(config: DictConfig) -> Iterator[str]:
    """A corridor is one, and stated targets give the terms something to meet."""
    target = config.target
    corridor = target.stiffness
    if corridor is not None and not (len(corridor) == 2 and corridor[0] <= corridor[1]):
        yield f"target.stiffness={show(corridor)}: must be [low,high] with low at most high, for example [1,1]"
    if target.name != "stated":
        return
    count, pairs = len(target.frequency), len(config.system.initial_state) // 2
    if count != len(target.damping):
        yield (
            f"target.damping={show(target.damping)}: needs one value for each of the {count} in"
            f" target.frequency={show(target.frequency)}"
        )
    if count > pairs:
        yield f"target.frequency={show(target.frequency)}: {config.system.name} has room for {pairs} pair(s)"
    grads, pretrain = config.grads, config.trainer.pretrain
    for word in training_terms(grads, pretrain):
        key = f"grads={grads}" if word in split_grads(grads) else f"trainer.pretrain={pretrain}"
        if word in ("frq", "dmp", "osc") and count == 0:
            yield f"{key}: {word} has nothing to meet; state target.frequency and target.damping"
        if word == "stf" and corridor is None:
            yield f"{key}: stf has nothing to meet; state target.stiffness=[low,high]"


CHECKS: tuple[Callable[[DictConfig], Iterator[str]], ...] = (
    _terms,
    _system,
    _network,
    _eigen,
    _trainer,
    _engine,
    _target,
    _own_terms,
)
"""What must fit together, in the order of the lines printed."""
