"""The settings of a table alone, as `eigenode data` takes them."""

from collections.abc import Sequence
from typing import cast

from omegaconf import OmegaConf

from eigenode_cli.config.check import examine_overrides, parse
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.table_schema import TableConfig
from eigenode_cli.errors import UserError


def table_settings(file: str, words: Sequence[str]) -> TableConfig:
    """Return the settings of a table.

    Args:
        file: name of the file, or a pattern.
        words: `system.KEY=VALUE` each.

    Raises:
        UserError: with all faults of these settings.
    """
    composer = Composer()
    overrides, faults = parse(composer, ["system=table", *words])
    found = examine_overrides(composer, overrides)
    typed = {override.get_key_element() for override in overrides}
    keys = tuple(key for key in typed if key.startswith("system."))
    faults += [
        fault
        for fault in found.faults
        if fault.startswith(tuple(f"{key}=" for key in keys)) and "system.file" not in fault
    ]
    if faults or found.config is None:
        raise UserError(faults or found.faults)
    node = found.config.system
    node.file, node.name = file, "table"
    return cast(TableConfig, OmegaConf.to_object(node))
