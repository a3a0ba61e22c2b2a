"""Labels, colours, scales and files."""

import itertools

import numpy as np
import pytest

from eigenode_cli.reporting.figures.style import (
    TERM_COLORS,
    Scale,
    choose_scale,
    frame,
    isolated,
    label,
    short,
    term_colors,
)
from eigenode_cli.systems.base import State
from eigenode_cli.terms import NAMES


def test_every_term_has_its_own_colour() -> None:
    assert tuple(TERM_COLORS) == NAMES
    colors = term_colors((*NAMES, "energy", "drift"))
    assert len(set(colors.values())) == len(colors)
    assert term_colors(("drift",)) == {"drift": colors["energy"]}


# linear RGB as seen without the red or the green cones (Viénot, Brettel & Mollon 1999)
BLINDNESS = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def lab(color: str, blindness: str) -> np.ndarray:
    """CIELAB coordinates of a colour as it is seen."""
    channels = np.array([int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(BLINDNESS[blindness]) @ linear, 0.0, 1.0)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.array(to_xyz) @ seen / [0.9505, 1.0, 1.089])
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_terms_are_told_apart_without_red_or_green_cones(blindness: str) -> None:
    for one, other in itertools.combinations(TERM_COLORS.values(), 2):
        assert np.linalg.norm(lab(one, blindness) - lab(other, blindness)) > 8.0


def test_labels() -> None:
    assert label(State("s", "m", "s")) == "$s$ in m"
    assert label(State("nu", "", r"\nu")) == r"$\nu$"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "$0$"),
        (0.5778, "$0.578$"),
        (1.1, "$1.10$"),
        (123.4, "$123$"),
        (999.7, r"$1.0\times10^{3}$"),
        (-0.02, "$-0.0200$"),
        (1.26e-7, r"$1.3\times10^{-7}$"),
        (float("nan"), "\N{EN DASH}"),
        (float("inf"), "\N{EN DASH}"),
    ],
)
def test_short_numbers(value: float, text: str) -> None:
    assert short(value) == text


def test_scale() -> None:
    assert choose_scale(np.array([-3.0, 2.0, np.nan]), 1.0).linear
    assert choose_scale(np.array([-300.0, 2.0, np.inf]), 3.0) == Scale(1.0)
    assert choose_scale(np.array([5.0]), 0.0).linear
    assert choose_scale(np.array([np.nan]), np.nan).linear


def test_frame() -> None:
    assert frame(np.array([np.nan, 2.0, -1.0, np.inf])) == (-1.0, 2.0)
    assert frame(np.array([np.nan])) == (0.0, 1.0)


def test_isolated() -> None:
    nan = np.nan
    assert isolated(np.array([1.0, nan, 1.0, nan, 1.0, 1.0])).tolist() == [True, False, True, False, False, False]
    assert isolated(np.array([1.0])).tolist() == [True]
