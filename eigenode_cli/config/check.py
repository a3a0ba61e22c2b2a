"""Checks of what the user typed: every override by itself, then the configuration that they make together.

One composition gives the ground (the choices of groups); each further override is applied to it singly, so that
a wrong one is named and the others are still checked.
"""

import copy
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra.core.override_parser.types import Override, OverrideType, ValueType
from hydra.errors import HydraException
from omegaconf import DictConfig, ListConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

from eigenode_cli.config.composer import DIFFERENCES, Composer, explain, hydra_values
from eigenode_cli.config.ineffective import late_faults
from eigenode_cli.config.plugins import ALIASES, CUSTOM, GROUPS, config_choice, expanded, no_option, typify, unresolved
from eigenode_cli.config.unused import useless_options
from eigenode_cli.config.values import value_faults
from eigenode_cli.errors import UserError, nearest, unknown
from eigenode_cli.terms import NAMES, canonical, split_grads

MOVED = {
    "trainer.spectral_steps": "'stages=[{steps:1000,solve:false},{}]'",
    "trainer.pretrain": "'stages=[{terms:frq+dmp,steps:1000},{}]'",
    "trainer.pretrain_steps": "'stages=[{terms:frq+dmp,steps:1000},{}]'",
    "trainer.horizons": "'stages=[{horizons:[0.5,1]}]'",
    "eigen.at": "stages.0.spectra=data",
    "optimizer.lr_extra": "schedule=exponential schedule.extra=9e-3",
    "optimizer.lr_rate": "schedule=exponential schedule.rate=2e-3",
    "optimizer.lr_every": "schedule=exponential schedule.every=10",
}
"""Settings of earlier versions, and what says the same today."""
TYPES = {"Integer": "a whole number", "Float": "a number", "bool": "true or false"}


@dataclass
class Examined:
    """What came out of a command line.

    Attributes:
        config: the configuration with its `hydra` node, as far as it could be made; None if not at all.
        faults: one line each.
        useless: faults of options that nothing reads, by the key typed (in a sweep another job may read it).
    """

    config: DictConfig | None
    faults: list[str]
    useless: dict[str, str] = field(default_factory=dict)

    def checked(self) -> DictConfig:
        """Return the configuration, if nothing is wrong with it.

        Raises:
            UserError: with all faults.
        """
        faults = list(dict.fromkeys([*self.faults, *self.useless.values()]))
        if faults or self.config is None:
            raise UserError(faults)
        return self.config


def normalise(words: Sequence[str]) -> list[str]:
    """Return the words as Hydra is to get them.

    Known terms in `grads` stand in canonical order, so that folders of a sweep are named by it. What adds the user's
    own terms or their scales has the form that Hydra accepts for new keys. A class that is named in place of a choice
    becomes the choice `custom` and its target.
    """
    return expanded(_normal(word) for word in words)


def _normal(word: str) -> str:
    if re.fullmatch(r"grads=[\w+,]+", word):
        sums = [split_grads(part) for part in word.removeprefix("grads=").split(",")]
        if all(term in NAMES for terms in sums for term in terms):
            return "grads=" + ",".join("+".join(canonical(terms)) for terms in sums)
    match = re.match(r"\+{0,2}(terms|scale)\.([^.=]+)=", word)
    new = match is not None and (match[1] == "terms" or match[2] not in NAMES)
    return "++" + word.lstrip("+") if new else word


def parse(composer: Composer, words: Sequence[str]) -> tuple[list[Override], list[str]]:
    """Return the words as overrides, and a fault for each that is none."""
    overrides, faults = [], []
    for word in words:
        try:
            overrides.append(composer.parser.parse_override(word))
        except HydraException as error:
            faults.append(_grammar_fault(word, error))
    return overrides, faults


def examine(composer: Composer, words: Sequence[str], ground: bool = False) -> Examined:
    """Check the words of one run, or those that are the `ground` of a sweep, whose runs are still to be checked."""
    overrides, faults = parse(composer, words)
    single = []
    for override in overrides:
        if override.is_sweep_override():
            faults.append(_sweep_fault(override))
        else:
            single.append(override)
    found = examine_overrides(composer, single)
    found.faults[:0] = faults
    if not (ground or found.faults or found.useless):
        found.faults += without_effect(found)
    return found


def without_effect(examined: Examined) -> list[str]:
    """Faults of what has no effect on this system, of a configuration without other faults."""
    config = examined.config
    return [] if config is None else late_faults(_resolved(config))


