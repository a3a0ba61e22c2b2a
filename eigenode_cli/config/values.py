"""Checks of a composed configuration: missing and unknown settings, ranges, names, and what must fit together."""

import importlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import Field, fields
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.names import STABILISING, named_terms, training_terms
from eigenode_cli.config.outline import Outline, is_table, outline_of
from eigenode_cli.config.plugins import unresolved
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.config.target_values import target_faults
from eigenode_cli.config.validators import constraint_of, show
from eigenode_cli.engines.support import obstacle
from eigenode_cli.errors import UserError, nearest, unknown
from eigenode_cli.runs.paths import hidden
from eigenode_cli.terms import NAMES, SPECTRAL, split_grads
from eigenode_cli.terms.arguments import arguments_of

MLP = "eigenode_cli.model:Mlp"
"""The network that the compiled engine knows."""
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
    if OmegaConf.is_list(value) and any(OmegaConf.is_dict(item) for item in value):
        for number, item in enumerate(value):
            yield from _node_faults(item, cast(type, OmegaConf.get_type(item)), f"{key}.{number}.")
        return
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
    """Every word of `grads` and of a stage's terms, every scale and every own term has a name that exists."""
    known = [*NAMES, *config.terms]
    for key, text in named_terms(config):
        words = split_grads(text)
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
    """Yield an own term has a name of its own and leads to a function; the user's module is imported here."""
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
    """Yield the dynamics exist, and states are named and counted right; or a table is read."""
    from eigenode_cli.config.build import build_system  # noqa: PLC0415  # NumPy, only for a line that is otherwise right

    system = config.system
    if any(_node_faults(system, cast(type, OmegaConf.get_type(system)), "system.")):
        return  # it may not be possible to build it
    if is_table(system):
        yield from _table(config)
        return
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
    for key in ("observed", "initial_known"):
        yield from _state_names(f"system.{key}", system[key] or [], states)


def _table(config: DictConfig) -> Iterator[str]:
    """Yield the roles of a table's columns fit together, and it can be read."""
    from eigenode_cli.config.table import measured_of, role_faults  # noqa: PLC0415  # pandas, only where it is needed

    system = cast(TableConfig, OmegaConf.to_object(config.system))
    faults = list(role_faults(system, config.network.structure))
    if not faults:
        try:
            measured_of(system)
        except UserError as error:
            faults = error.faults
    yield from faults


def _outline(config: DictConfig) -> Outline | None:
    """Return the shapes of the system; None where `_system` says what is wrong with it."""
    if is_table(config.system) and any(_system(config)):
        return None
    try:
        return outline_of(config.system)
    except Exception:  # `_system` says so
        return None


def _state_names(key: str, names: Iterable[str], states: list[str]) -> Iterator[str]:
    """Yield a list of states names some that there are, each once."""
    given = list(names)
    for name in dict.fromkeys(given):
        if name not in states:
            yield f"{key}={show(names)}: {unknown('state', name, states)}"
        elif given.count(name) > 1:
            yield f"{key}={show(names)}: state '{name}' is repeated; write it once"


def _own_classes(config: DictConfig) -> Iterator[str]:
    """Yield a solver or an optimizer of the user's own can be built, and a solver has a tableau."""
    from eigenode_cli.config.build import build_own_method, build_solver  # noqa: PLC0415  # as above

    if "target" in config.solver:
        try:
            solver = build_solver(cast(Any, OmegaConf.to_object(config.solver)))
        except Exception as error:  # the user's own constructor may raise anything
            yield f"solver={config.solver.name}: {type(error).__name__}: {error}"
        else:
            if solver.tableau is None:
                yield f"solver={config.solver.name}: the class has no tableau; give it one with en.explicit(...)"
    if "target" in config.optimizer:
        try:
            build_own_method(cast(Any, OmegaConf.to_object(config.optimizer))).memory(1)
        except Exception as error:  # as above
            yield f"optimizer={config.optimizer.name}: {type(error).__name__}: {error}"


def _hidden_states(config: DictConfig) -> Iterator[str]:
    """Yield what needs all states at the data times finds them measured, or they can be reconstructed."""
    found = _outline(config)
    if found is None or not found.observed or not set(found.observed) <= set(found.states):
        return  # `_system` says so
    hidden_ones = _not_to_be_known(list(found.states), list(found.observed), config.network.structure)
    if not hidden_ones:
        return
    reason = (
        f"needs all states at the data times, and nothing is known of {', '.join(hidden_ones)} (a velocity follows from"
        " its position and the other way round with network.structure=second_order)"
        + ("" if is_table(config.system) else "; add to system.observed")
    )
    for number, stage in enumerate(config.stages):
        for key, value, applies in (("solve", "false", not stage.solve), ("spectra", "data", stage.spectra == "data")):
            if applies:
                yield f"stages.{number}.{key}={value}: {reason}"
    if config.trainer.on_unsolvable in STABILISING and set(training_terms(config)) - {"sol"}:
        yield f"trainer.on_unsolvable={config.trainer.on_unsolvable}: {reason}, or write trainer.on_unsolvable=skip"
    scalings = [key for key in ("input_scaling", "output_scaling") if config.network.get(key) == "max_abs"]
    if scalings and config.network.scaling_from == "data":
        yield f"network.{scalings[0]}=max_abs: {reason}"


