"""What can be chosen, with one line each, and the proof that every shipped config composes."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_type_hints

from eigenode_cli.config.check import examine
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.plugins import CUSTOM, GROUPS
from eigenode_cli.config.schema import SystemConfig, TrainConfig
from eigenode_cli.errors import UserError, unknown
from eigenode_cli.runs.paths import CONFIG_DIR
from eigenode_cli.terms import TERMS

COMPANIONS = {
    "optimizer=lm": ("error.sol=mse", "error.frq=mse", "error.dmp=mse", "error.osc=mse"),
    "target=stated": ("target.frequency=[1.0]", "target.damping=[0.1]"),
    "system=table": (
        "system.folder=shipped",
        "system.file=lynx_hare.csv",
        "system.time=Year",
        "system.states=[Lynx,Hare]",
        "network.structure=full",
        "grads=sol",
    ),
    "system=custom": (
        "system.target=eigenode_cli.systems:VanDerPol",
        "system.mu=1.0",
        "system.initial_state=[1.0,0.0]",
        "system.horizon=1.0",
        "system.points=11",
        "system.observed=[nu]",
    ),
    "network=custom": (
        "network.target=eigenode_cli.model:Polynomial",
        "network.degree=1",
        "network.spread=0.1",
    ),
}
"""What a choice asks the user for in addition."""


def groups(composer: Composer) -> dict[str, str]:
    """Every group that `list` knows, with one line."""
    hints = get_type_hints(TrainConfig)
    hints["system"] = SystemConfig  # or a table
    lines = {group: _first_line(hints[group]) for group in hints if group in composer.groups and group != "protocol"}
    return {
        **lines,
        "measured": "A measured record with all its settings.",
        "protocol": "A full set of training choices.",
        "terms": "The losses that `grads` joins by +.",
    }


def choices(composer: Composer, group: str) -> dict[str, str]:
    """Every choice of a group, with the first line of its file.

    Raises:
        UserError: there is no such group.
    """
    if group == "terms":
        return {term.name: term.description for term in TERMS.values()}
    known = groups(composer)
    if group not in known:
        raise UserError(f"list {group}: {unknown('group', group, known)}")
    folders = [Path(path.path.removeprefix("file://")) for path in composer.loader.get_search_path().get_path()]
    return {name: _describe(folders, f"{group}/{name}.yaml") for name in composer.choices(group)}


def _describe(folders: list[Path], file: str) -> str:
    """First comment of a config file; a protocol's command that stands before it is left out."""
    path = next((folder / file for folder in folders if (folder / file).is_file()), None)
    if path is None:
        return ""
    comments = (line.lstrip("# ").strip() for line in path.read_text().splitlines() if line.startswith("#"))
    line = next((comment for comment in comments if not comment.startswith("@")), "")
    return line.partition(": ")[2] if line.startswith("eigenode ") else line


def _first_line(schema: type) -> str:
    return (schema.__doc__ or "").strip().splitlines()[0]


@dataclass
class Validation:
    """Outcome of `validate`.

    Attributes:
        compositions: number of configurations that were composed and checked.
        files: shipped files that took part, relative to the config folder.
        faults: one line each, with the command line that shows it.
    """

    compositions: int = 0
    files: set[str] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)


def validate(composer: Composer) -> Validation:
    """Compose and check every choice of every group and every protocol on every system."""
    result = Validation()
    for words in dict.fromkeys(_combinations(composer)):
        result.compositions += 1
        found = examine(composer, words)
        command = " ".join(("eigenode train", *words))
        result.faults += [f"{command}: {fault}" for fault in found.faults]
        if found.config is not None:
            result.files.add(f"{composer.config_name}.yaml")
            chosen = found.config.hydra.runtime.choices.items()
            result.files |= {f"{group}/{choice}.yaml" for group, choice in chosen}
    for group in GROUPS:  # a class of the user's own is yet to be named
        composer.composed((f"{group}={CUSTOM}",))
        result.files.add(f"{group}/{CUSTOM}.yaml")
    shipped = shipped_files()
    result.files &= shipped
    result.faults += [f"configs/{name}: no command reaches this file" for name in sorted(shipped - result.files)]
    return result


def shipped_files() -> set[str]:
    """All shipped config files, relative to their folder."""
    return {path.relative_to(CONFIG_DIR).as_posix() for path in CONFIG_DIR.rglob("*.yaml")}


def _combinations(composer: Composer) -> Iterator[tuple[str, ...]]:
    for group in composer.groups:
        if group == "measured":  # the others need files of the user's
            yield from ((f"measured={name}",) for name in ("driven_simulated", "lynx_hare", "shaker"))
            continue
        for name in composer.choices(group):
            choice = f"{group}={name}"
            if name != CUSTOM or choice in COMPANIONS:
                yield (choice, *COMPANIONS.get(choice, ()))
    for protocol in composer.choices("protocol"):
        for system in composer.choices("system"):
            if system != CUSTOM:
                yield (f"protocol={protocol}", f"system={system}", *COMPANIONS.get(f"system={system}", ()))
