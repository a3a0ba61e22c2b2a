"""Figures of one run: pure functions of the files in its folder.

Every figure is two functions, one from the run to the numbers that it shows and one from those numbers to a drawing.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eigenode_cli.interruption import check
from eigenode_cli.reporting.figures.convergence import convergence_numbers, draw_convergence
from eigenode_cli.reporting.figures.eigenvalues import draw_eigenvalues, eigenvalue_numbers
from eigenode_cli.reporting.figures.phase import draw_phase, phase_numbers
from eigenode_cli.reporting.figures.region import draw_region, region_numbers
from eigenode_cli.reporting.figures.solution import draw_solution, solution_numbers
from eigenode_cli.reporting.figures.stability import draw_stability, stability_numbers
from eigenode_cli.reporting.figures.style import house_style, save, to_svg
from eigenode_cli.runs.atomic import WriteError, make_folder
from eigenode_cli.runs.reader import Run, open_run
from eigenode_cli.runs.runfile import RecordError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: dict[str, tuple[Callable[[Run], Any], Callable[[Any], "Figure"]]] = {
    "convergence": (convergence_numbers, draw_convergence),
    "stability": (stability_numbers, draw_stability),
    "solution": (solution_numbers, draw_solution),
    "eigenvalues": (eigenvalue_numbers, draw_eigenvalues),
    "phase": (phase_numbers, draw_phase),
    "region": (region_numbers, draw_region),
}
"""Name of each figure, what it shows and how it is drawn."""


def figures_of(run: Run) -> list[str]:
    """Names of the figures that a run has; a phase portrait takes two states, a stability region a stated step."""
    left_out = {"phase"} if len(run.states) < 2 else set()
    if (run.config.get("stp") or {}).get("step") is None:  # also of a run from before there was one
        left_out.add("region")
    return [name for name in FIGURES if name not in left_out]


class Drawn(NamedTuple):
    """The files of the figures, and a line for each thing that kept another figure from being drawn."""

    paths: list[Path]
    faults: list[str]


def draw_run(folder: Path) -> Drawn:
    """Draw every figure of the run in `folder` that its files allow into its `plots/`, each as .png and .pdf.

    The same recorded files give the same bytes.

    Raises:
        RecordError: run.json is missing, or does not hold what is needed.
        WriteError: a figure cannot be written.
    """
    run = open_run(folder)
    plots = folder / "plots"
    drawn = Drawn([], [])
    for name in figures_of(run):
        check()
        with house_style(), contained(name, drawn.faults):
            figure = _figure(run, name)
            make_folder(plots)
            for suffix in (".png", ".pdf"):
                path = plots / f"{name}{suffix}"
                save(figure, path)
                figure.set_layout_engine("none")  # found once: both files have the same
                drawn.paths.append(path)
    return drawn


@contextmanager
def contained(name: str, faults: list[str]) -> Iterator[None]:
    """Add what is wrong with the recorded files to `faults`, once, and go on; `name` is of what is drawn from them."""
    try:
        yield
    except RecordError as error:
        line = str(error)
    except WriteError:
        raise
    except Exception as error:  # numbers that no file of a run holds: the other figures are drawn all the same
        line = f"{name} cannot be drawn ({type(error).__name__}: {error})"
    else:
        return
    if line not in faults:
        faults.append(line)


def svg_of(run: Run, name: str) -> bytes:
    """One figure of a run as a self-contained SVG."""
    with house_style():
        return to_svg(_figure(run, name))


def draw_figure(run: Run, name: str) -> "Figure":
    """Draw one figure of a run, in the style that all have.

    Raises:
        RecordError: a file that it is drawn from is missing or damaged.
    """
    with house_style():
        return _figure(run, name)


def _figure(run: Run, name: str) -> "Figure":
    numbers_of, draw = FIGURES[name]
    return draw(numbers_of(run))
