"""The modes of a run with a law of contact: bands behind curves over time, and line styles of a path.

Other runs have no spells, and are drawn without them.
"""

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..physics.contact.history import ContactHistory
from ..physics.contact.modes import Mode
from ..simulation.trajectory import Trajectory
from .palette import DASHED, DOTTED, MODES, on_white
from .record import finite_rows
from .style import SMALL_FONT, legend_above, linestyle

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
