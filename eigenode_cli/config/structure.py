"""Settings without classes, from a file, as nodes of the schema."""

from collections.abc import Mapping
from dataclasses import fields, make_dataclass
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf, open_dict

from eigenode_cli.config.plugins import GROUPS
from eigenode_cli.config.schema import SCHEMAS, TrainConfig

Composed = make_dataclass(
    "Composed", [(entry.name, Any if entry.name in GROUPS else entry.type, entry) for entry in fields(TrainConfig)]
)
"""`TrainConfig` as Hydra composes it: the options of a user's class are not known yet (`plugins.typify`)."""


def structured(config: DictConfig, schemas: Mapping[str, str] | None = None) -> DictConfig:
    """Return the same settings with the types and checks of the schema; `hydra` stays as it is.

    The class of a group's node follows from its name; of a choice that is not shipped it is the one whose options are
    most like those that are there, or the one that `schemas` names for the group. Nodes that name their class are left
    to `plugins.typify`.

    Raises:
        OmegaConfBaseException: a setting that the schema does not have, or one of another type.
    """
    if OmegaConf.get_type(config) is Composed:
        return config
    hydra = config._get_node("hydra") if "hydra" in config else None
    settings = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    ground = OmegaConf.structured(Composed)
    for group, known in SCHEMAS.items():
        node = settings._get_node(group) if group in settings else None
        if isinstance(node, DictConfig) and not node._is_none() and not (group in GROUPS and "target" in node):
            named = next((one for one in known.values() if one.__name__ == (schemas or {}).get(group)), None)
            schema = known.get(str(node.get("name"))) or named or _nearest(node, list(known.values()))
            ground[group] = OmegaConf.structured(schema)
    merged = cast(DictConfig, OmegaConf.merge(ground, settings))
    if hydra is not None:
        with open_dict(merged):
            merged["hydra"] = hydra
    return merged


def _nearest(values: Mapping[Any, Any], schemas: list[type[Any]]) -> type[Any]:
    """Return the class with the fewest options that are missing in `values` or not known to it."""
    return min(schemas, key=lambda schema: len(set(schema.__dataclass_fields__) ^ set(values)))
