"""The page of a sweep: a single HTML file that needs nothing else, neither files nor a network."""

from collections import Counter
from pathlib import Path
from typing import Any

from eigenode_cli.batch.figure import svg_of_sweep
from eigenode_cli.batch.plan import Sweep
from eigenode_cli.batch.summary import RESULTS, cells, group, header, read_rows
from eigenode_cli.console import minus
from eigenode_cli.reporting.page import image_source, page_number, write_html
from eigenode_cli.training.ending import FINISHED, UNSUCCESSFUL

COLUMNS = ("sol", "dense_error", "max_real", "train_seconds")
"""Final numbers of each run on the page."""


def write_page(sweep: Sweep) -> Path:
    """Write `report.html` into the sweep's folder from the recorded files alone, and give its path."""
    return write_html(sweep.folder / "report.html", "sweep.html.j2", page_content(sweep))


def page_content(sweep: Sweep) -> dict[str, Any]:
    """Everything that stands on the page, by the names that the template uses."""
    rows = read_rows(sweep)
    groups = group(rows)
    names = header(groups)
    counts = Counter(row.state.status for row in rows)
    keys = list(dict.fromkeys(key for row in rows for key in row.settings))
    varying = [key for key in keys if len({row.settings.get(key) for row in rows}) > 1]
    finished = counts[FINISHED] > 0
    return {
        "command": sweep.command,
        "total": len(rows),
        "counts": dict(sorted(counts.items())),
        "unsolvable": sum(row.failed and row.state.status == FINISHED for row in rows),
        "figure": image_source(svg_of_sweep(groups)) if finished else None,
        "group_header": names,
        "groups": [[minus(cell) for cell in cells(one, names[: -len(RESULTS) - 2])] for one in groups],
        "run_header": [*varying, "status", *(name.replace("_", " ") for name in COLUMNS), "folder"],
        "runs": [
            {
                "failed": row.failed,
                "cells": [
                    *(row.settings.get(key, "") for key in varying),
                    row.state.status,
                    *(page_number(row.result(name)) for name in COLUMNS),
                ],
                "folder": row.name,
            }
            for row in rows
        ],
        "failures": [
            {"name": row.name, "error": row.state.error, "command": row.repeat}
            for row in rows
            if row.state.status in UNSUCCESSFUL
        ],
    }
