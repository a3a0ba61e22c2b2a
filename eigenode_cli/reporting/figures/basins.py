"""Where trajectories go over a grid of initial states."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from eigenode_cli.arrays import Floats
from eigenode_cli.reporting.figures.style import (
    FAILED,
    TRUTH,
    entry,
    house_style,
    label,
    legend_above,
    new_figure,
    time_colormap,
)
from eigenode_cli.systems.base import State

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_basins(table: pd.DataFrame, trajectory: Floats, axes: tuple[State, State], path: Path) -> None:
    """Draw a mark at each initial state, coloured by how far its trajectory still swings at the end.

    Args:
        table: a row for each: the two states by name, and `size`.
        trajectory: of the model itself `(D, 2)`.
        axes: the two states.
        path: of the picture; its suffix says which kind.
    """
    with house_style():
        _figure(table, trajectory, axes).savefig(path, dpi=200)


def _figure(table: pd.DataFrame, trajectory: Floats, axes: tuple[State, State]) -> "Figure":
    figure = new_figure(3.9)
    ax = figure.subplots()
    inside = table.loc[np.isfinite(table["size"].to_numpy())]
    gone = table.loc[~np.isfinite(table["size"].to_numpy())]
    area = 1.5e4 / len(table)
    x, y = axes[0].name, axes[1].name
    marks = ax.scatter(inside[x], inside[y], c=inside["size"], s=area, cmap=time_colormap(), vmin=0.0, marker="s", lw=0)
    figure.colorbar(marks, ax=ax, label="size at the end in half ranges of the model")
    ax.plot(*trajectory.T, color=TRUTH, lw=0.8)
    entries = [entry("the model's own trajectory", color=TRUTH, lw=0.9)]
    if len(gone):
        look = {"color": FAILED, "marker": "x", "ls": "none", "mew": 1.0}
        ax.plot(gone[x].to_numpy(), gone[y].to_numpy(), ms=max(2.0, 0.6 * area**0.5), **look)
        entries.append(entry(f"leaves ({len(gone)})", ms=5, **look))
    ax.margins(0.06)
    legend_above(ax, entries, columns=2)
    ax.set_xlabel(label(axes[0]))
    ax.set_ylabel(label(axes[1]))
    return figure
