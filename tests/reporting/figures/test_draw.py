"""Every figure of every kind of run is drawn: without a warning, to the same bytes, without pyplot."""

import json
import subprocess
import sys
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from eigenode_cli.reporting.figures import FIGURES, draw_run, figures_of, svg_of
from eigenode_cli.reporting.figures.style import MODEL, house_style, save
from eigenode_cli.runs.reader import Run, read_run
from tests import fake_run


def pixels(run: Run, name: str) -> np.ndarray:
    """The figure as RGB `(height, width, 3)` in 0..255 at a low resolution."""
    numbers_of, draw = FIGURES[name]
    with house_style():
        figure = draw(numbers_of(run))
        buffer = BytesIO()
        figure.savefig(buffer, format="rgba", dpi=100)
    width, height = (round(100 * inches) for inches in figure.get_size_inches())
    return np.frombuffer(buffer.getvalue(), dtype=np.uint8).reshape(height, width, 4)[..., :3]


def count(image: np.ndarray, color: str) -> int:
    """Number of pixels of nearly that colour."""
    wanted = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return int((np.abs(image.astype(int) - wanted).max(axis=2) < 12).sum())


@pytest.mark.parametrize("name", FIGURES)
def test_draws_without_warning(run: Run, name: str, caplog: pytest.LogCaptureFixture) -> None:
    image = pixels(run, name)
    assert (image < 250).any(axis=2).mean() > 0.01
    assert [record.message for record in caplog.records] == []  # matplotlib logs what it ignores


@pytest.mark.parametrize("name", ["convergence", "stability", "solution", "phase"])
def test_the_model_is_drawn_where_there_is_one(runs: dict[str, Run], name: str) -> None:
    assert count(pixels(runs["oscillator"], name), MODEL) > 100
    # all that is left of it is its entry in the legend, if that
    assert count(pixels(runs["unsolvable"], name), MODEL) < 100


def test_draw_run_writes_every_figure_twice(tmp_path: Path) -> None:
    folder = fake_run.write_single_record(tmp_path / "run")
    paths, faults = draw_run(folder)
    assert faults == []
    assert paths == [folder / "plots" / f"{name}{suffix}" for name in FIGURES for suffix in (".png", ".pdf")]
    assert all(path.read_bytes()[:4] == (b"%PDF" if path.suffix == ".pdf" else b"\x89PNG") for path in paths)


@pytest.mark.parametrize("suffix", [".png", ".pdf"])
@pytest.mark.parametrize("name", FIGURES)
def test_the_same_files_give_the_same_bytes(tmp_path: Path, runs: dict[str, Run], name: str, suffix: str) -> None:
    numbers_of, draw = FIGURES[name]
    contents = []
    for take in range(2):
        path = tmp_path / f"{take}{suffix}"
        with house_style():
            save(draw(numbers_of(runs["oscillator"])), path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert b"Date" not in contents[0]
    assert b"matplotlib" not in contents[0].lower()


def test_pdf_embeds_truetype(tmp_path: Path, runs: dict[str, Run]) -> None:
    numbers_of, draw = FIGURES["stability"]
    path = tmp_path / "stability.pdf"
    with house_style():
        save(draw(numbers_of(runs["oscillator"])), path)
    content = path.read_bytes()
    assert b"/FontFile2" in content
    assert b"/Type3" not in content


def test_the_users_settings_change_nothing_and_come_back(runs: dict[str, Run]) -> None:
    plain = svg_of(runs["single_record"], "stability")
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 30.0}):
        assert svg_of(runs["single_record"], "stability") == plain
        assert matplotlib.rcParams["font.size"] == 30.0


def test_one_state_has_no_phase_portrait(tmp_path: Path) -> None:
    folder = fake_run.write_oscillator(tmp_path / "run")
    fake_run.change_json(
        folder, system={"name": "x", "title": "X", "states": [{"name": "s", "unit": "m", "symbol": "s"}]}
    )
    assert figures_of(read_run(folder)) == ["convergence", "stability", "solution", "eigenvalues", "region"]
    record = json.loads((folder / "run.json").read_text())
    fake_run.change_json(folder, config=record["config"] | {"stp": {"method": "rk4", "step": None}})
    assert figures_of(read_run(folder)) == ["convergence", "stability", "solution", "eigenvalues"]


def test_without_truth_the_data_is_enough(tmp_path: Path) -> None:
    folder = fake_run.write_oscillator(tmp_path / "run")
    path = folder / "solution.csv"
    header, *rows = path.read_text().splitlines()
    blank = [",".join([row.split(",")[0], "", "", *row.split(",")[3:]]) for row in rows]
    path.write_text("\n".join([header, *blank]) + "\n")
    run = read_run(folder)
    for name in FIGURES:
        assert (pixels(run, name) < 250).any()


def test_matplotlib_is_imported_by_drawing_alone_and_pyplot_never(tmp_path: Path) -> None:
    folder = fake_run.write_single_record(tmp_path / "run")
    code = f"""
import sys
from pathlib import Path
from eigenode_cli.reporting.figures import svg_of
from eigenode_cli.runs.reader import read_run
run = read_run(Path({str(folder)!r}))
assert "matplotlib" not in sys.modules
svg_of(run, "eigenvalues")
assert "matplotlib.pyplot" not in sys.modules
"""
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert result.stderr == ""
    assert result.returncode == 0
