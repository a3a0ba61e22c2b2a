"""What all figures share: colours, labels, scales of axes, and how a figure becomes a file.

Matplotlib is imported inside the functions: importing this package costs nothing, and no figure touches pyplot.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import as_file, files
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.runs.atomic import write_bytes
from eigenode_cli.runs.reader import Bools
from eigenode_cli.systems.base import State

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

TRUTH = "#000000"
MODEL = "#0072B2"
FAILED = "#A50026"
UNSTABLE = "#D55E00"
BEYOND = "#6E6E6E"

TERM_COLORS = {
    "sol": "#0072B2",
    "frq": "#E69F00",
    "dmp": "#D55E00",
    "stb": "#009E73",
    "osc": "#CC79A7",
    "stf": "#56B4E9",
    "stp": "#332288",
}
"""One colour a term in every figure: the palette of Okabe & Ito, told apart with all common colour deficiencies."""

OWN_TERM_COLORS = ("#5B5B5B", "#9A8A00", "#7A4FA3", "#8C6D46")
"""Colours of the user's own terms, in their order."""

BORDER_LOOK: dict[str, Any] = {"color": TRUTH, "ls": (0, (4, 2.5)), "lw": 1.0}
"""Black-dashed, the paper's look of what a run is compared with."""

FAILED_LOOK: dict[str, Any] = {"color": FAILED, "marker": "|", "ms": 7, "mew": 1.0, "ls": "none"}
"""Ticks at failed solves."""

WIDE = 30.0
"""Factor between the largest and the typical modulus from which an axis is drawn symlog."""


def term_colors(names: tuple[str, ...]) -> dict[str, str]:
    """Colour of each term; the user's own terms take theirs in the order of `names`."""
    own = [name for name in names if name not in TERM_COLORS]
    extra = {name: OWN_TERM_COLORS[i % len(OWN_TERM_COLORS)] for i, name in enumerate(own)}
    return {name: TERM_COLORS.get(name) or extra[name] for name in names}


def label(state: State) -> str:
    """Axis label of a state, `s in m`, or the symbol alone where it has no unit."""
    return f"${state.symbol}$ in {state.unit}" if state.unit else f"${state.symbol}$"


def short(value: float) -> str:
    """Three significant digits as math text; an en dash where there is no number."""
    if not np.isfinite(value):
        return "\N{EN DASH}"
    if value == 0.0:
        return "$0$"
    if 1e-3 <= abs(value) < 999.5:
        return f"${f'{value:#.3g}'.rstrip('.')}$"
    mantissa, exponent = f"{value:.1e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$"


@dataclass(frozen=True)
class Scale:
    """Scale of an axis: linear, or symlog with the modulus `threshold` up to which it is linear."""

    threshold: float | None

    @property
    def linear(self) -> bool:
        """Whether the axis is linear."""
        return self.threshold is None


def choose_scale(values: Floats, typical: float) -> Scale:
    """Linear where the axis can show both the largest modulus of `values` and the `typical` one, else symlog.

    Args:
        values: what the axis shows, any shape; NaN and infinity are passed over.
        typical: modulus that must stay readable, in the unit of `values`; 0 asks for a linear axis.
    """
    finite = np.abs(values[np.isfinite(values)])
    if finite.size == 0 or not np.isfinite(typical) or typical <= 0.0 or finite.max() <= WIDE * typical:
        return Scale(None)
    return Scale(float(10.0 ** np.floor(np.log10(typical))))


def apply_scale(ax: "Axes", axis: str, scale: Scale) -> None:
    """Set the scale of the axis `x` or `y`."""
    if scale.threshold is None:
        return
    from matplotlib.ticker import SymmetricalLogLocator  # noqa: PLC0415

    threshold = scale.threshold
    (ax.set_xscale if axis == "x" else ax.set_yscale)("symlog", linthresh=threshold)
    locator = SymmetricalLogLocator(base=10.0, linthresh=threshold)
    locator.set_params(numticks=7)
    (ax.xaxis if axis == "x" else ax.yaxis).set_major_locator(locator)


def set_limits(ax: "Axes", axis: str, limits: tuple[float, float], scale: Scale, room: float) -> None:
    """Set limits that hold [low, high] with `room`, a fraction of their span, on both sides, as the scale sees it."""
    low, high = limits
    setter = ax.set_xlim if axis == "x" else ax.set_ylim
    if scale.threshold is None:
        gap = room * (high - low) if high > low else max(0.5 * abs(high), 0.5)
        setter(low - gap, high + gap)
    else:
        factor, edge = 2.0, scale.threshold / 2.0
        setter(
            low * factor if low < -edge else low / factor if low > edge else low - edge,
            high * factor if high > edge else high / factor if high < -edge else high + edge,
        )


