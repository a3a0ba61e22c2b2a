"""The spectrum in the stability region of the solver that the learned field is to run on."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eigenode_cli.arrays import Complexes, Floats
from eigenode_cli.reporting.figures.style import BORDER_LOOK, FAILED, MODEL, entry, legend_above, new_figure
from eigenode_cli.runs.reader import Run
from eigenode_cli.solve.stability import stability_polynomial

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FINE = 301
"""Points of the grid on which the border is found, in each direction."""


@dataclass(frozen=True)
class Region:
    """What the figure shows.

    Attributes:
        method, step: of the solver; the step in s.
        values: eigenvalues along the model's trajectory times the step `(E,)`.
        growth: by what a step multiplies each mode `(E,)`.
        real, imaginary: axes of the grid `(F,)`; border: growth on it `(F, F)`.
    """

    method: str
    step: float
    values: Complexes
    growth: Floats
    real: Floats
    imaginary: Floats
    border: Floats


def region_numbers(run: Run) -> Region:
    """Return the numbers of the figure."""
    settings = run.config["stp"]
    method, step = str(settings["method"]), float(settings["step"])
    polynomial = np.polynomial.Polynomial(stability_polynomial(method))
    known = run.eigenvalues.values[np.isfinite(run.eigenvalues.values)]
    values = step * known
    # wide enough for the region of every method that there is, and for the spectrum
    left = min(-4.0, 1.1 * float(values.real.min(initial=0.0)))
    right = max(1.0, 1.1 * float(values.real.max(initial=0.0)))
    top = max(4.0, 1.1 * float(np.abs(values.imag).max(initial=0.0)))
    real, imaginary = np.linspace(left, right, FINE), np.linspace(-top, top, FINE)
    border = np.abs(polynomial(real[None, :] + 1j * imaginary[:, None]))
    return Region(method, step, values, np.abs(polynomial(values)), real, imaginary, border)


def draw_region(numbers: Region) -> "Figure":
    """Return the figure."""
    figure = new_figure(3.9)
    ax = figure.subplots()
    ax.contourf(numbers.real, numbers.imaginary, numbers.border, levels=[0.0, 1.0], colors=["#EDEDED"])
    ax.contour(numbers.real, numbers.imaginary, numbers.border, levels=[1.0], colors="black", linewidths=1.0)
    inside = numbers.growth <= 1.0
    looks = (
        ("inside", {"color": MODEL, "marker": "o", "ms": 3.5, "ls": "none"}, inside),
        ("outside", {"color": FAILED, "marker": "x", "ms": 4.5, "ls": "none", "mew": 1.0}, ~inside),
    )
    entries = [entry(f"$|R(h\\lambda)| = 1$ of {numbers.method}", **(BORDER_LOOK | {"ls": "-"}))]
    for name, look, chosen in looks:
        if chosen.any():
            ax.plot(numbers.values.real[chosen], numbers.values.imag[chosen], zorder=3, **look)
            entries.append(entry(f"eigenvalues {name}", **look))
    legend_above(ax, entries, columns=3)
    ax.set_xlabel(rf"$\mathrm{{Re}}\,h\lambda$, $h = {numbers.step:g}$ s")
    ax.set_ylabel(r"$\mathrm{Im}\,h\lambda$")
    return figure
