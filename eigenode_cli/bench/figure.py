"""Figures of bench.json: ratios with their spread, and growth with its exponents."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.bench.contestants import OURS, PEERS
from eigenode_cli.bench.growth import fit_power
from eigenode_cli.bench.table import number
from eigenode_cli.reporting.figures.style import BORDER_LOOK, entry, house_style, legend_above, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = {
    "compiled": "#000000",
    "torch": "#56B4E9",
    "torchdiffeq": "#D55E00",
    "torchode": "#E69F00",
    "diffrax": "#0072B2",
}
"""One colour a contestant, of the palette of Okabe & Ito."""
TITLES = {OURS.name: OURS.title, **{name: peer.title for name, peer in PEERS.items()}}


def draw_ratios(content: dict[str, Any]) -> "Figure":
    """Time of each peer over ours, median and quartiles, one row a case."""
    cases = content["cases"]
    figure = new_figure(1.2 + 0.75 * len(cases))
    ax = figure.subplots()
    present = [name for name in PEERS if any(name in case["ratios"] for case in cases.values())]
    for row, case in enumerate(cases.values()):
        for place, name in enumerate(present):
            if name not in case["ratios"]:
                continue
            ratio, y = case["ratios"][name], row + 0.16 * (place - 0.5 * (len(present) - 1))
            ax.plot([ratio["low"], ratio["high"]], [y, y], color=COLORS[name], lw=2.4, solid_capstyle="butt")
            ax.plot(ratio["median"], y, color=COLORS[name], marker="o", ms=4.5)
            ax.annotate(
                number(ratio["median"]),
                (ratio["high"], y),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
    ax.axvline(1.0, **BORDER_LOOK)
    ax.set_xscale("log")
    ax.margins(x=0.12)
    ax.set_yticks(range(len(cases)), list(cases))
    ax.set_ylim(len(cases) - 0.5, -0.5)
    ax.set_xlabel("time of one loss Jacobian over ours")
    legend_above(ax, [entry(TITLES[name], color=COLORS[name], marker="o", lw=2.4) for name in present], columns=4)
    return figure


def draw_growth(content: dict[str, Any]) -> "Figure":
    """Time over each varied quantity, relative to ours at its first value, with the fitted exponents."""
    curves = content["growth"]
    columns = 2
    rows = -(-len(curves) // columns)
    figure = new_figure(0.6 + 2.3 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (name, curve) in zip(grid.flat, curves.items(), strict=False):
        _draw_curve(ax, name, curve)
    for ax in grid.flat[len(curves) :]:
        ax.set_axis_off()
    return figure


def _draw_curve(ax: "Axes", name: str, curve: dict[str, Any]) -> None:
    x = np.array(curve["values"], dtype=np.float64)
    unit = curve["seconds"][OURS.name][0]
    for contestant, seconds in curve["seconds"].items():
        y, color = np.array(seconds) / unit, COLORS[contestant]
        law = fit_power(x, y)
        ax.plot(x, y, color=color, marker="o", ms=4, ls="none")
        ax.plot(x, law.a * x**law.b, color=color, lw=1.2, label=f"{TITLES[contestant]}  $b = {law.b:.2f}$")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xticks(x, [f"{value:g}" for value in x])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("horizon in s" if curve["quantity"] == "horizon" else curve["quantity"])
    ax.set_ylabel("time over ours at the first")
    ax.set_title(name, fontsize=9)
    ax.legend(fontsize=7, loc="upper left")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.35)  # room for the legend


def draw_bench(content: dict[str, Any], folder: Path) -> list[Path]:
    """Draw what was measured into `folder`, each as .png and .pdf, and give the paths."""
    paths: list[Path] = []
    for name, draw, shown in (("ratios", draw_ratios, "cases"), ("growth", draw_growth, "growth")):
        if content[shown]:
            with house_style():
                figure = draw(content)
                for suffix in (".png", ".pdf"):
                    paths.append(folder / f"{name}{suffix}")
                    save(figure, paths[-1])
    return paths
