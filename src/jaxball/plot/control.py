"""Figures of feedback: gains, motions that are held or lost, starts that come back, and the estimates of filters."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..control.basins import Basin
from ..control.estimation.estimate import AbstractEstimate, bounds_of_squares, largest_square
from ..control.loop import ClosedLoop
from ..control.track import Track
from ..interface.arguments import require
from ..physics.body import System
from ..physics.state import PlacedState
from ..simulation.variables import STATE, symbol_of
from .over_time import Series, over_time
from .palette import COMPONENTS, DASH_DOTTED, DASHED, FAINT, INK, MASSES, SOLID, mass_look
from .record import columns_by_field
from .style import (
    ABOVE,
    ATTITUDE,
    SQUARE,
    WIDE_FIGURE,
    finish_path,
    label_axes,
    legend_above,
    linestyle,
    mark_ends,
    plane_axes,
    stacked_panels,
)

COLOURS = (*COMPONENTS, *MASSES)
RETURNED = COMPONENTS[0]


def gains(track: Track, name: str | None = None, ax: Axes | None = None) -> Axes:
    name = track.inputs[0] if name is None else name
    if name not in track.inputs:
        raise ValueError(f"Argument `name` must be one of {', '.join(track.inputs)}, but it is {name!r}.")
    K, system = np.asarray(track.gains)[:, track.inputs.index(name)], track.sampled.system
    # Relative to the largest of all: the others are rounding.
    shown = [k for k in range(K.shape[1]) if np.any(np.abs(K[:, k]) > 1e-9 * np.max(np.abs(K)))]
    series = [Series(K[:, k], _symbol(track.directions[k], system), *mass_look(j + 1)) for j, k in enumerate(shown)]
    return over_time(system, np.asarray(track.times), series, f"gain of {name}", ax, most=4)


def held_paths(loops: Mapping[str, ClosedLoop], ax: Axes | None = None) -> Axes:
    """Draws the paths of the centre under feedback, or without, and the path of the motion, dashed; for a disk, its
    place over time.

    **Arguments:**

    - ``loops``: what :meth:`jaxball.control.AbstractFeedback.closed_loop` returns, by the labels of their lines. All
      are of one motion.

    **Raises:** ``TypeError`` for anything but closed loops, ``ValueError`` for none, and when ``ax`` is
    three-dimensional.
    """
    first = _first(loops)
    nominal, system = first.feedback.nominal, first.plant.system
    if system.planar:
        series = [
            Series(np.asarray(loop.states.z), label, COLOURS[k % len(COLOURS)])
            for k, (label, loop) in enumerate(loops.items())
        ]
        # The samples of a loop and of its motion need not be equally many.
        motion = Series(_extend(np.asarray(nominal.states.z), len(first.times)), "motion", INK, DASHED)
        return over_time(system, np.asarray(first.times), [*series, motion], "$z$", ax)
    ax = plane_axes(ax, (WIDE_FIGURE[0], 4.0), system)
    for k, (label, loop) in enumerate(loops.items()):
        colour, path = COLOURS[k % len(COLOURS)], np.asarray(loop.states.z)
        ax.plot(*path.T, color=colour, linewidth=1.2, label=label)
        mark_ends(ax, path, colour, zorder=3)
    ax.plot(*np.asarray(nominal.states.z).T, color=INK, linewidth=1.0, linestyle=linestyle(DASHED), label="motion")
    return finish_path(ax)


def held_inputs(loops: Mapping[str, ClosedLoop], name: str | None = None, ax: Axes | None = None) -> Axes:
    """Draws one input over time in closed loops, in steps, with its limits as lines.

    **Arguments:**

    - ``loops``: as for :func:`held_paths`.
    - ``name``: that of the input; the first if not given.

    **Raises:** ``ValueError`` for an unknown input, and when ``ax`` is three-dimensional; else as :func:`held_paths`.
    """
    ax = plane_axes(ax, shown=_first(loops).plant.system)
    limits: list[float] = []
    for k, (label, loop) in enumerate(loops.items()):
        inputs = loop.plant.inputs
        name = inputs[0] if name is None else name
        if name not in inputs:
            raise ValueError(f"Argument `name` must be one of {', '.join(inputs)}, but it is {name!r}.")
        column = inputs.index(name)
        limits.append(float(loop.plant.limits[column]))
        values = np.asarray(loop.u)[:, column]
        colour = COLOURS[k % len(COLOURS)]
        ax.stairs(values, np.asarray(loop.times), baseline=None, color=colour, linewidth=1.0, label=label)
    for limit in {limit for limit in limits if np.isfinite(limit)}:
        for sign in (1, -1):
            ax.axhline(sign * limit, color="0.6", linewidth=0.6, zorder=0)
    ax.margins(x=0)
    label_axes(ax, "$t$", name or "")
    legend_above(ax)
    return ax


def basin_map(basin: Basin, ax: Axes | None = None) -> Axes:
    returned = basin.dataset()["returned"]
    ax = plane_axes(ax, SQUARE, basin.system)
    first, second = map(str, returned.dims)
    colours = ListedColormap([FAINT, RETURNED])
    values = returned.values.astype(float)
    ax.pcolormesh(returned[second], returned[first], values, cmap=colours, vmin=0.0, vmax=1.0, rasterized=True)
    keys = [Patch(color=RETURNED, label="comes back"), Patch(color=FAINT, label="does not")]
    ax.legend(handles=keys, ncols=2, **ABOVE)
    label_axes(ax, _symbol(second, basin.system), _symbol(first, basin.system))
    return ax


def _first(loops: Mapping[str, ClosedLoop]) -> ClosedLoop:
    """Returns the first of closed loops, all of which it checks."""
    require("loops", loops, Mapping, "a dictionary of closed loops by their labels")
    if not loops:
        raise ValueError("Argument `loops` must have one closed loop or more, but it is empty.")
    for label, loop in loops.items():
        require(f"loops[{label!r}]", loop, ClosedLoop, "what `closed_loop` of a feedback returns")
    return next(iter(loops.values()))


def _symbol(direction: str, system: System) -> str:
    """Returns the symbol of a direction of a state, which counts from 1; θ has the numbers of its mass or joint."""
    name, _, index = direction.removesuffix("]").partition("[")
    letter = ATTITUDE if name == "attitude" else symbol_of(name)
    if not letter:
        return direction
    counted = system.coordinates[int(index)] if name in ("theta", "thetadot") else index
    numbers = ", ".join(str(int(number) + 1) for number in re.findall("[0-9]+", counted))
    return f"${letter}_{{{numbers}}}$" if numbers else f"${letter}$"


def _extend(values: Float[np.ndarray, " n"], count: int) -> Float[np.ndarray, " count"]:
    """Returns the first of the values, and the last of them again where there are too few."""
    return np.append(values, np.full(max(count - len(values), 0), values[-1]))[:count]


ESTIMATE_PANEL_HEIGHT = 1.5  # the height of a panel, inches
BAND_OPACITY = 0.15
LOOKS = [(colour, dashes) for dashes in (SOLID, DASHED, DASH_DOTTED) for colour in COMPONENTS]


def estimate(estimate: AbstractEstimate, truth: PlacedState | None = None, confidence: float = 0.95) -> Figure:
    if not 0 < confidence < 1:
        raise ValueError(f"Argument `confidence` must be between 0 and 1, but it is {confidence}.")
    names = (*estimate.directions, *estimate.biases)
    errors = None if truth is None else np.asarray(estimate.errors(truth))
    groups = columns_by_field(names)
    squares = [(r"$\nu^\top S^{-1}\nu$", np.asarray(estimate.nis), np.asarray(estimate.read))]
    if truth is not None:
        nees = np.asarray(estimate.nees(truth)), np.asarray(estimate.uncertain)
        squares.insert(0, (r"$\xi^\top P^{-1}\xi$", *nees))
    count = len(groups) + len(squares)
    figure, panels = stacked_panels(count, ESTIMATE_PANEL_HEIGHT, 0.0, None)
    width = float(np.sqrt(largest_square(confidence, 1)))
    for ax, (group, places) in zip(panels, groups.items(), strict=False):
        _draw_errors(ax, estimate, group, places, errors, width)
    for ax, square in zip(panels[len(groups) :], squares, strict=True):
        _draw_squares(ax, np.asarray(estimate.times), *square, confidence)
    for ax in panels[:-1]:
        ax.label_outer()
    return figure


def _draw_errors(
    ax: Axes,
    estimate: AbstractEstimate,
    group: str,
    places: Sequence[int],
    errors: Float[np.ndarray, "K directions"] | None,
    width: float,
) -> None:
    times, names = np.asarray(estimate.times), (*estimate.directions, *estimate.biases)
    symbol = ATTITUDE if group == "attitude" else STATE[group].symbol if group in STATE else ""
    symbol = rf"\delta {symbol}" if symbol else rf"\mathrm{{{group.replace('_', ' ')}}}"
    series = []
    for k, place in enumerate(places):
        name, (colour, dashes) = names[place], LOOKS[k % len(LOOKS)]
        values, centre = np.full_like(times, np.nan), 0.0
        if name in estimate.bias:
            values = centre = np.asarray(estimate.bias[name])
        elif errors is not None:
            values = errors[:, place]
        deviation = width * np.asarray(estimate.deviations[name])
        ax.fill_between(times, centre - deviation, centre + deviation, color=colour, alpha=BAND_OPACITY, linewidth=0)
        label = f"${symbol}_{{{k + 1}}}$" if len(places) > 1 else ""
        series.append(Series(values, label, colour, dashes))
    over_time(None, times, series, f"${symbol}$", ax)


def _draw_squares(
    ax: Axes,
    times: Float[np.ndarray, " K"],
    name: str,
    squares: Float[np.ndarray, " K"],
    degrees: Int[np.ndarray, " K"],
    confidence: float,
) -> None:
    """Draws numbers that are distributed as χ² with a number of degrees of freedom, and their bounds."""
    lines = [Series(bound, "", INK, DASHED) for bound in bounds_of_squares(degrees, confidence)]
    lines.insert(0, Series(squares, "", COMPONENTS[0]))
    over_time(None, times, lines, name, ax)
    label_axes(ax, "$t$", name)