def frame(values: Floats) -> tuple[float, float]:
    """Smallest and largest finite number, (0, 1) where there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)


def time_colormap() -> "Colormap":
    """Viridis without its brightest end, which is lost on white paper."""
    import matplotlib  # noqa: PLC0415
    from matplotlib.colors import ListedColormap  # noqa: PLC0415

    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.92, 256)), name="time")


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's defaults with the shipped style on top; whatever the user has set is kept out and put back."""
    import matplotlib  # noqa: PLC0415

    with as_file(files("eigenode_cli.reporting.figures") / "eigenode.mplstyle") as path:
        rc = matplotlib.rc_params_from_file(path, use_default_template=True)
    with matplotlib.rc_context({key: value for key, value in rc.items() if not key.startswith("backend")}):
        yield


def new_figure(height: float | None = None) -> "Figure":
    """Return an empty figure on the Agg canvas, of the style's width and a height in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure()
    if height is not None:
        figure.set_figheight(height)
    FigureCanvasAgg(figure)
    return figure


def save(figure: "Figure", path: Path) -> None:
    """Write `path`, .png or .pdf, without times or versions: the same figure gives the same bytes."""
    empty = {".png": {"Software": None}, ".pdf": {"Creator": None, "Producer": None, "CreationDate": None}}
    buffer = BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], metadata=empty[path.suffix])
    write_bytes(path, buffer.getvalue())


def to_svg(figure: "Figure") -> bytes:
    """Return the figure as a self-contained SVG, text as outlines."""
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def entry(text: str, **look: Any) -> "Line2D":
    """Return a legend entry with the look of a line."""
    from matplotlib.lines import Line2D  # noqa: PLC0415

    return Line2D([], [], label=text, **look)


def legend_above(ax: "Axes", entries: Sequence["Artist"], columns: int) -> None:
    """Draw the legend over the axes, outside of the data."""
    ax.legend(handles=list(entries), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns)


def mark_failed(ax: "Axes", steps: Floats) -> None:
    """Draw a tick on the horizontal axis at each step whose solve failed."""
    height = np.full(steps.size, 0.012)
    ax.plot(steps, height, transform=ax.get_xaxis_transform(), clip_on=False, zorder=6, **FAILED_LOOK)


def failed_entry(failed: int, records: int) -> "Line2D":
    """Return the legend entry of `mark_failed` with the count."""
    return entry(f"failed solve ({failed} of {records} records)", **FAILED_LOOK)


def step_axis(ax: "Axes", steps: Floats) -> None:
    """Set up the horizontal axis of a figure over training steps `(R,)`, also of a single record."""
    ax.set_xlabel("training step")
    if steps.size == 1:
        ax.set_xlim(steps[0] - 1.0, steps[0] + 1.0)
        ax.set_xticks(steps)
    else:
        ax.set_xlim(steps[0], steps[-1])


def shade_unstable(ax: "Axes", axis: str) -> None:
    """Shade the unstable half of an axis, `x` or `y`, which holds real parts; its border black-dashed."""
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    low, high = ax.get_xlim() if axis == "x" else ax.get_ylim()
    far = 10.0 * max(abs(low), abs(high))
    size, transform = ((far, 1.0), ax.get_xaxis_transform()) if axis == "x" else ((1.0, far), ax.get_yaxis_transform())
    # an artist, not a span: it must not take part in the limits, which an equal aspect may still widen
    ax.add_artist(Rectangle((0.0, 0.0), *size, transform=transform, color=UNSTABLE, alpha=0.08, lw=0, zorder=0))
    (ax.axvline if axis == "x" else ax.axhline)(0.0, zorder=2, **BORDER_LOOK)


def isolated(values: Floats) -> Bools:
    """Which numbers `(R,)` stand between two NaN (or at an end beside one): a line would not show them."""
    known = np.isfinite(values)
    return known & ~np.append(known[1:], False) & ~np.insert(known[:-1], 0, False)


def draw_line(ax: "Axes", x: Floats, y: Floats, zorder: float, **look: Any) -> None:
    """Draw a line that is broken at NaN, with a dot for a point that stands alone."""
    alone = isolated(y)
    ax.plot(x, y, zorder=zorder, **look)
    ax.plot(x[alone], y[alone], zorder=zorder, **{**look, "ls": "none", "marker": "o", "ms": 1.8 * look["lw"]})


def note(ax: "Axes", x: float, y: float, text: str, color: str) -> None:
    """Write a small remark whose upper right corner is at the fraction (x, y) of the axes."""
    ax.text(x, y, text, transform=ax.transAxes, color=color, fontsize=8, style="italic", ha="right", va="top")


def warn(ax: "Axes", text: str) -> None:
    """Write across the middle of the axes that something is missing."""
    box = {"facecolor": "white", "edgecolor": FAILED, "linewidth": 0.6, "boxstyle": "round,pad=0.4"}
    ax.text(
        0.5, 0.5, text, transform=ax.transAxes, color=FAILED, fontsize=9, ha="center", va="center", bbox=box, zorder=9
    )
