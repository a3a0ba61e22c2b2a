"""How far each run of a sweep is: read from its folder, whoever runs it, on whatever machine."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eigenode_cli.runs.lock import held
from eigenode_cli.runs.runfile import RUN, NewerError, RecordError, read_record

WAITING = "waiting"
"""Of a run that was not started yet; the other statuses are those of run.json."""
ERROR = "error.txt"


@dataclass(frozen=True)
class State:
    """Of one run: its status, and its run.json, empty where there is none."""

    status: str
    record: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    """Why it failed, in one line."""


def read_state(folder: Path) -> State:
    """Return the state of the run in `folder`; one whose process was killed counts as interrupted."""
    state = recorded(folder)
    if state.status == "running" and not held(folder):
        return State("interrupted", state.record, "the process was killed")
    return state


def recorded(folder: Path) -> State:
    """Return the state that the files in `folder` tell; of a killed process they tell that it is running."""
    if not (folder / RUN).exists():
        return _without_record(folder)
    try:
        record = read_record(folder)
    except NewerError:  # what a newer version has done is not written over
        raise
    except RecordError:  # not written by a run: those are there whole or not at all
        return State(WAITING)
    status = record.get("status")
    return State(status, record, record.get("error") or "") if isinstance(status, str) else State(WAITING)


def _without_record(folder: Path) -> State:
    """Return a run without run.json failed before it began, or waits."""
    try:
        lines = (folder / ERROR).read_text().strip().splitlines()
    except FileNotFoundError:
        return State(WAITING)
    return State("failed", {}, lines[-1] if lines else "unknown")


def forget_failure(folder: Path) -> None:
    """Let a failed run count as not started: it is about to be run again."""
    for name in ("run.json", ERROR):
        (folder / name).unlink(missing_ok=True)
