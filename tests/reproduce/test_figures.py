"""Figures: the numbers behind them, the same bytes from the same records, and the page that shows them."""

import base64
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.reproduce.figures import draw, draw_all, figure_numbers, median_result, merged, title
from eigenode_cli.reproduce.measures import Result
from eigenode_cli.reproduce.page import write_page
from eigenode_cli.reproduce.study import Study
from eigenode_cli.reproduce.tables import Summary
from tests.reporting.test_report import CHROMIUM, PHONE, Page, browser

__all__ = ["browser"]


def numbers(study: Study, index: int):
    experiment = study.experiments["small"]
    return figure_numbers(experiment, experiment.figures[index], study.results["small"])


def test_curves_are_medians_with_quartiles(study: Study) -> None:
    found = numbers(study, 1)
    assert found is not None
    assert [curve.name for curve in found.curves] == ["sol+stb", "sol"]
    values = np.vstack([r.metrics.terms["sol"] for r in study.results["small"]["sol"]])
    curve = found.curves[1]
    np.testing.assert_allclose(curve.y, np.median(values, axis=0), rtol=1e-14)
    np.testing.assert_allclose(curve.low, np.quantile(values, 0.25, axis=0), rtol=1e-14)
    np.testing.assert_allclose(curve.high, np.quantile(values, 0.75, axis=0), rtol=1e-14)
    np.testing.assert_array_equal(found.x, [0, 5, 10, 15, 20])


def test_trainings_of_different_length_share_a_figure(study: Study) -> None:
    results = dict(study.results["small"])
    short = []
    for result in results["sol"]:
        cut = Result(result.unit)
        metrics = result.metrics
        kept = replace(metrics, step=metrics.step[:3], terms={"sol": metrics.terms["sol"][:3]})
        run = replace(result.run)
        vars(run)["metrics"] = kept
        vars(cut)["run"] = run
        short.append(cut)
    experiment = study.experiments["small"]
    whole = numbers(study, 1)
    found = figure_numbers(experiment, experiment.figures[1], results | {"sol": short})
    assert whole is not None
    assert found is not None
    np.testing.assert_array_equal(found.x, [0, 5, 10, 15, 20])
    np.testing.assert_array_equal(found.curves[0].y, whole.curves[0].y)
    np.testing.assert_array_equal(found.curves[1].y, [*whole.curves[1].y[:3], np.nan, np.nan])
    draw(found)


def test_a_run_has_one_colour_in_all_figures(study: Study) -> None:
    colors = [{c.name: c.color for c in numbers(study, i).curves} for i in range(3)]
    assert all(color["sol"] == colors[0]["sol"] for color in colors)
    assert len(set(colors[0].values())) == 3


def test_solution_is_that_of_the_median_run(study: Study) -> None:
    found = numbers(study, 0)
    assert found is not None
    chosen = median_result(study.results["small"]["sol"], "test_sol")
    np.testing.assert_array_equal(found.curves[0].y, chosen.solution.model[:, 0])
    assert found.x[-1] == pytest.approx(20.0)
    assert found.horizon == pytest.approx(10.0)
    assert found.data is not None
    assert found.data.shape == (2, 101)


def test_levels_near_each_other_are_one_minimum() -> None:
    assert merged([1.0, 0.5, 0.55, 0.6, 3.0]) == (0.55, 1.0, 3.0)
    assert merged([]) == ()


def test_titles() -> None:
    assert title("sol+stb") == "SOL+STB"
    assert title("2500 steps") == "2500 steps"


def test_files_have_the_numbers_and_the_same_bytes(study: Study, tmp_path: Path) -> None:
    paths = draw_all(study, tmp_path / "a")
    assert {path.name for path in paths} == {
        f"{name}{suffix}" for name in ("solutions", "losses", "real_parts") for suffix in (".csv", ".png", ".pdf")
    }
    again = draw_all(study, tmp_path / "b")
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in again]
    lines = (tmp_path / "a" / "losses.csv").read_text().splitlines()
    assert lines[0] == "step,sol+stb,sol+stb q25,sol+stb q75,sol,sol q25,sol q75"
    assert len(lines) == 6


def test_a_browser_shows_the_page_on_a_phone(study: Study, browser: str, tmp_path: Path) -> None:
    summary = Summary("paper", 2, {"small": "A small study"}, "eigenode reproduce small.yaml")
    folder = tmp_path / "run"
    folder.mkdir()
    path = write_page(study, study.verdicts(), summary, folder)
    text = path.read_text()
    page = Page(text)
    assert page.open == []
    assert page.figures == ["solutions", "losses", "real_parts"]
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.sources)
    assert b"<svg" in base64.b64decode(page.sources[0].partition(",")[2])
    assert "It &lt;b&gt;fits&lt;/b&gt;." in text
    assert text.count('<li class="holds">') == 2
    assert text.count('<li class="fails">') == 1
    (tmp_path / "phone.html").write_text(PHONE.replace("report.html", "index.html"))
    arguments = [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", (tmp_path / "phone.html").as_uri()]
    result = subprocess.run([browser, *CHROMIUM, *arguments], capture_output=True, text=True, check=False, timeout=120)
    body = re.search(r"<body[^>]*>", result.stdout)
    assert body is not None, result.stderr
    facts = dict(re.findall(r'data-(\w+)="([^"]*)"', body[0]))
    assert facts["title"] == "Reproduction under protocol paper"
    assert (facts["images"], facts["drawn"]) == ("3", "3")
    assert facts["fetched"] == "0"
    assert int(facts["width"]) <= 390
    assert float(facts["widest"]) <= 390.0
