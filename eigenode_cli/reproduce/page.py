"""The page of a study: one self-contained HTML file with every figure beside its claims and their verdicts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eigenode_cli.console import counted, minus
from eigenode_cli.reporting.page import image_source, write_html
from eigenode_cli.reproduce.figures import figure_numbers, svg
from eigenode_cli.reproduce.journal import tables_of
from eigenode_cli.reproduce.runs import RunTable, run_tables
from eigenode_cli.reproduce.schema import Experiment
from eigenode_cli.reproduce.study import Study
from eigenode_cli.reproduce.tables import Summary, TextTable, counts, found
from eigenode_cli.reproduce.verdicts import Verdict


def write_page(study: Study, verdicts: Sequence[Verdict], summary: Summary, folder: Path) -> Path:
    """Write `index.html` and give its path; it needs no other file and no network."""
    tables = run_tables(study)
    content = {
        "protocol": summary.protocol,
        "counts": counts(verdicts),
        "seeds": counted(summary.repetitions, "seed"),
        "command": summary.command,
        "experiments": [
            _section(study, name, experiment, [v for v in verdicts if v.experiment == name], tables.get(name))
            for name, experiment in study.experiments.items()
        ],
    }
    return write_html(folder / "index.html", "reproduction.html.j2", content)


def _section(
    study: Study, name: str, experiment: Experiment, verdicts: Sequence[Verdict], runs: RunTable | None
) -> dict[str, Any]:
    """Return what the page shows of one experiment."""
    figures = []
    for spec in experiment.figures:
        numbers = figure_numbers(experiment, spec, study.results[name])
        if numbers is not None:
            source = image_source(svg(numbers))
            figures.append({"name": spec.name, "caption": spec.caption, "source": source})
    return {
        "name": name,
        "title": experiment.title,
        "figures": figures,
        "claims": [
            {**vars(verdict), "expected": minus(verdict.expected), "found": minus(found(verdict))}
            for verdict in verdicts
        ],
        "tables": [
            _table(table.title, table) for table in [*([] if runs is None else [runs]), *tables_of(study, name)]
        ],
    }


def _table(title: str, table: TextTable) -> dict[str, Any]:
    """Return a table as the page shows it."""
    return {"title": title, "header": table.header, "rows": [[minus(cell) for cell in row] for row in table.rows]}
