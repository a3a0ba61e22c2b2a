"""Figures of one run: pure functions of the files in its folder.

Every figure is two functions, one from the run to the numbers that it shows and one from those numbers to a drawing.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eigenode_cli.figures.convergence import convergence_numbers, draw_convergence
from eigenode_cli.figures.eigenvalues import draw_eigenvalues, eigenvalue_numbers
from eigenode_cli.figures.phase import draw_phase, phase_numbers
from eigenode_cli.figures.solution import draw_solution, solution_numbers
from eigenode_cli.figures.stability import draw_stability, stability_numbers
from eigenode_cli.figures.style import house_style, save, to_svg
from eigenode_cli.interruption import check
from eigenode_cli.records import Run, read_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: dict[str, tuple[Callable[[Run], Any], Callable[[Any], "Figure"]]] = {
    "convergence": (convergence_numbers, draw_convergence),
    "stability": (stability_numbers, draw_stability),
    "solution": (solution_numbers, draw_solution),
    "eigenvalues": (eigenvalue_numbers, draw_eigenvalues),
    "phase": (phase_numbers, draw_phase),
}
"""Name of each figure, what it shows and how it is drawn."""


def figures_of(run: Run) -> list[str]:
    """Names of the figures that a run has; a phase portrait takes two states."""
    return [name for name in FIGURES if name != "phase" or len(run.states) > 1]


def draw_run(folder: Path) -> list[Path]:
    """Draw every figure of the run in `folder` into its `plots/`, each as .png and .pdf, and give their paths.

    The same recorded files give the same bytes.

    Raises:
        RecordError: a recorded file is missing or does not hold what is needed.
    """
    run = read_run(folder)
    plots = folder / "plots"
    plots.mkdir(exist_ok=True)
    paths: list[Path] = []
    for name in figures_of(run):
        check()
        numbers_of, draw = FIGURES[name]
        with house_style():
            figure = draw(numbers_of(run))
            for suffix in (".png", ".pdf"):
                path = plots / f"{name}{suffix}"
                save(figure, path)
                paths.append(path)
    return paths


def svg_of(run: Run, name: str) -> bytes:
    """One figure of a run as a self-contained SVG."""
    numbers_of, draw = FIGURES[name]
    with house_style():
        return to_svg(draw(numbers_of(run)))
