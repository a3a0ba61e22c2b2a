"""run.json, read back: whole, of a version that is known, and key by key with the type that is needed."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from eigenode_cli.errors import UserError

RUN = "run.json"
VERSION = 1
"""Of the schema of run.json, under its key `version`; a record without it is of the first one."""
T = TypeVar("T")


class RecordError(UserError, ValueError):
    """A run's folder does not hold what is read from it; the message names the file and what is wrong in it."""


class NewerError(RecordError):
    """run.json was written by a newer version."""


class Record:
    """run.json by dotted keys, each read with the type that is needed."""

    def __init__(self, content: Mapping[str, Any], prefix: str = "") -> None:
        self._content = content
        self._prefix = prefix

    def _find(self, key: str) -> Any:
        node: Any = self._content
        for part in key.split("."):
            if not isinstance(node, Mapping) or part not in node:
                raise RecordError(f"run.json: {self._prefix}{key} is missing")
            node = node[part]
        return node

    def _typed(self, key: str, kind: type[T], name: str) -> T:
        value = self._find(key)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise RecordError(f"run.json: {self._prefix}{key} is {value!r}, not {name}")
        return value

    def text(self, key: str) -> str:
        """Return a text."""
        return self._typed(key, str, "text")

    def optional_text(self, key: str) -> str | None:
        """Return a text, or None."""
        return None if self._find(key) is None else self.text(key)

    def integer(self, key: str) -> int:
        """Return a whole number."""
        return self._typed(key, int, "an integer")

    def number(self, key: str) -> float:
        """Return a number."""
        value = self._find(key)
        return float(self.integer(key) if isinstance(value, int) else self._typed(key, float, "a number"))

    def mapping(self, key: str) -> dict[str, Any]:
        """Return a mapping."""
        return self._typed(key, dict, "a mapping")

    def entries(self, key: str) -> list["Record"]:
        """Return the mappings of a list that is not empty."""
        items = self._typed(key, list, "a list")
        if not items:
            raise RecordError(f"run.json: {self._prefix}{key} is empty")
        return [Record(item, f"{self._prefix}{key}[{i}].") for i, item in enumerate(items)]


def flags(command: str) -> list[str]:
    """Return the flags in the command of a run that its own configs and code take: `--config-dir`, `--config-name`."""
    try:
        words = shlex.split(command)
    except ValueError:  # not written by a run
        return []
    return [word for word in words if word.startswith(("--config-dir=", "--config-name="))]


def config_dirs(command: str) -> list[str]:
    """Return the folders of the user's own configs and code in the command of a run."""
    return [word.partition("=")[2] for word in flags(command) if word.startswith("--config-dir=")]


def resume_command(folder: Path, command: str) -> str:
    """Return the command that goes on with the run in `folder`, which `command` started."""
    own = [f"--config-dir={folder}" for folder in config_dirs(command)]
    return shlex.join(["eigenode", "resume", str(folder), *own])


def read_record(folder: Path) -> dict[str, Any]:
    """Return what run.json in `folder` says.

    Raises:
        RecordError: it is missing, cannot be read, or was written by a newer version.
    """
    path = folder / RUN
    if not path.is_file():
        raise RecordError(f"{RUN} is missing in {folder}: not the folder of a run")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # no JSON, or no text
        raise RecordError(f"{RUN}: not valid JSON: {error}") from error
    except (OSError, RecursionError) as error:
        raise RecordError(f"{RUN}: cannot be read ({error})") from error
    if not isinstance(content, dict):
        raise RecordError(f"{RUN}: not a mapping")
    version = content.get("version", VERSION)
    if not isinstance(version, int) or version < 1:
        raise RecordError(f"{RUN}: version is {version!r}, not a number from 1")
    if version > VERSION:
        raise NewerError(f"{RUN}: version is {version}, of a newer eigenode; this one reads up to {VERSION}")
    return content
