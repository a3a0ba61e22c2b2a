"""What a run writes into its folder, so that everything later (figures, report, resume) needs the folder alone."""

import csv
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from eigenode_cli.arrays import Floats
from eigenode_cli.data.dataset import Dataset
from eigenode_cli.engines.base import Evaluation
from eigenode_cli.runs.atomic import cell, make_folder, write_bytes, write_json, write_table, write_text, writing
from eigenode_cli.runs.reader import METRIC_COLUMNS
from eigenode_cli.runs.runfile import RecordError
from eigenode_cli.terms import PAPER_TERMS
from eigenode_cli.training.progress import Progress, Snapshot

OPTIMIZER = "optimizer."
"""What the optimizer's arrays are named in last.safetensors, before their own names."""
BEST_THETA = "best_theta"
METRICS = "metrics.csv"
LAST = "checkpoints/last.safetensors"
ANYWAY = f"move {METRICS} away to go on without the records so far"


class Recorder:
    """Writes metrics.csv and the checkpoints of one run.

    Args:
        folder: the run's folder.
        names: all terms in the order of `Evaluation.values`.
        truth: the truth's first state at the dense times `(D,)`, None where there is no truth.
        monitored: columns that the optimizer adds.
        left_out: names that have no column.
        units: of the terms, by name, and of `max_real`, in which they are recorded; 1 where none is named.
    """

    def __init__(
        self,
        folder: Path,
        names: Sequence[str],
        truth: Floats | None,
        monitored: Sequence[str] = (),
        units: Mapping[str, float] | None = None,
        left_out: Sequence[str] = (),
    ) -> None:
        self._monitored = tuple(monitored)
        self._units = dict(units or {})
        self.folder = folder
        self.names = tuple(names)
        self._columns = tuple(name for name in names if name not in left_out)
        self._truth = truth
        self._checkpoints = folder / "checkpoints"
        make_folder(self._checkpoints)
        self._file: TextIO | None = None

    @property
    def _metrics(self) -> Path:
        return self.folder / METRICS

    def open(self, resume_from: int | None) -> None:
        """Start metrics.csv, or cut it behind the step that the training is resumed from and go on there."""
        header = metrics_header(self._columns, self._monitored)
        lines = [header, *([] if resume_from is None else complete_rows(self.folder, header, resume_from))]
        write_text(self._metrics, "\n".join(lines) + "\n")
        with writing(self._metrics):
            self._file = self._metrics.open("a", newline="")  # held open for the whole training

    def close(self) -> None:
        """Close metrics.csv."""
        if self._file is not None:
            with suppress(OSError):  # each row was flushed; one that could not be has said so
                self._file.close()
            self._file = None

    def describe(
        self, progress: Progress, lr: float, evaluation: Evaluation, monitored: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Return one row of metrics.csv; `monitored` is what the optimizer tells of itself, and `test_error`."""
        losses = {
            name: float(value) * self._units.get(name, 1.0)
            for name, value in zip(self.names, evaluation.values, strict=True)
        }
        truth, model = self._truth, evaluation.dense[:, 0]
        return {
            "step": progress.step,
            "train_seconds": round(progress.train_seconds, 6),
            "lr": lr,
            **{name: losses[name] for name in PAPER_TERMS},
            "max_real": evaluation.max_real * self._units.get("max_real", 1.0),
            "n_accepted": evaluation.n_accepted,
            "n_rejected": evaluation.n_rejected,
            "status": evaluation.status.label,
            "dense_error": float("nan") if truth is None else float(np.mean(np.abs(model - truth))),
            "test_error": (monitored or {}).get("test_error", float("nan")),
            **{name: (monitored or {})[name] for name in self._monitored},
            **{name: losses[name] for name in self._columns if name not in PAPER_TERMS},
        }

    def record(self, row: Mapping[str, Any]) -> None:
        """Append one row to metrics.csv."""
        if self._file is None:
            raise RuntimeError("the recorder is not open")
        with writing(self._metrics):
            csv.writer(self._file, lineterminator="\n").writerow([cell(value) for value in row.values()])
            self._file.flush()

    def checkpoint(self, step: int, network: dict[str, torch.Tensor]) -> Path:
        """Write the network's float64 state_dict as `checkpoints/step-NNNNNN.safetensors`; returns its path."""
        path = self._checkpoints / f"step-{step:06d}.safetensors"
        write_bytes(path, save(_plain(network), metadata={"step": str(step)}))
        return path

    def save_last(self, snapshot: Snapshot, network: dict[str, torch.Tensor]) -> None:
        """Write what resume needs, and beside it the network as `checkpoint` writes it, under the same names.

        `last.safetensors` is the one that counts: the JSON stands in its header too, so that a kill between the two
        files can't leave a pair that does not belong together.
        """
        tensors = {"theta": torch.from_numpy(snapshot.theta), "random_state": snapshot.random_state}
        if snapshot.best is not None:
            tensors[BEST_THETA] = torch.from_numpy(snapshot.best)
        tensors |= {f"{OPTIMIZER}{name}": torch.from_numpy(array) for name, array in snapshot.optimizer.items()}
        tensors |= _plain(network)
        state = vars(snapshot.progress)
        header = {"progress": json.dumps(state)}
        path = self.folder / LAST
        write_bytes(path, save(tensors, metadata=header))
        write_json(self._checkpoints / "last.json", state)


def metrics_header(names: Sequence[str], monitored: Sequence[str] = ()) -> str:
    """Return the first line of metrics.csv; `names` are the terms that have a column, `monitored` the optimizer's."""
    return ",".join([*METRIC_COLUMNS, *monitored, *(name for name in names if name not in PAPER_TERMS)])


def complete_rows(folder: Path, header: str, before: int) -> list[str]:
    """Return the rows of metrics.csv of the steps before one; the last row may have been cut off.

    Raises:
        RecordError: a line is damaged; the message names it.
    """
    path = folder / METRICS
    if not path.exists():
        return []
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, ValueError) as error:
        raise RecordError(f"{METRICS}: cannot be read ({error}); {ANYWAY}") from error
    complete = [line.rstrip("\n") for line in lines if line.endswith("\n")]
    if complete[:1] not in ([], [header]):
        raise RecordError(f"{METRICS}, line 1: not the columns of this run; {ANYWAY}")
    rows = []
    for number, row in enumerate(complete[1:], start=2):
        cells = row.split(",")
        if not cells[0].isdecimal() or len(cells) != header.count(",") + 1:
            raise RecordError(f"{METRICS}, line {number}: not a row of this run; {ANYWAY}")
        if int(cells[0]) < before:
            rows.append(row)
    return rows


