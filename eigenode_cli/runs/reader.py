"""A run's folder, read back: what figures and the report are drawn from.

Reading is strict. A file that is missing, a column that is not there or a cell that is no number is an error that
names it; an empty cell is NaN, never 0. Each table is read when it is asked for, so that one that is damaged does not
take the others with it.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.data.dataset import Series
from eigenode_cli.runs.runfile import Record, RecordError, read_record
from eigenode_cli.solve.status import Status
from eigenode_cli.systems.base import State
from eigenode_cli.terms import NAMES, PAPER_TERMS, canonical, split_grads
from eigenode_cli.training.ending import STATUSES

Bools = NDArray[np.bool_]

SOLVE_STATUSES = tuple(status.label for status in Status)
MONITORED = ("damping", "gain_ratio", "gradient_norm")
"""Columns of metrics.csv that a least-squares optimizer adds."""
METRIC_COLUMNS = (
    "step",
    "train_seconds",
    "lr",
    *PAPER_TERMS,
    "max_real",
    "n_accepted",
    "n_rejected",
    "status",
    "dense_error",
    "test_error",
)
"""Columns of metrics.csv in their order; `stp` follows where a step is stated, and the user's own terms."""


@dataclass(frozen=True)
class Metrics:
    """The rows of metrics.csv.

    Attributes:
        step: training steps done at each record `(R,)`, ascending.
        terms: unscaled losses `(R,)` by name, canonical order, the user's own terms last; NaN where not defined.
        max_real: largest real part of any eigenvalue along the trajectory in 1/s `(R,)`.
        dense_error: mean |x1_model - x1_truth| over the training horizon, in x1's unit `(R,)`; NaN without a truth.
        test_error: root mean square over what was held out, in units of each channel's largest modulus `(R,)`; NaN
            where nothing was.
        train_seconds, lr, accepted, rejected: seconds of training, learning rate, solver steps of that solve `(R,)`.
        status: how each solve ended `(R,)`.
    """

    step: Floats
    terms: dict[str, Floats]
    max_real: Floats
    dense_error: Floats
    test_error: Floats
    train_seconds: Floats
    lr: Floats
    accepted: Floats
    rejected: Floats
    status: tuple[str, ...]

    @property
    def failed(self) -> Bools:
        """Which records are of a solve that did not reach the horizon `(R,)`."""
        return np.array([status != Status.OK.label for status in self.status])

    @property
    def own_terms(self) -> tuple[str, ...]:
        """Names of the user's own terms."""
        return tuple(name for name in self.terms if name not in NAMES)


@dataclass(frozen=True)
class Solution:
    """solution.csv: times `(D,)` in s, truth and model `(D, n)`, and which times lie beyond the training horizon."""

    times: Floats
    truth: Floats
    model: Floats
    beyond: Bools


@dataclass(frozen=True)
class Spectra:
    """eigenvalues.csv, one entry a row: time in s, mode, eigenvalue and its target in 1/s, all `(E,)`."""

    times: Floats
    mode: NDArray[np.int64]
    values: Complexes
    targets: Complexes


