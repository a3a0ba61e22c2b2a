"""A configuration as a run reads it: composed, checked and finalised, or restored from a run's record."""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from eigenode_cli.config.check import Examined, examine, normalise, parse
from eigenode_cli.config.composer import Composer, explain, hydra_values
from eigenode_cli.config.outline import is_table
from eigenode_cli.config.plugins import typify
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.structure import structured
from eigenode_cli.config.table import SHIPPED
from eigenode_cli.config.values import value_faults
from eigenode_cli.errors import UserError, nearest
from eigenode_cli.runs.runfile import RUN, RecordError
from eigenode_cli.terms import canonical, split_grads


def finalise(config: DictConfig) -> DictConfig:
    """Make a checked configuration what a run reads, in place: resolved, `grads` canonical, a scale for every term."""
    OmegaConf.resolve(config)
    config.grads = "+".join(canonical(split_grads(config.grads)))
    for stage in config.stages:
        if stage.terms is not None:
            stage.terms = "+".join(canonical(split_grads(stage.terms)))
    if is_table(config.system) and config.system.folder != SHIPPED:  # the run may be looked at from elsewhere
        config.system.folder = str(Path(config.system.folder or ".").resolve())
    with open_dict(config.scale):
        for name in config.terms:
            config.scale.setdefault(name, 1.0)
    return config


def typed(config: DictConfig) -> TrainConfig:
    """Return the configuration as plain typed objects, the class of each group's node by what was chosen."""
    settings = structured(config)
    if faults := typify(settings):
        raise UserError(faults)
    return TrainConfig(**vars(OmegaConf.to_object(settings)))


def with_changes(record: dict[str, Any], words: Sequence[str], allowed: Sequence[str]) -> dict[str, Any]:
    """Return the settings that a run's `run.json` holds with a few of them changed.

    Args:
        record: the settings.
        words: `KEY=VALUE` each.
        allowed: keys that may change, with what stands below them.

    Raises:
        UserError: with all faults.
    """
    config = OmegaConf.create(record)
    overrides, faults = parse(Composer(), words)
    for override in overrides:
        key, value = override.get_key_element(), override.value()
        word = override.input_line or key
        if not any(key == name or key.startswith(f"{name}.") for name in allowed):
            guess = nearest(key, allowed)
            hint = f", did you mean {guess}?" if guess else ";"
            faults.append(f"{word}: can't change here{hint} what can: {', '.join(allowed)}")
        elif override.is_sweep_override():
            faults.append(f"{word}: one value here")
        else:
            OmegaConf.update(config, key, value)
    if faults:
        raise UserError(faults)
    return cast(dict[str, Any], OmegaConf.to_container(config))


def restore(record: dict[str, Any], schemas: Mapping[str, str] | None = None) -> TrainConfig:
    """Return the configuration that a run's `run.json` holds, checked as that of a command is.

    Args:
        record: the settings.
        schemas: class of the schema of each group, so that two choices may have the same options.

    Raises:
        RecordError: with all faults; or it was written by another version of the schema.
    """
    try:
        config = structured(OmegaConf.create(record), schemas)
        OmegaConf.resolve(config)
        faults = [*typify(config), *value_faults(config)]
    except (OmegaConfBaseException, ValueError) as error:
        key = getattr(error, "full_key", None)
        place = f"config.{key}" if key else "config"
        raise RecordError(f"{RUN}: {place}: {explain(error)}") from error
    if faults:
        raise RecordError([f"{RUN}: config.{fault}" for fault in faults])
    return typed(config)


def compose(overrides: Sequence[str], config_dir: str | None = None) -> DictConfig:
    """Return the checked and finalised configuration of `eigenode train <overrides>`.

    Raises:
        UserError: with all faults at once.
    """
    return compose_with(Composer(config_dir), overrides)


def compose_with(composer: Composer, overrides: Sequence[str]) -> DictConfig:
    """Return the same with a composer at hand, which reads every file once however many configurations it makes."""
    return run_config(examine(composer, normalise(overrides)))


def run_config(found: Examined) -> DictConfig:
    """Return what was examined, as a run reads it.

    Raises:
        UserError: with all faults at once.
    """
    config = found.checked()
    with hydra_values(copy.deepcopy(config)), open_dict(config):
        del config["hydra"]
        return finalise(config)