def examine_overrides(composer: Composer, overrides: Sequence[Override]) -> Examined:
    """Check the overrides of one run, none of them a sweep."""
    faults: list[str] = []
    ground: list[str] = []
    values: list[Override] = []
    paths = [_line(o) for o in overrides if o.get_key_element() == "hydra.searchpath"]
    try:
        for override in overrides:
            if override.get_key_element() == "hydra.searchpath":
                ground.append(_line(override))
            elif override.package is None and composer.choices(override.key_or_group, paths):
                fault = _choice_fault(composer, override, paths)
                if fault is None:
                    ground.append(_line(override))
                else:
                    faults.append(fault)
            else:
                values.append(override)
        config = composer.composed(tuple(ground))
    except UserError as error:
        return Examined(None, [*faults, *(_absent_groups(composer, overrides, paths) or error.faults)])
    values.sort(key=lambda override: not _key(override).startswith("terms"))  # the names that other settings may have
    targets = [override for override in values if _is_target(override)]
    with hydra_values(config):
        faults += [fault for override in targets if (fault := _apply(config, override))]
        faults += typify(config)
        open_groups = unresolved(config)  # why is said; which options they have is not known
        others = [o for o in values if o not in targets and _key(o).partition(".")[0] not in open_groups]
        faults += [fault for override in others if (fault := _apply(config, override))]
    return _examine_config(config, values, faults)


def _examine_config(config: DictConfig, values: Sequence[Override], faults: list[str]) -> Examined:
    try:
        resolved = _resolved(config)
    except OmegaConfBaseException as error:
        typed = next((_line(override) for override in values if "${" in _line(override)), None)
        return Examined(config, [*faults, f"{typed or error.full_key}: {explain(error)}"])
    wrong = value_faults(resolved)
    useless = {} if wrong or faults else useless_options(resolved, [*_typed_keys(values)])
    return Examined(config, [*faults, *wrong], useless)


def _resolved(config: DictConfig) -> DictConfig:
    """Return a copy with every interpolation resolved, without the `hydra` node."""
    resolved = copy.deepcopy(config)
    with hydra_values(config), open_dict(resolved):
        del resolved["hydra"]
        OmegaConf.resolve(resolved)
    return resolved


def _is_target(override: Override) -> bool:
    """Whether it names the class of a choice, which decides about the options that there are."""
    group, _, last = override.get_key_element().rpartition(".")
    return last == "target" and group in GROUPS


def _choice_fault(composer: Composer, override: Override, paths: list[str]) -> str | None:
    group, value = override.key_or_group, override.value()
    options = composer.choices(group, paths)
    line = _line(override)
    if group in DIFFERENCES or group.startswith("schema/"):
        return f"{line}: {_unknown_key(composer.composed(()), group)}"
    if override.is_delete():
        return f"{line}: every run needs one; choose {group}=..."
    if value not in options:
        return f"{line}: {unknown(group, str(value), options)}"
    if override.type is not OverrideType.CHANGE and group in composer.defaults:
        return f"{line}: there is one chosen already; write {group}={value}"
    return None


def _absent_groups(composer: Composer, overrides: Sequence[Override], paths: list[str]) -> list[str]:
    """Return a fault for each group of the user's own that no default chooses from and that has no plus."""
    try:
        absent = [
            override
            for override in overrides
            if override.type is OverrideType.CHANGE
            and composer.choices(override.key_or_group, paths)
            and override.key_or_group not in composer.defaults
        ]
    except UserError:
        return []
    return [f"{_line(override)}: no group of the defaults; write +{_line(override)}" for override in absent]


def _apply(config: DictConfig, override: Override) -> str | None:
    """Apply one override in place as Hydra does; returns what is wrong with it."""
    key, value = _key(override), override.value()
    fault = _refusal(config, override)
    if fault is None:
        try:
            OmegaConf.update(config, key, value, merge=True, force_add=override.type is not OverrideType.CHANGE)
        except (ConfigAttributeError, ConfigKeyError):
            fault = _unknown_key(config, key)
        except ValidationError as error:
            fault = _type_fault(key, value, error)
        except (OmegaConfBaseException, AttributeError) as error:  # the latter where a dictionary was null before
            fault = explain(error)
    return f"{_line(override)}: {fault}" if fault else None


