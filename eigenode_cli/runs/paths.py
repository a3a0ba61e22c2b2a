"""Where things lie: the shipped configs, the folders of runs, and the user's own code."""

import hashlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.machinery import PathFinder
from pathlib import Path

from eigenode_cli import OWN_CODE, own_code
from eigenode_cli.errors import UserError, nearest

_HERE = Path(__file__).resolve().parents[1]

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
    """Return a new folder `outputs/<date>_<time>_<name>`, created here and now, so that two runs never share one.

    Raises:
        UserError: it can't be made.
    """
    new_folder(OUTPUTS, f"{OUTPUTS}")
    stem = f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{slug(name)}"
    count = 1
    while True:
        folder = OUTPUTS / (stem if count == 1 else f"{stem}-{count}")
        try:
            folder.mkdir()
        except FileExistsError:
            count += 1
        except OSError as error:
            raise UserError(f"{folder}: cannot be made ({error.strerror}); name another with hydra.run.dir") from error
        else:
            return folder


def new_folder(folder: Path, said: str) -> None:
    """Make a folder, with those above it, where there is none; `said` is what the user calls it.

    Raises:
        UserError: it is a file, or can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UserError(f"{said}: is a file; name a folder") from error
    except OSError as error:
        raise UserError(f"{said}: cannot be made ({error.strerror}); name another folder") from error


def run_folder(text: str) -> Path:
    """Return the folder of a run, given as a path or as a name under `outputs/`.

    Args:
        text: what the user typed.

    Raises:
        UserError: there is no such folder, or it is not that of a run.
    """
    folder = next((path for path in (Path(text), OUTPUTS / text) if is_folder(path)), None)
    if folder is None:
        known = {path.parent.name: path.parent for path in sorted(OUTPUTS.glob("**/run.json"))}
        guess = nearest(Path(text).name, known)
        raise UserError(f"{text}: no such folder" + (f", did you mean {known[guess]}?" if guess else ""))
    if not (folder / "run.json").is_file():
        runs = sorted(path.parent.name for path in folder.glob("*/run.json"))
        if runs:
            raise UserError(f"{text}: a sweep, name one of its {len(runs)} runs, for example {folder / runs[0]}")
        raise UserError(f"{text}: not the folder of a run, it has no run.json")
    return folder


def is_folder(path: Path) -> bool:
    """Whether there is such a folder; a name that no file system takes is none."""
    try:
        return path.is_dir()
    except OSError:
        return False


@contextmanager
def importable(*folders: str) -> Iterator[None]:
    """Let the user's own code be imported from these folders, by child processes as well.

    They stand at the end of the path: a file of the user's is never taken for an installed module of its name.

    Raises:
        UserError: the current folder is gone.
    """
    variables = (OWN_CODE, "PYTHONSAFEPATH")
    path, before = list(sys.path), {name: os.environ.get(name) for name in variables}
    known = own_code()
    try:
        own = list(dict.fromkeys([*(str(Path(folder).resolve()) for folder in folders), *known]))
    except FileNotFoundError as error:
        raise UserError("the current folder does not exist any more; change to another one") from error
    sys.path[:] = [*(folder for folder in path if folder not in own), *own]
    os.environ[OWN_CODE] = os.pathsep.join(own)
    os.environ["PYTHONSAFEPATH"] = "1"  # children: Python itself puts the current folder first
    try:
        yield
    finally:
        sys.path[:] = path
        for name in variables:
            restore_variable(name, before[name])


def hidden(module: str) -> Path | None:
    """Return the user's file that an installed module of its name keeps from being imported; None if there is none.

    Args:
        module: dotted name of what was asked for.
    """
    first, own = module.partition(".")[0], own_code()
    files = [Path(folder) / name for folder in own for name in (f"{first}.py", f"{first}/__init__.py")]
    found = next((path for path in files if path.is_file()), None)
    others = [folder for folder in sys.path if folder not in own]
    installed = first in sys.stdlib_module_names or PathFinder.find_spec(first, others) is not None
    return found if installed else None


def restore_variable(name: str, value: str | None) -> None:
    """Set an environment variable back to what it was, None for not set."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
