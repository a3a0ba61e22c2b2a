"""The report of one run: what stands on it, and that a real browser shows it with nothing else at hand."""

import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.console import NOTHING
from eigenode_cli.reporting.page import page_number as number
from eigenode_cli.reporting.report import CAPTIONS, headline, metrics_table, write_report
from eigenode_cli.runs.reader import read_run
from tests import fake_run

FIGURES = ["convergence", "stability", "solution", "eigenvalues", "phase", "region"]
CHROMIUM = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--allow-file-access-from-files",
    "--virtual-time-budget=5000",
]

PHONE = """<!DOCTYPE html><html><body style="margin:0">
<iframe src="run/report.html" style="width:390px;height:800px;border:0"></iframe>
<script>
addEventListener("load", () => {
  const page = document.querySelector("iframe").contentDocument;
  const images = [...page.images];
  const facts = {
    title: page.title,
    width: page.documentElement.scrollWidth,
    images: images.length,
    drawn: images.filter((image) => image.complete && image.naturalWidth > 100).length,
    widest: Math.max(...images.map((image) => image.getBoundingClientRect().right)),
    fetched: document.querySelector("iframe").contentWindow.performance.getEntriesByType("resource")
      .filter((entry) => !entry.name.startsWith("data:")).length,
    alerts: page.querySelectorAll("script, b").length,
  };
  for (const [name, value] of Object.entries(facts)) document.body.dataset[name] = value;
});
</script></body></html>"""


class Page(HTMLParser):
    """Tags that are left open, texts of the page, and every address in it."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.figures: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.sources += [value for name, value in attrs if name in ("src", "href", "srcset", "action") and value]
        if tag == "figure":
            self.figures.append(values["id"] or "")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of an oscillator's run."""
    return fake_run.write_oscillator(tmp_path / "run")


@pytest.fixture
def browser() -> str:
    """The command of a Chromium."""
    command = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if command is None and not os.environ.get("CI"):
        pytest.skip("no chromium on this machine (apt-get install chromium); on CI this is a failure")
    assert command is not None, "CI must have a chromium to open the report"
    return command


def test_the_page_is_well_formed_and_self_contained(folder: Path) -> None:
    path = write_report(folder).path
    assert path == folder / "report.html"
    text = path.read_text()
    page = Page(text)
    assert page.open == []
    assert page.figures == FIGURES
    assert len(page.sources) == len(FIGURES)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.sources)
    assert "url(" not in text
    assert "@import" not in text


def test_what_stands_on_it(folder: Path) -> None:
    text = write_report(folder).path.read_text()
    for part in (
        "sol+frq+dmp+osc, protocol paper, seed 0",
        "eigenode train system=oscillator grads=sol+frq+dmp+osc",
        "0123456789abcdef0123456789abcdef01234567",
        "record_every: 25",
        "Failed solves: 3 underflow.",
        "2.13.0",
    ):
        assert part in text


def test_the_same_files_give_the_same_bytes(folder: Path) -> None:
    first = write_report(folder).path.read_bytes()
    assert write_report(folder).path.read_bytes() == first


def test_headline(folder: Path) -> None:
    run = read_run(folder)
    tiles = {tile["title"]: (tile["value"], tile["remark"]) for tile in headline(run)}
    assert tiles["SOL, last record"] == (number(float(run.metrics.terms["sol"][-1])), "")
    assert tiles["Dense error"] == (number(float(run.metrics.dense_error[-1])), "m")
    assert tiles["Largest real part"][1] == "1/s, stable"
    assert tiles["Failed solves"] == ("3", "of 201 records")


def test_nothing_is_shown_as_nothing(tmp_path: Path) -> None:
    folder = fake_run.write_unsolvable(tmp_path / "run")
    tiles = {tile["title"]: (tile["value"], tile["remark"]) for tile in headline(read_run(folder))}
    assert tiles["SOL, last record"] == tiles["Dense error"] == tiles["Largest real part"] == (NOTHING, "")
    assert tiles["Failed solves"] == ("21", "of 21 records")
    text = write_report(folder).path.read_text()
    assert "the field could not be solved at any step" in text
    assert 'class="badge failed"' in text


def test_table_has_the_first_and_the_last_record(folder: Path) -> None:
    metrics = read_run(folder).metrics
    table = metrics_table(metrics)
    steps = [row["cells"][0] for row in table["rows"]]
    assert (steps[0], steps[-1], len(steps)) == ("0", "5,000", 12)
    assert all(len(row["cells"]) == len(table["header"]) for row in table["rows"])
    assert table["header"][:7] == ["step", "SOL", "FRQ", "DMP", "STB", "OSC", "STF"]


def test_a_single_record_is_one_row(tmp_path: Path) -> None:
    metrics = read_run(fake_run.write_single_record(tmp_path / "run")).metrics
    assert [row["cells"][0] for row in metrics_table(metrics)["rows"]] == ["0"]


def test_caption_names_the_local_minimum(folder: Path) -> None:
    assert re.search(r"Local minima \(black-dashed\): 0\.57\d from step ", CAPTIONS["convergence"](read_run(folder)))


def test_numbers() -> None:
    assert number(-0.02) == "\N{MINUS SIGN}0.02"
    assert number(np.nan) == number(np.inf) == NOTHING


def test_a_missing_file_is_named(folder: Path) -> None:
    (folder / "solution.csv").unlink()
    path, faults = write_report(folder)
    assert [fault.partition(" in ")[0] for fault in faults] == ["solution.csv is missing"]
    text = path.read_text()
    assert faults[0] in text
    assert Page(text).figures == ["convergence", "stability", "eigenvalues", "region"]


@pytest.mark.parametrize("key", ["error", "command", "engine"])
def test_text_is_escaped(folder: Path, key: str) -> None:
    fake_run.change_json(folder, **{key: "<script>alert('&')</script>"})
    text = write_report(folder).path.read_text()
    assert "<script" not in text
    assert "&lt;script&gt;alert(&#39;&amp;&#39;)" in text


def test_a_browser_shows_it_on_a_phone(folder: Path, browser: str, tmp_path: Path) -> None:
    fake_run.change_json(folder, error="<b>bold</b><script>document.title='owned'</script>", status="failed")
    write_report(folder)
    (tmp_path / "phone.html").write_text(PHONE)
    arguments = [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", (tmp_path / "phone.html").as_uri()]
    result = subprocess.run([browser, *CHROMIUM, *arguments], capture_output=True, text=True, check=False, timeout=120)
    body = re.search(r"<body[^>]*>", result.stdout)
    assert body is not None, result.stderr
    facts = dict(re.findall(r'data-(\w+)="([^"]*)"', body[0]))
    assert facts["title"] == "Oscillator, sol+frq+dmp+osc, seed 0"
    assert (facts["images"], facts["drawn"]) == ("6", "6")
    assert (facts["fetched"], facts["alerts"]) == ("0", "0")
    assert int(facts["width"]) <= 390
    assert float(facts["widest"]) <= 390.0