def _refusal(config: DictConfig, override: Override) -> str | None:
    """Why an override may not be applied at all, whatever its value."""
    key, value = _key(override), override.value()
    group, _, last = key.rpartition(".")
    fixed = last == "name" or (last == "target" and config_choice(config, group) != CUSTOM)
    if fixed and group in config.hydra.runtime.choices:
        return f"follows from the choice; write {group}=..."
    if group == "error" and last in config.terms and last not in config.error:
        return (
            f"a term of your own returns its error itself; only the six terms have error functions ({', '.join(NAMES)})"
        )
    try:
        present = OmegaConf.select(config, key, throw_on_missing=False) is not None
    except (ConfigAttributeError, ConfigKeyError):
        present = False
    if override.is_delete():
        return f"nothing can be taken away; write {key}=..." if present else _unknown_key(config, key)
    if override.is_add() and present and not isinstance(value, dict | list):
        return f"the setting is there already; write {key}={override.get_value_element_as_str()}"
    return None


def _unknown_key(config: DictConfig, key: str) -> str:
    if key in MOVED:
        return f"another setting says it now, for example {MOVED[key]}"
    group, _, last = key.rpartition(".")
    choices = config.hydra.runtime.choices
    if group in choices and OmegaConf.is_dict(config[group]):
        return no_option(config, group, last, map(str, config[group]))
    keys = list(_keys(config)) if key.startswith("hydra") else [k for k in _keys(config) if not k.startswith("hydra")]
    siblings = {k.rpartition(".")[2]: k for k in keys if group and k.rpartition(".")[0] == group}
    same = [k for k in keys if k.rpartition(".")[2] in (last, ALIASES.get(last.lower()))]
    near = siblings.get(nearest(last, siblings) or "")
    guess = near or (same[0] if same else nearest(key, keys) or _by_last_part(last, keys))
    hint = f", did you mean {guess}?" if guess else ";"
    return f"unknown setting '{key}'{hint} 'eigenode train --cfg job' lists all"


def _by_last_part(last: str, keys: Sequence[str]) -> str | None:
    parts = {key.rpartition(".")[2]: key for key in keys}
    guess = nearest(last, parts)
    likely = guess is not None and 2 * len(guess) > len(last)  # damping is no mistyped dmp
    return parts[guess] if guess is not None and likely else None


def _keys(node: DictConfig, prefix: str = "") -> Iterator[str]:
    """Dotted keys of all settings, groups included."""
    for name in node:
        key = f"{prefix}{name}"
        yield key
        child = None if OmegaConf.is_missing(node, name) else node._get_node(name)
        if isinstance(child, DictConfig) and not child._is_none():
            yield from _keys(child, f"{key}.")
        elif isinstance(child, ListConfig) and not child._is_none():
            for number, item in enumerate(child):
                if isinstance(item, DictConfig):
                    yield from _keys(item, f"{key}.{number}.")


def _type_fault(key: str, value: Any, error: ValidationError) -> str:
    message = str(error).splitlines()[0]
    if key == "grads" and isinstance(value, list | dict):
        return "terms are joined by +, for example grads=sol+frq"
    if value is None:
        return "must have a value"
    if "ListConfig" in message:
        return f"not a list; write {key}=[{value}]"
    match = re.search(r"converted to (\w+)|a valid (bool)", message)
    wanted = TYPES.get(match[1] or match[2]) if match else None
    if wanted is None:
        return message
    culprit = f"'{error.key}' " if isinstance(value, dict) else ""
    if isinstance(value, float) and value.is_integer() and wanted == TYPES["Integer"]:
        return f"not {wanted}; write {key}={int(value)}"
    return f"{culprit}not {wanted}"


def _sweep_fault(override: Override) -> str:
    line, key = _line(override), override.get_key_element()
    if override.value_type is ValueType.SIMPLE_CHOICE_SWEEP:
        values = list(override.sweep_string_iterator())
        if key == "grads":
            return f"{line}: join terms with + ({key}={'+'.join(values)}), or sweep over them with -m"
        return f"{line}: one value here, for example {key}={values[0]}; or sweep over them with -m"
    return f"{line}: a sweep needs -m"


def _grammar_fault(word: str, error: HydraException) -> str:
    if "=" not in word and not word.startswith("~"):
        return f"{word}: not of the form KEY=VALUE"
    reason = str(error).splitlines()[0]
    return f"{word}: cannot be read ({reason}); quote what is special, for example 'key=\"a b\"'"


def _typed_keys(overrides: Sequence[Override]) -> Iterator[str]:
    """Yield the dotted keys that the overrides set; a dictionary sets each of its own."""

    def leaves(key: str, value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            for name, inner in value.items():
                yield from leaves(f"{key}.{name}", inner)
        else:
            yield key

    for override in overrides:
        yield from leaves(_key(override), override.value())


def _key(override: Override) -> str:
    return override.get_key_element().lstrip("+~")


def _line(override: Override) -> str:
    return override.input_line or override.get_key_element()