@dataclass(frozen=True)
class Run:
    """Everything recorded of one run; a table that cannot be read raises a `RecordError` when it is asked for.

    Attributes:
        folder: where it was read from.
        status: one of `ending.STATUSES`; `error` says why one without success ended.
        config: the resolved configuration.
        system, title: name of the system, and its name for people.
        states: name, unit and symbol of each state `(n,)`; none of a run that failed before it was built.
        inputs: name, unit and symbol of each input.
        grads: names of the terms that trained, canonical order.
        engine: the engine that computed the loss Jacobian; empty of a run that failed before it was built.
        parameters: number of learned parameters.
        command: what was typed to start it.
        versions: of Python and the packages; `commit` is that of git, None outside a checkout.
        baselines: test errors of simple models of measured data, by name; None where one says nothing.
    """

    folder: Path
    status: str
    error: str | None
    config: dict[str, Any]
    system: str
    title: str
    states: tuple[State, ...]
    inputs: tuple[State, ...]
    grads: tuple[str, ...]
    protocol: str
    seed: int
    engine: str
    parameters: int
    command: str
    versions: dict[str, str]
    commit: str | None
    baselines: dict[str, float | None]

    @cached_property
    def metrics(self) -> Metrics:
        """metrics.csv."""
        return _read_metrics(self.folder, self.status)

    @cached_property
    def solution(self) -> Solution:
        """solution.csv."""
        return _read_solution(self.folder, self.status, [state.name for state in self.states])

    @cached_property
    def eigenvalues(self) -> Spectra:
        """eigenvalues.csv."""
        return _read_eigenvalues(self.folder, self.status)

    @cached_property
    def data(self) -> Series:
        """data.csv."""
        return _read_data(self.folder, self.status, [state.name for state in self.states])

    @property
    def settings(self) -> Record:
        """The configuration, each value read with the type that is needed."""
        return Record(self.config, "config.")


def read_run(folder: Path) -> Run:
    """Return the run recorded in `folder`, with all its tables.

    Raises:
        RecordError: a file, key, column or number is missing or wrong; the message names it.
    """
    run = open_run(folder)
    if not run.states:
        raise RecordError("run.json: system is missing")
    for table in (run.metrics, run.solution, run.eigenvalues, run.data):
        del table  # to have been read
    return run


def open_run(folder: Path) -> Run:
    """Return the run recorded in `folder`, whose tables are yet to be read.

    Raises:
        RecordError: run.json is missing, or lacks something, or something in it is wrong; the message names it.
    """
    content = read_record(folder)
    record = Record(content)
    status = record.text("status")
    if status not in STATUSES:
        raise RecordError(f"run.json: status is '{status}', not one of {', '.join(STATUSES)}")
    built = "system" in content or status == "finished"
    states = _states(record.entries("system.states")) if built else ()
    driven = built and bool(content["system"].get("inputs"))
    return Run(
        folder=folder,
        status=status,
        error=record.optional_text("error"),
        config=record.mapping("config"),
        system=record.text("config.system.name"),
        title=record.text("system.title" if built else "config.system.name"),
        states=states,
        inputs=_states(record.entries("system.inputs")) if driven else (),
        grads=canonical(split_grads(record.text("config.grads"))),
        protocol=record.text("config.protocol"),
        seed=record.integer("config.seed"),
        engine=record.text("engine") if built else "",
        parameters=record.integer("parameters") if built else 0,
        command=record.text("command"),
        versions={name: str(version) for name, version in record.mapping("versions").items()},
        commit=record.optional_text("git_commit"),
        baselines=record.mapping("baselines") if "baselines" in content else {},
    )


def _states(entries: Sequence[Record]) -> tuple[State, ...]:
    return tuple(
        State(name=entry.text("name"), unit=entry.text("unit"), symbol=entry.text("symbol")) for entry in entries
    )


