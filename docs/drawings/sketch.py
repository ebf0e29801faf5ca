"""What the sketches share: points of space seen in parallel projection, arrows and words."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

INK, SHELL, PAPER = "black", "0.45", "0.94"
BODY, MASS, FORCE, SLIP, PATH = "#004488", "#D55E00", "#BB5566", "#8C6D00", "#0072B2"
WORDS = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=11)
SMALL = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=9)


class Camera:
    """A parallel projection; ``azimuth`` and ``elevation`` of the eye are in degrees, e3 points up."""

    def __init__(self, azimuth: float, elevation: float):
        a, b = np.radians([azimuth, elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        up = [-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)]
        self.screen = np.array([right, up])

    def __call__(self, points: Any) -> Float[np.ndarray, "... 2"]:
        return np.asarray(points, dtype=float) @ self.screen.T


def canvas(figure: Figure, place: Any) -> Axes:
    """Axes without a frame, at one scale in both directions."""
    ax = figure.add_subplot(place)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return ax


def arrow(
    ax: Axes, start: Any, end: Any, colour: str = INK, label: str = "", shift: Any = (0.0, 0.0), **look: Any
) -> None:
    """An arrow between two points of the screen, with a label beside its tip."""
    style = {
        "arrowstyle": "-|>",
        "mutation_scale": 9,
        "shrinkA": 0,
        "shrinkB": 0,
        "linewidth": 1.3,
        "color": colour,
    } | look
    ax.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=style)
    ax.update_datalim([start, end])
    if label:
        word(ax, np.asarray(end) + shift, label, colour)


def word(ax: Axes, at: Any, text: str, colour: str = INK, **options: Any) -> None:
    options = {"ha": "center", "va": "center", "fontproperties": WORDS} | options
    ax.text(*at, text, color=colour, **options)


def dot(ax: Axes, at: Any, colour: str = INK, size: float = 4.0, **look: Any) -> None:
    ax.plot(*np.transpose([at]), "o", color=colour, ms=size, mew=0, zorder=5, **look)


def line(ax: Axes, points: Any, colour: str = INK, **look: Any) -> None:
    ax.plot(*np.transpose(points), color=colour, **({"linewidth": 1.0, "solid_capstyle": "round"} | look))


def circle(centre: Any, radius: float, first: Any = (1.0, 0.0), second: Any = (0.0, 1.0), n: int = 181) -> np.ndarray:
    """Points around a circle spanned by two unit vectors, of the screen or of space."""
    turn = np.linspace(0.0, 2 * np.pi, n)[:, None]
    return np.asarray(centre) + radius * (np.cos(turn) * np.asarray(first) + np.sin(turn) * np.asarray(second))


def arc(
    centre: Any, radius: float, start: float, end: float, first: Any = (1.0, 0.0), second: Any = (0.0, 1.0)
) -> np.ndarray:
    """As :func:`circle`, between two angles in radians."""
    turn = np.linspace(start, end, 61)[:, None]
    return np.asarray(centre) + radius * (np.cos(turn) * np.asarray(first) + np.sin(turn) * np.asarray(second))
