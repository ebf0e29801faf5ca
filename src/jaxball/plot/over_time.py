"""Several quantities over time in one panel: all lines are visible, and zero is drawn without rounding errors."""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..physics.system import AbstractSystem
from ..simulation.trajectory import Trajectory
from .modes import NO_MODES, Modes, draw_modes, modes_of, with_breaks
from .palette import COMPONENTS, INK, SOLID, Dashes
from .record import finite_rows
from .style import label_axes, label_with, legend_above, linestyle, plane_axes, sharing, up_to_ticks, zero_line

ROUNDING_DRAWN = 1e-12  # of the typical size of a quantity in the system; below this it is drawn as zero
NEAR_LINES = 1.2  # points on paper between lines that hide each other
MOSTLY = 0.8  # the fraction of the time in which they do


class Series(NamedTuple):
    """The values over time that one line shows, and its style."""

    values: Float[np.ndarray, " T"]
    label: str
    colour: str
    dashes: Dashes = SOLID


class Sizes(NamedTuple):
    """The scales of a system: a characteristic length, energy, force and time."""

    length: float
    time: float
    force: float

    @property
    def energy(self) -> float:
        return self.force * self.length

    @property
    def speed(self) -> float:
        return self.length / self.time

    @property
    def power(self) -> float:
        return self.energy / self.time


def sizes_of(system: Any) -> Sizes:
    """Returns the scales of a ball or a disk: its radius, its weight and √(r/g); without gravity, the time is 1."""
    radius, gravity = abs(float(system.radius)), abs(float(system.gravity))
    time = (radius / gravity) ** 0.5 if gravity > 0 else 1.0
    return Sizes(radius, time, abs(float(system.total_mass)) * radius / time**2)


def without_rounding(values: Float[np.ndarray, "..."], size: float) -> Float[np.ndarray, "..."]:
    """Returns the values, with 0 in place of those that are no larger than the rounding of numbers of this ``size``."""
    return np.where(np.abs(values) <= ROUNDING_DRAWN * size, 0.0, values)


def over_time(
    source: AbstractSystem | Trajectory[Any, Any] | None,
    times: Float[np.ndarray, " T"],
    series: Sequence[Series],
    name: str,
    ax: Axes | None,
    most: int = 5,
    modes: Modes = NO_MODES,
    size: float = 0.0,
) -> Axes:
    """Draws several series of a system or a run over time; ``name`` labels the vertical axis, ``most``
    legend entries are in a row.

    ``modes`` are those of a run with a law of contact, which are drawn behind. Values that are rounding compared with
    ``size`` or with the largest value are drawn as zero.
    """
    ax = plane_axes(ax, shown=source)
    values = [curve.values[np.isfinite(curve.values)] for curve in series]
    drawn = np.concatenate([np.zeros(0), *values])
    largest = max(size, float(np.max(np.abs(drawn), initial=0.0)))
    for shown, label, colour, dashes in series:
        look = {"color": colour, "linestyle": linestyle(dashes), "linewidth": 1.2}
        ax.plot(times, without_rounding(shown, largest), **look, label=label or None)
    drawn = without_rounding(drawn, largest)
    if drawn.size and drawn.min() < 0 < drawn.max():
        zero_line(ax)
    draw_modes(ax, modes)
    ax.margins(x=0)
    up_to_ticks(ax)
    label_axes(ax, "$t$", name)
    tell_apart(ax)
    legend_above(ax, most)
    return ax


def over_run(
    run: Trajectory[Any, Any],
    series: Sequence[Series],
    name: str,
    ax: Axes | None,
    *,
    size: float = 0.0,
    most: int = 5,
    jumps: bool = False,
    dimension: str = "",
) -> Axes:
    """Draws several series over the times of a run that are drawn, as :func:`over_time`.

    With ``jumps`` they jump where the mode changes, and have gaps there. Labels have units if the scenario of the run
    states them; ``dimension`` is that of the series, in words such as ``"length/time"``.
    """
    times, modes = np.asarray(run.times)[finite_rows(run)], modes_of(run)
    if jumps:
        times, *broken = with_breaks(modes, times, *(curve.values for curve in series))
        series = [curve._replace(values=values) for curve, values in zip(series, broken, strict=True)]
    ax = over_time(run, times, series, name, ax, most, modes, size)
    if run.scenario is not None and run.scenario.units is not None:
        units = run.scenario.units
        label_axes(ax, label_with("$t$", units.of("time")), label_with(name, units.of(dimension)))
    return ax


def components(vectors: Float[np.ndarray, "T 3"], symbol: str) -> list[Series]:
    """Returns the components of a vector over time as series."""
    return [Series(vectors[:, j], f"${symbol}_{j + 1}$", COMPONENTS[j]) for j in range(3)]


def tell_apart(ax: Axes) -> None:
    """Gives lines that coincide on paper interleaved dashes, so that each of them is visible.

    A single black, dashed line on a solid one is visible already; gaps in the lines of masses are too narrow for that.
    Lines with other times are left alone.
    """
    curves = [line for line in ax.lines if len(np.atleast_1d(line.get_xdata())) > 2]
    if len(curves) < 2:
        return
    for group in together(_near(ax, curves)):
        dashed = [curves[k].is_dashed() for k in group]
        above = curves[group[dashed.index(True)]] if len(group) == 2 and sum(dashed) == 1 else None
        if above is not None and above.get_color() == INK:
            # Above the solid one; ties are drawn in the order in which they were made.
            above.set_zorder(2.1)
            continue
        for k, j in enumerate(group):
            look = sharing(k, len(group))
            curves[j].set(**look, zorder=2.0 + 0.01 * k)


def _near(ax: Axes, curves: Sequence[Line2D]) -> Bool[np.ndarray, "lines lines"]:
    """Returns which lines hide each other."""
    points = [line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float)) for line in curves]
    # On paper, so that it holds for any scale of the axes.
    close = NEAR_LINES * ax.figure.dpi / 72
    near = np.eye(len(curves), dtype=bool)
    # Only where they have the same times, between which nothing needs to be interpolated.
    for (i, a), (j, b) in itertools.combinations(enumerate(points), 2):
        if len(a) == len(b) and np.array_equal(a[:, 0], b[:, 0], equal_nan=True):
            apart = np.abs(a[:, 1] - b[:, 1])
            is_finite = np.isfinite(apart)
            near[i, j] = near[j, i] = bool(is_finite.any() and np.mean(apart[is_finite] < close) >= MOSTLY)
    return near


def together(near: Bool[np.ndarray, "lines lines"]) -> list[list[int]]:
    """Groups of two lines or more of which each is near to the first."""
    left, groups = list(range(len(near))), []
    while left:
        group = [j for j in left if near[left[0], j]]
        left = [j for j in left if j not in group]
        if len(group) > 1:
            groups.append(group)
    return groups