class _Table:
    """One CSV file by columns."""

    def __init__(self, folder: Path, name: str, status: str, growing: bool = False) -> None:
        """Read it; the last row of one that is `growing` is left out where a kill or a full disk cut it off."""
        self._name = name
        path = folder / name
        if not path.is_file():
            raise RecordError(f"{name} is missing in {folder}; the status of the run is {status}")
        try:
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            if growing and lines and not lines[-1].endswith("\n"):
                del lines[-1]
            rows = list(csv.reader(lines))
        except (OSError, ValueError, csv.Error) as error:  # ValueError: it is no text
            raise RecordError(f"{name}: cannot be read ({error})") from error
        if len(rows) < 2:
            raise RecordError(f"{name}: holds no record")
        self.header, self._rows = rows[0], rows[1:]
        for line, row in enumerate(self._rows, start=2):
            if len(row) != len(self.header):
                raise RecordError(f"{name}, line {line}: {len(row)} cells in {len(self.header)} columns")

    def __len__(self) -> int:
        return len(self._rows)

    def text(self, column: str) -> tuple[str, ...]:
        """Cells of a column as they stand."""
        if column not in self.header:
            raise RecordError(f"{self._name}: column {column} is missing")
        index = self.header.index(column)
        return tuple(row[index] for row in self._rows)

    def choices(self, column: str, allowed: Sequence[str]) -> tuple[str, ...]:
        """Cells of a column, each one of `allowed`."""
        cells = self.text(column)
        for line, cell in enumerate(cells, start=2):
            if cell not in allowed:
                raise RecordError(f"{self._name}, line {line}: {column} is '{cell}', not one of {', '.join(allowed)}")
        return cells

    def numbers(self, column: str) -> Floats:
        """Numbers of a column, NaN where the cell is empty."""
        values = np.empty(len(self._rows))
        for i, cell in enumerate(self.text(column)):
            try:
                values[i] = float(cell) if cell else np.nan
            except ValueError as error:
                raise RecordError(f"{self._name}, line {i + 2}: {column} is '{cell}', not a number") from error
        return values

    def full(self, column: str) -> Floats:
        """Numbers of a column in which no cell is empty."""
        values = self.numbers(column)
        if not np.all(np.isfinite(values)):
            line = int(np.flatnonzero(~np.isfinite(values))[0]) + 2
            raise RecordError(f"{self._name}, line {line}: {column} is not finite")
        return values

    def matrix(self, columns: Sequence[str]) -> Floats:
        """Several columns side by side `(rows, len(columns))`."""
        return np.column_stack([self.numbers(column) for column in columns])

    def complexes(self, real: str, imaginary: str) -> Complexes:
        """Two columns as complex numbers; NaN in both parts where either is empty."""
        re, im = self.numbers(real), self.numbers(imaginary)
        values = np.full(re.size, complex(np.nan, np.nan))
        known = ~(np.isnan(re) | np.isnan(im))
        values[known] = re[known] + 1j * im[known]
        return values


def _read_metrics(folder: Path, status: str) -> Metrics:
    table = _Table(folder, "metrics.csv", status, growing=True)
    beyond = [column for column in table.header if column not in (*METRIC_COLUMNS, *MONITORED)]
    return Metrics(
        step=table.full("step"),
        terms={name: table.numbers(name) for name in (*PAPER_TERMS, *beyond)},
        max_real=table.numbers("max_real"),
        dense_error=table.numbers("dense_error"),
        test_error=table.numbers("test_error") if "test_error" in table.header else np.full(len(table), np.nan),
        train_seconds=table.full("train_seconds"),
        lr=table.numbers("lr"),
        accepted=table.numbers("n_accepted"),
        rejected=table.numbers("n_rejected"),
        status=table.choices("status", SOLVE_STATUSES),
    )


def _read_solution(folder: Path, status: str, names: Sequence[str]) -> Solution:
    table = _Table(folder, "solution.csv", status)
    return Solution(
        times=table.full("t"),
        truth=table.matrix([f"truth_{name}" for name in names]),
        model=table.matrix([f"model_{name}" for name in names]),
        beyond=np.array([cell == "beyond" for cell in table.choices("horizon", ("train", "beyond"))]),
    )


def _read_eigenvalues(folder: Path, status: str) -> Spectra:
    table = _Table(folder, "eigenvalues.csv", status)
    return Spectra(
        times=table.full("t"),
        mode=table.full("mode").astype(np.int64),
        values=table.complexes("re", "im"),
        targets=table.complexes("target_re", "target_im"),
    )


def _read_data(folder: Path, status: str, names: Sequence[str]) -> Series:
    table = _Table(folder, "data.csv", status)
    states, times = table.matrix(names), table.full("t")
    if "trajectory" in table.header:  # figures show the first one
        first = table.numbers("trajectory") == 0
        states, times = states[first], times[first]
    return Series(times=times, values=states, initial_state=np.full(states.shape[1], np.nan))