def load_last(folder: Path) -> Snapshot | None:
    """Return what `save_last` wrote; None where nothing was saved yet. Sets torch's random state to the saved one.

    Raises:
        RecordError: it is damaged.
    """
    path = folder / LAST
    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            progress = Progress(**json.loads(file.metadata()["progress"]))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # not a dict
        random_state = tensors.pop("random_state")
        torch.set_rng_state(random_state)
        theta = tensors.pop("theta").numpy().copy()
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise RecordError(f"{LAST}: cannot be read ({type(error).__name__}: {error}); start the run again") from error
    named = {name: tensor for name, tensor in tensors.items() if name.startswith(OPTIMIZER)}
    optimizer = {name.removeprefix(OPTIMIZER): tensor.numpy().copy() for name, tensor in named.items()}
    best = tensors[BEST_THETA].numpy().copy() if BEST_THETA in tensors else None
    return Snapshot(progress, theta, optimizer, random_state, best)


def _plain(network: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the tensors of a state_dict as a file takes them."""
    return {name: tensor.detach().contiguous() for name, tensor in network.items()}


def write_data(folder: Path, dataset: Dataset) -> None:
    """Write data.csv: the measurements that SOL compares, empty where a state was not measured."""
    series = dataset.series[0]
    rows = np.column_stack([series.times, series.values]).tolist()
    write_table(folder / "data.csv", ["t", *dataset.states], rows)
