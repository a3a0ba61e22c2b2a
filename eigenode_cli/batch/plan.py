"""What a sweep consists of, and the file in its folder that says so: `sweep.json`."""

import hashlib
import json
import re
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from eigenode_cli.config.sweep import Job
from eigenode_cli.errors import UserError
from eigenode_cli.runs.atomic import make_folder, write_json
from eigenode_cli.runs.paths import OUTPUTS

PLAN = "sweep.json"
LONGEST_NAME = 80
"""Characters of the settings that a sweep's folder shows."""


@dataclass(frozen=True)
class Sweep:
    """A sweep.

    Attributes:
        folder: holds a folder for each run.
        flags: of the command line that a single run of it takes as well: `--config-dir DIR`.
        words: what started it, behind `eigenode train`, without the folder.
        jobs: its runs, in order.
    """

    folder: Path
    flags: tuple[str, ...]
    words: tuple[str, ...]
    jobs: tuple[Job, ...]

    @property
    def command(self) -> str:
        """The command that starts it."""
        return shlex.join(["eigenode", "train", *self.words])

    def place(self, job: Job) -> Path:
        """Return the folder of one run."""
        return self.folder / job.name

    def repeat(self, job: Job) -> str:
        """Return the command that repeats one run by itself."""
        return shlex.join(["eigenode", "train", *self.flags, *job.overrides])


def default_folder(words: Sequence[str], jobs: Sequence[Job]) -> Path:
    """Return the folder under outputs/ of a sweep that names none.

    The same runs always get the same folder, so that the command repeated finds what is done; a config edited in
    between gives another one, so that nothing is mixed.

    Args:
        words: what the user typed, without Hydra's own settings.
        jobs: the runs.
    """
    shown = re.sub(r"[^A-Za-z0-9_.,=+-]+", "-", ",".join(sorted(words)))[:LONGEST_NAME].strip("-.,")
    text = "\n".join(sorted(job.digest for job in jobs))
    return OUTPUTS / f"sweep_{shown or 'defaults'}-{hashlib.sha1(text.encode()).hexdigest()[:8]}"


def quoted(key: str, text: str) -> str:
    """Return an override of `key` with any text as its value."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'{key}="{escaped}"'


def write_plan(sweep: Sweep) -> None:
    """Write `sweep.json`, before the first run starts."""
    make_folder(sweep.folder)
    write_json(sweep.folder / PLAN, {"command": sweep.command, **_plain(sweep)})


def _plain(sweep: Sweep) -> dict[str, object]:
    return {"flags": sweep.flags, "words": sweep.words, "jobs": [asdict(job) for job in sweep.jobs]}


def read_plan(folder: Path) -> Sweep:
    """Return the sweep in `folder`.

    Raises:
        UserError: its `sweep.json` is missing or cannot be read.
    """
    try:
        content = json.loads((folder / PLAN).read_text())
        jobs = tuple(Job(job["name"], tuple(job["overrides"]), job["digest"]) for job in content["jobs"])
        return Sweep(folder, tuple(content["flags"]), tuple(content["words"]), jobs)
    except (OSError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise UserError(f"{folder}: its {PLAN} cannot be read ({type(error).__name__}: {error})") from error


def check_folder(sweep: Sweep) -> None:
    """Refuse a folder that holds anything but this sweep, or a part of it.

    Raises:
        UserError: runs that lie there would be written over, or mixed with those of another sweep.
    """
    folder = sweep.folder
    if folder.exists() and not folder.is_dir():
        raise UserError(f"hydra.sweep.dir={folder}: is a file; name a folder")
    if not (folder / PLAN).exists():
        if (folder / "run.json").exists() or any(folder.glob("*/run.json")):
            raise UserError(f"hydra.sweep.dir={folder}: holds runs of something else; name another folder")
        return
    previous = read_plan(folder)
    digests = {job.name: job.digest for job in sweep.jobs}
    lost = [job.name for job in previous.jobs if digests.get(job.name) != job.digest]
    if lost:
        raise UserError(
            f"hydra.sweep.dir={folder}: holds a sweep with other settings, for example its run {lost[0]}; "
            f"name another folder, or repeat it with: eigenode resume {folder}"
        )
