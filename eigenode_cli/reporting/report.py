"""The report of one run: a single HTML page that needs nothing else, neither files nor a network."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from omegaconf import OmegaConf

from eigenode_cli.reporting.figures import contained, figures_of, svg_of
from eigenode_cli.reporting.figures.convergence import convergence_numbers
from eigenode_cli.reporting.page import image_source, page_number, write_html
from eigenode_cli.runs.reader import Metrics, Run, open_run
from eigenode_cli.solve.status import Status

ROWS = 12
"""Most rows of the metrics table."""


class Report(NamedTuple):
    """The file of the page, and a line for each thing that is missing on it."""

    path: Path
    faults: list[str]


def write_report(folder: Path) -> Report:
    """Write `report.html` into the folder of a run, from its recorded files alone.

    The same recorded files give the same bytes. What one that is missing or damaged would give is left out, and the
    page says so.

    Raises:
        RecordError: run.json is missing, or does not hold what is needed.
        WriteError: the page cannot be written.
    """
    content = page_content(open_run(folder))
    path = write_html(folder / "report.html", "report.html.j2", content)
    return Report(path, content["faults"])


def page_content(run: Run) -> dict[str, Any]:
    """Everything that stands on the page, by the names that the template uses."""
    faults: list[str] = []
    figures: list[dict[str, str]] = []
    for name in figures_of(run):
        with contained(name, faults):
            source = image_source(svg_of(run, name))
            figures.append({"name": name, "caption": CAPTIONS[name](run), "source": source})
    content: dict[str, Any] = {"tiles": [], "facts": [("system", run.system)], "table": None}
    with contained("the table of metrics", faults):
        content |= _numbers(run)
    return {
        "run": run,
        "grads": "+".join(run.grads),
        "figures": figures,
        "faults": faults,
        "config": OmegaConf.to_yaml(OmegaConf.create(run.config)),
        **content,
    }


def _numbers(run: Run) -> dict[str, Any]:
    """Return what the page shows of metrics.csv."""
    metrics = run.metrics
    failures = Counter(status for status in metrics.status if status != Status.OK.label)
    return {
        "tiles": headline(run),
        "facts": facts(run),
        "failures": dict(sorted(failures.items())),
        "records": len(metrics.status),
        "table": metrics_table(metrics),
    }


def headline(run: Run) -> list[dict[str, str]]:
    """Return the result in four numbers: title, value, unit or remark of each."""
    metrics, unit = run.metrics, run.states[0].unit
    real, error = float(metrics.max_real[-1]), float(metrics.dense_error[-1])
    side = "" if not np.isfinite(real) else "1/s, stable" if real < 0.0 else "1/s, not stable"
    failed, tested = int(metrics.failed.sum()), float(metrics.test_error[-1])
    errors = {"title": "Dense error", "value": page_number(error), "remark": unit if np.isfinite(error) else ""}
    if run.baselines or np.isfinite(tested):
        linear = run.baselines.get("linear")
        remark = "" if linear is None else f"linear model {page_number(linear)}"
        errors = {"title": "Test error", "value": page_number(tested), "remark": remark}
    return [
        {"title": "SOL, last record", "value": page_number(metrics.terms["sol"][-1]), "remark": ""},
        errors,
        {"title": "Largest real part", "value": page_number(real), "remark": side},
        {"title": "Failed solves", "value": str(failed), "remark": f"of {len(metrics.status)} records"},
    ]


def facts(run: Run) -> list[tuple[str, str]]:
    """Return what was run, as pairs of a word and its value."""
    metrics = run.metrics
    return [
        ("system", run.system),
        ("engine", run.engine),
        ("parameters", f"{run.parameters:,}"),
        ("training steps", f"{metrics.step[-1]:,.0f}"),
        ("training time", f"{metrics.train_seconds[-1]:,.1f} s"),
        *((f"test error, {BASELINES.get(name, name)}", _error(error)) for name, error in run.baselines.items()),
    ]


def _error(error: float | None) -> str:
    return "says nothing" if error is None else page_number(error)


def _of_convergence(run: Run) -> str:
    """Return the caption with the local minima."""
    minima = convergence_numbers(run).minima
    levels = "; ".join(f"{page_number(m.level)} from step {m.start:,.0f} to {m.stop:,.0f}" for m in minima)
    stood = f" Local minima (black-dashed): {levels}." if minima else " No local minimum was found."
    return "Terms over the training steps, unscaled, with their last values; zeros are not drawn." + stood


BASELINES = {"linear": "linear model of the same order", "repetition": "last period repeated"}
"""What baselines are called."""

CAPTIONS: dict[str, Callable[[Run], str]] = {
    "convergence": _of_convergence,
    "stability": lambda _: (
        "Largest real part of any eigenvalue along the trajectory. Stable systems lie below the border."
    ),
    "solution": lambda run: (
        "Model and measurements, those of the training and those that were held out."
        if run.baselines
        else "Model and truth over twice the training horizon, with the data that SOL compares."
    ),
    "eigenvalues": lambda _: "Eigenvalues along the model's trajectory, coloured by time, and their targets.",
    "phase": lambda _: "Phase portrait of the first two states.",
    "region": lambda _: (
        "Eigenvalues times the step of the solver that stp names, in the region (grey) in which a step damps them."
    ),
}
"""Caption of each figure, with the numbers that belong to it."""


def metrics_table(metrics: Metrics) -> dict[str, Any]:
    """Header and rows of the metrics table: the first record, some between, the last."""
    chosen = np.unique(np.linspace(0, metrics.step.size - 1, ROWS).round().astype(int))
    columns = {
        **{name.upper() if name not in metrics.own_terms else name: values for name, values in metrics.terms.items()},
        "max Re": metrics.max_real,
        "dense error": metrics.dense_error,
        "accepted": metrics.accepted,
        "rejected": metrics.rejected,
    }
    rows = [
        {
            "failed": bool(metrics.failed[i]),
            "cells": [
                f"{metrics.step[i]:,.0f}",
                *(page_number(float(values[i])) for values in columns.values()),
                metrics.status[i],
            ],
        }
        for i in chosen
    ]
    return {"header": ["step", *columns, "status"], "rows": rows}
