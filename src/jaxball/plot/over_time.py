"""Several quantities over time in one panel: all lines are visible, and zero is drawn without rounding errors.

The modes of a run with a law of contact are bands behind the curves, and line styles of a path. Other runs have no
spells, and are drawn without them.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..physics.contact.history import ContactHistory
from ..physics.contact.modes import Mode
from ..physics.system import AbstractSystem
from ..simulation.trajectory import Trajectory
from .palette import COMPONENTS, DASHED, DOTTED, INK, MODES, SOLID, Dashes, on_white
from .record import finite_rows
from .style import (
    SMALL_FONT,
    label_axes,
    label_of_run,
    legend_above,
    linestyle,
    plane_axes,
    sharing,
    up_to_ticks,
    zero_line,
)

BANDS = {mode: on_white(colour) for mode, colour in MODES.items()}
PATHS: dict[Mode, dict[str, Any]] = {  # a body at rest has none
    Mode.ROLLING: {"linestyle": "-"},
    Mode.SLIDING: {"linestyle": linestyle(DASHED)},
    Mode.FLIGHT: {"linestyle": linestyle(DOTTED)},
}
NAMES = [mode.name.lower() for mode in BANDS]
SWITCH: dict[str, Any] = {"color": "0.6", "linewidth": 0.5}
BREAK = np.full((1, 3), np.nan)
IN_A_ROW = 3  # entries of the legends above Axes with bands


class Spell(NamedTuple):
    """An interval in which a mode lasts; flight includes impacts from flight to flight."""

    mode: Mode
    start: float
    end: float


class Modes(NamedTuple):
    """The spells of a run one after the other, and the times of the kept switches."""

    spells: tuple[Spell, ...]
    switches: Float[np.ndarray, " switches"]

    @property
    def changes(self) -> Float[np.ndarray, " changes"]:
        """When one mode became another."""
        return np.array([spell.start for spell in self.spells[1:]])

    def at(self, times: Float[np.ndarray, " T"]) -> list[Mode]:
        """Returns the mode at each time; at a switch, the one that begins."""
        return [self.spells[k].mode for k in np.searchsorted(self.changes, times, side="right")]


def modes_of(trajectory: Trajectory[Any, Any]) -> Modes:
    """Returns the modes of a run at the times that are drawn; no spells without a law of contact."""
    history, rows = trajectory.history.of_body, finite_rows(trajectory)
    if not (isinstance(history, ContactHistory) and rows.size):
        return NO_MODES
    times = np.asarray(trajectory.times)[rows]
    saved, switches = np.asarray(history.mode)[rows], history.switches
    count = min(int(switches.count), history.law.capacity)
    when = np.asarray(switches.times)[:count]
    # Where nothing switched, the mode of the first time lasts.
    first = np.asarray(switches.source)[0] if count else saved[0]
    begins = [(times[0], first), *zip(when, np.asarray(switches.target)[:count], strict=True)]
    if int(switches.count) > count:  # later modes are known only at the saved times
        begins += [(t, mode) for t, mode in zip(times, saved, strict=True) if t > when[-1]]
    return Modes(tuple(_spells(begins, float(times[-1]))), when[when <= times[-1]])


NO_MODES = Modes((), np.zeros(0))


def _spells(begins: list[tuple[Any, Any]], end: float) -> Iterator[Spell]:
    """Spells from the times at which modes begin."""
    starts = [float(t) for t, _ in begins]
    # A spell without duration, such as an impact, is not drawn; at least one remains.
    lasting = [
        (Mode(int(mode)), start)
        for (_, mode), start, until in zip(begins, starts, [*starts[1:], end], strict=True)
        if start < min(until, end)
    ] or [(Mode(int(begins[-1][1])), starts[0])]
    # An impact from flight to flight splits flight in two spells that are one for a reader.
    merged = [next(group) for _, group in itertools.groupby(lasting, lambda spell: spell[0])]
    for (mode, start), until in zip(merged, [*(start for _, start in merged[1:]), end], strict=True):
        yield Spell(mode, start, until)


def draw_modes(ax: Axes, modes: Modes) -> None:
    """Draws bands where the body slides or flies, and a thin line at each switch, behind what is drawn over time."""
    named = set()
    for mode, start, end in modes.spells:
        if mode in BANDS:
            label = None if mode in named else mode.name.lower()
            ax.axvspan(start, end, facecolor=BANDS[mode], linewidth=0.0, zorder=-2, label=label)
            named.add(mode)
    for t in modes.switches:
        ax.axvline(t, **SWITCH, zorder=-1)


def share_bands(figure: Figure) -> None:
    """Names the bands of a figure once, below all its Axes."""
    bands: dict[str, Any] = dict.fromkeys(NAMES)
    for ax in figure.axes:
        of_ax = {str(patch.get_label()): patch for patch in ax.patches if patch.get_label() in NAMES}
        for patch in of_ax.values():
            patch.set_label("_nolegend_")
        old = ax.get_legend()
        if of_ax and old is not None:
            old.remove()
            legend_above(ax, IN_A_ROW)
        bands |= of_ax
    if drawn := {name: patch for name, patch in bands.items() if patch is not None}:
        look: dict[str, Any] = {
            "loc": "outside lower center",
            "ncols": len(drawn),
            "frameon": False,
            "prop": SMALL_FONT,
        }
        figure.legend(list(drawn.values()), list(drawn), **look)


def with_breaks(
    modes: Modes, times: Float[np.ndarray, " T"], *series: Float[np.ndarray, " T"]
) -> tuple[Float[np.ndarray, " T2"], ...]:
    """Returns times and values of a quantity that jumps between modes, with gaps, which no line crosses.

    Where a switch has two times, before and after it, the gap is between them.
    """
    places = np.searchsorted(times, modes.changes)
    places += np.searchsorted(times, modes.changes, side="right") > places + 1
    broken = (np.insert(values, places, np.nan) for values in series)
    return np.insert(times, places, modes.changes), *broken


class Track(NamedTuple):
    """The path of the body's lowest point, space axes, through the saved times and the switches between them.

    ``modes`` are those of its segments.
    """

    times: Float[np.ndarray, " V"]
    points: Float[np.ndarray, "V 3"]
    modes: list[Mode]

    def pieces(self, mode: Mode) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, "P 3"]]:
        """Returns the part of the path in a mode, as one curve with breaks, and the times of its points."""
        times, points, k = [np.zeros(0)], [np.zeros((0, 3))], 0
        for other, group in itertools.groupby(self.modes):
            # A piece includes the point at which the next one begins, so that the path has no holes.
            end = k + len(list(group))
            if other == mode:
                times += [self.times[k : end + 1], self.times[end : end + 1]]
                points += [self.points[k : end + 1], BREAK]
            k = end
        return np.concatenate(times), np.concatenate(points)


def track_of(trajectory: Trajectory[Any, Any]) -> Track | None:
    """Returns the track of a run; None without a law of contact."""
    modes, history = modes_of(trajectory), trajectory.history.of_body
    if not (isinstance(history, ContactHistory) and modes.spells):
        return None
    rows, r, count = finite_rows(trajectory), float(trajectory.system.radius), len(modes.switches)
    saved = _lowest(np.asarray(trajectory.state.z)[rows], np.asarray(history.height)[rows], r)
    after = history.switches.after
    switched = _lowest(np.asarray(after.body.z)[:count], np.asarray(after.height)[:count], r)
    times = np.concatenate([np.asarray(trajectory.times)[rows], modes.switches])
    # A switch at a saved time is one point.
    times, first = np.unique(times, return_index=True)
    # The mode of a segment is that of its middle, which is at no switch.
    return Track(times, np.concatenate([saved, switched])[first], modes.at((times[1:] + times[:-1]) / 2))


def switch_points(trajectory: Trajectory[Any, Any]) -> Float[np.ndarray, "switches 3"]:
    """Returns where the body's lowest point is at the switches, space axes."""
    track, switches = track_of(trajectory), modes_of(trajectory).switches
    return np.zeros((0, 3)) if track is None else track.points[np.searchsorted(track.times, switches)]


def _lowest(
    z: Float[np.ndarray, "n *direction"], height: Float[np.ndarray, " n"], r: float
) -> Float[np.ndarray, "n 3"]:
    along = z if z.ndim == 2 else np.stack([z, 0 * z], axis=1)  # a disk rolls along e1
    return np.column_stack([along, height - r])


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
    label_axes(ax, label_of_run(run, "$t$", "time"), label_of_run(run, name, dimension))
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
