"""Where things lie: the shipped configs, the folders of runs, and the user's own code."""

import hashlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from eigenode_cli.errors import UserError, nearest

_HERE = Path(__file__).resolve().parent

CONFIG_DIR = next(
    folder for folder in (_HERE / "configs", _HERE.parent / "configs") if (folder / "train.yaml").is_file()
)
"""The shipped configs: inside an installed package, beside the package in a checkout."""

EXPERIMENT_DIR = CONFIG_DIR.with_name("experiments")
"""The shipped experiments, beside the configs in either place."""

OUTPUTS = Path("outputs")
"""Runs land here, under the folder that the command was given in."""

LONGEST_SLUG = 100
"""File systems allow 255 bytes; a person reads fewer."""


def slug(text: str) -> str:
    """`text` as the name of one folder; where anything had to change, a hash keeps two texts apart."""
    name = re.sub(r"[^A-Za-z0-9_.,=+-]", "-", text)[:LONGEST_SLUG].strip(".") or "run"
    if name == text:
        return name
    return f"{name}-{hashlib.sha1(text.encode()).hexdigest()[:8]}"


def claim_folder(name: str) -> Path:
    """A new folder `outputs/<date>_<time>_<name>`, created here and now, so that two runs never share one."""
    OUTPUTS.mkdir(exist_ok=True)
    stem = f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{slug(name)}"
    count = 1
    while True:
        folder = OUTPUTS / (stem if count == 1 else f"{stem}-{count}")
        try:
            folder.mkdir()
        except FileExistsError:
            count += 1
        else:
            return folder


def run_folder(text: str, needed: tuple[str, ...]) -> Path:
    """The folder of a run, given as a path or as a name under `outputs/`.

    Args:
        text: what the user typed.
        needed: files that must be in it besides `run.json`.

    Raises:
        UserError: there is no such folder, or it lacks a file.
    """
    folder = next((path for path in (Path(text), OUTPUTS / text) if path.is_dir()), None)
    if folder is None:
        known = {path.parent.name: path.parent for path in sorted(OUTPUTS.glob("**/run.json"))}
        guess = nearest(Path(text).name, known)
        raise UserError(f"{text}: no such folder" + (f", did you mean {known[guess]}?" if guess else ""))
    if not (folder / "run.json").is_file():
        runs = sorted(path.parent.name for path in folder.glob("*/run.json"))
        if runs:
            raise UserError(f"{text}: a sweep, name one of its {len(runs)} runs, for example {folder / runs[0]}")
        raise UserError(f"{text}: not the folder of a run, it has no run.json")
    missing = [name for name in needed if not (folder / name).is_file()]
    if missing:
        raise UserError(f"{text}: the run has no {' and no '.join(missing)}")
    return folder


@contextmanager
def importable(*folders: str) -> Iterator[None]:
    """Let the user's own code be imported from these folders, by child processes as well."""
    path, inherited = list(sys.path), os.environ.get("PYTHONPATH")
    resolved = [str(Path(folder).resolve()) for folder in folders]
    sys.path[:0] = [folder for folder in resolved if folder not in sys.path]
    if resolved:
        os.environ["PYTHONPATH"] = os.pathsep.join([*resolved, *([inherited] if inherited else [])])
    try:
        yield
    finally:
        sys.path[:] = path
        restore_variable("PYTHONPATH", inherited)


def restore_variable(name: str, value: str | None) -> None:
    """Set an environment variable back to what it was, None for not set."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
