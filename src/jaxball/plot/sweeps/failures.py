"""The style of failed rows: each status has its own colour, mark and hatching."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...interface.status import Status

MANY = 1000
KEY = 5.0
ROW_OF_MARKS = 0.045  # its height, of that of the axes
NOT_FINITE = -2  # a row that succeeded, but whose result is not finite


class Look(NamedTuple):
    """The colour, the mark and the hatching of a status."""

    colour: str
    marker: str
    hatch: str


# Distinguishable from one another and from the colours of viridis, also in grey and for colour-blind readers.
LOOKS = {
    NOT_FINITE: Look("#882255", "1", "..."),
    Status.MAX_STEPS: Look("#BB5566", "x", "////"),
    Status.NOT_FINITE: Look("black", "+", "xxxx"),
    Status.IMPOSSIBLE: Look("0.55", "s", "\\\\\\\\"),
    Status.SOLVER_FAILED: Look("#D55E00", "2", "----"),
    Status.LEFT_SHELL: Look("#CC79A7", "v", "||||"),
    Status.DETACHED: Look("#332288", "^", "++++"),
    Status.SLIPPED: Look("#999933", "p", "oo"),
    Status.EVENT: Look("0.3", "d", "**"),
    Status.JAMMED: Look("#009E73", "P", "xx"),
    Status.CHATTERED: Look("#0072B2", "*", "\\\\||"),
}
_NAMES = {NOT_FINITE: "not finite"}


def outcomes(status: Int[np.ndarray, " rows"], values: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """The status of each row, or ``NOT_FINITE`` where a row that succeeded has a value that is not finite."""
    return np.where((status == Status.SUCCESS) & ~np.isfinite(values), NOT_FINITE, status)


def present(outcome: Int[np.ndarray, " rows"]) -> list[int]:
    """The codes of the failures among the outcomes."""
    return [code for code in np.unique(outcome).tolist() if code != Status.SUCCESS]


def names_of(outcome: Int[np.ndarray, " rows"]) -> dict[int, str]:
    """The legend entry of each failure among the outcomes: its name, and how many rows have it."""
    return {code: f"{_NAMES.get(code) or Status(code).name} ({np.sum(outcome == code):,})" for code in present(outcome)}


def marks(
    ax: Axes,
    right: Float[np.ndarray, " rows"],
    up: Float[np.ndarray, " rows"] | None,
    outcome: Int[np.ndarray, " rows"],
    names: Mapping[int, str],
    size: float = KEY,
) -> list[Line2D]:
    """Draws a mark for each row that failed, and returns a legend key for each of the failures in ``names``.

    Without ``up``, each failure has a row of marks above the lower edge.
    """
    keys, size = [], size if len(outcome) <= MANY else min(size, 2.0)
    for k, (code, name) in enumerate(names.items()):
        look, here = LOOKS[code], outcome == code
        on_the_edge: dict[str, Any] = {"transform": ax.get_xaxis_transform()} if up is None else {}
        mark: dict[str, Any] = {"marker": look.marker, "color": look.colour, "markerfacecolor": "none"}
        ax.plot(
            right[here],
            np.full(np.sum(here), (k + 0.6) * ROW_OF_MARKS) if up is None else up[here],
            **mark,
            markersize=size,
            markeredgewidth=0.2 * size,
            linestyle="none",
            label=name,
            zorder=4,
            rasterized=True,
            **on_the_edge,
        )
        keys.append(Line2D([], [], **mark, markersize=KEY, linestyle="none", label=name))
    return keys


def make_room(ax: Axes, names: Mapping[int, str]) -> None:
    """Extends the axes downwards, so that rows of marks fit there."""
    share = ROW_OF_MARKS * len(names)
    low, high = ax.get_ylim()
    if share and ax.get_yscale() == "linear":
        ax.set_ylim(low - share / (1 - share) * (high - low), high)


def patch(code: int, name: str) -> Patch:
    """The legend key of a failure shown by cells."""
    look = LOOKS[code]
    return Patch(facecolor=look.colour, edgecolor="white", hatch=look.hatch, linewidth=0.0, label=name)