def _not_to_be_known(states: list[str], observed: list[str], structure: str) -> list[str]:
    """Names of the states that were neither measured nor can be reconstructed."""
    half = len(states) // 2
    missing = []
    for number, name in enumerate(states):
        partner = states[(number + half) % len(states)] if structure == "second_order" else name
        if name not in observed and partner not in observed:
            missing.append(name)
    return missing


def _network(config: DictConfig) -> Iterator[str]:
    """Structure and Jacobian are possible with this system and network."""
    found = _outline(config)
    states = 0 if found is None else len(found.states)
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
    found = _outline(config)
    if found is not None and config.eigen.every > found.points:
        said = f"the {found.points} data times" if is_table(config.system) else f"system.points={found.points}"
        yield f"eigen.every={config.eigen.every}: must be at most {said}"


def _stages(config: DictConfig) -> Iterator[str]:
    """Each stage has something to train, and together they take all steps."""
    stages, steps = config.stages, config.trainer.steps
    if not stages:
        yield "stages=[]: nothing is trained; write at least stages=[{horizons:[1.0]}]"
    for number, stage in enumerate(stages):
        key, horizons = f"stages.{number}", list(stage.horizons)
        if not horizons or horizons != sorted(set(horizons)):
            yield f"{key}.horizons={show(stage.horizons)}: must be growing fractions, for example [0.25,0.5,1]"
        elif number == len(stages) - 1 and horizons[-1] != 1.0:
            yield f"{key}.horizons={show(stage.horizons)}: the last one must be 1, the whole horizon"
        terms = split_grads(config.grads if stage.terms is None else stage.terms)
        if not (stage.solve or set(terms) & set(SPECTRAL)):
            yield f"{key}.solve=false: {'+'.join(terms)} has no term of the spectrum, so that nothing trains"
        blocks = _blocks(config)
        if stage.trained is not None and not set(stage.trained) <= set(blocks):
            yield f"{key}.trained={show(stage.trained)}: there is no such block; this run has {', '.join(blocks)}"
        if not stage.solve and horizons != [1.0]:
            yield f"{key}.horizons={show(stage.horizons)}: no effect, as {key}.solve=false solves nothing"
    named = sum(stage.steps or 0 for stage in stages)
    shares = sum(stage.steps is None for stage in stages)
    if 0 < steps < named + shares:
        yield f"trainer.steps={steps}: the stages take {named} of them, {shares} more share the rest; give more steps"
    elif stages and shares == 0 and 0 < steps != named:
        yield f"trainer.steps={steps}: the stages take {named} of them; leave out the steps of one, which has the rest"


def _optimizer(config: DictConfig) -> Iterator[str]:
    """Yield a retry that nothing can use, and what least squares has no residuals for."""
    retried = config.trainer.on_unsolvable == "retry"
    if retried and (config.optimizer.name == "lm" or "target" in config.optimizer):
        yield (
            f"trainer.on_unsolvable=retry: optimizer={config.optimizer.name} chooses its steps by itself; write"
            " trainer.on_unsolvable=stabilise"
        )
    if config.optimizer.name != "lm":
        return
    for word in training_terms(config):
        allowed = ("mse", "huber") if word == "sol" else ("mse",)
        if word not in NAMES:
            yield f"optimizer=lm: {word} is a term of your own, which has no residuals; train it with optimizer=adam"
        elif config.error[word] not in allowed:
            yield f"error.{word}={config.error[word]}: optimizer=lm needs squares; write error.{word}=mse"
    for number, stage in enumerate(config.stages):
        if not stage.solve:
            yield f"stages.{number}.solve=false: optimizer=lm takes its residuals along a solution"
        if stage.spectra == "data":
            yield f"stages.{number}.spectra=data: optimizer=lm takes its spectra along the trajectory"


def _blocks(config: DictConfig) -> list[str]:
    """Names of the blocks of parameters that the run has."""
    found = _outline(config)
    own = {} if found is None else found.blocks
    return [
        "network",
        *(["linear"] if config.network.linear != "none" else []),
        *(name for name, size in own.items() if size > 0),
    ]


def _start(config: DictConfig) -> Iterator[str]:
    """Yield a warm start leads to weights that fit."""
    text = config.trainer.start
    if text is None or _outline(config) is None:
        return
    from eigenode_cli.config.warm_start import empty_field, load_field  # noqa: PLC0415  # torch, where it is needed

    try:
        load_field(empty_field(cast(TrainConfig, OmegaConf.to_object(config))), text)
    except (UserError, ValueError) as error:
        yield f"trainer.start={text}: {error}"


def _engine(config: DictConfig) -> Iterator[str]:
    """Yield the compiled engine can do what is asked of it."""
    network = "mlp" if config.network.target == MLP else config.network.name
    solver = None if "target" in config.solver else config.solver.name
    reason = obstacle(network, solver, config.eigen.jacobian)
    if config.engine.name == "compiled" and reason is not None:
        yield f"engine=compiled: it has no {reason}; write engine=torch or engine=auto"


def _target(config: DictConfig) -> Iterator[str]:
    """Yield targets are stated right, and give the terms something to meet."""
    return target_faults(config, _outline(config))


CHECKS: tuple[Callable[[DictConfig], Iterator[str]], ...] = (
    _terms,
    _system,
    _hidden_states,
    _own_classes,
    _network,
    _eigen,
    _stages,
    _optimizer,
    _start,
    _engine,
    _target,
    _own_terms,
)
"""What must fit together, in the order of the lines printed."""
