"""Checkpoints of a run: which one holds its result, and the tensors in it."""

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from eigenode_cli.errors import UserError
from eigenode_cli.runs.paths import run_folder
from eigenode_cli.runs.runfile import RecordError, read_record

FOLDER = "checkpoints"


def checkpoint_path(text: str, step: int | None = None) -> Path:
    """Return the checkpoint that a user names: a file, or a run (a folder, or a name under outputs/).

    Args:
        text: what the user typed.
        step: of the checkpoint of a run; None for that of its result.

    Raises:
        UserError: there is none.
    """
    path = Path(text)
    if path.suffix == ".safetensors":
        if not path.is_file():
            raise UserError(f"{text}: no such file")
        return path
    folder = run_folder(text)
    steps = sorted(int(path.stem.removeprefix("step-")) for path in (folder / FOLDER).glob("step-*.safetensors"))
    if not steps:
        raise UserError(f"{text}: the run has no checkpoint")
    if step is None:
        step = _result(folder, steps[-1])
    if step not in steps:
        raise UserError(f"{text}: no checkpoint of step {step}; there are {', '.join(map(str, steps))}")
    return folder / FOLDER / f"step-{step:06d}.safetensors"


def _result(folder: Path, last: int) -> int:
    """Step of the weights that a run keeps."""
    record = read_record(folder)
    trainer = record.get("config", {}).get("trainer", {})
    return record.get("best_step") or last if trainer.get("keep") == "best" else last


def load_checkpoint(path: Path) -> dict[str, torch.Tensor]:
    """Return the tensors in a checkpoint by name: the network's state_dict, `linear`, `initial_state`.

    Raises:
        RecordError: it cannot be read.
    """
    try:
        return load_file(path)
    except (SafetensorError, OSError, ValueError) as error:
        raise RecordError(f"{path}: cannot be read ({type(error).__name__}: {error})") from error
