"""Figures of paths: those of the masses, the centre of mass and the geometric centre."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from ..physics.body import Disk, System
from ..simulation.trajectory import Trajectory
from .mechanisms import looks
from .modes import PATHS, SWITCH, draw_modes, modes_of, switch_points, track_of
from .palette import INK, SHELL, TRAIL
from .record import record
from .shapes import outline, parallel, rails_of, view
from .style import WIDE, cube, ends, legend_above, mass_line, named, plane_axes, sharing, space_axes, up_to_ticks, write

# Three-dimensional Axes clip what is outside their square, and their layout would take these lines' coordinates in
# space for coordinates on the page.
LONG = (5.6, 3.6)
ARROW = 0.35  # inches, of the one that points down a slope
UNCUT: dict[str, Any] = {"clip_on": False, "in_layout": False}


def body_paths(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Trajectories of the masses and of the system's CM in the body frame translated to the GC.

    A ball's are drawn in space, ``fig_ball_cm_bf_gc``, a disk's over time, ``fig_disk_cm_time_bf_gc``, or, if ``ax`` is
    planar, in the plane of E1 and E3. A ring marks the start of a trajectory, a square its end.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or an ``ax`` of the wrong kind.
    """
    times, _, observables = record(trajectory)
    return _paths(trajectory, times, observables.mass_positions_body, observables.centre_of_mass_body, "E", ax)


def space_paths(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Trajectories of the masses and of the system's CM in the spatial frame translated to the GC.

    As :func:`body_paths`: ``fig_ball_cm_spatial_gc`` and ``fig_disk_cm_time_spatial_gc``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or an ``ax`` of the wrong kind.
    """
    times, _, observables = record(trajectory)
    return _paths(trajectory, times, observables.mass_positions_space, observables.centre_of_mass_space, "e", ax)


def centre_path(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """The path of the GC and of the contact point below it.

    A ball's is drawn in the plane of e1 and e2, ``fig_ball_gc_path``, with a ring at its start and a square at its end;
    for the disk, z is drawn over time, ``fig_disk_gc``. On a slope an arrow, or for the disk the label, points
    downhill. The path is dashed where the ball slides and dotted where it flies, with crosses at changes of mode.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> ax = plot.centre_path(run)
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('$t$', '$z$')
    """
    times, _, observables = record(trajectory)
    z = observables.geometric_centre
    if isinstance(trajectory.system, Disk):
        ax = plane_axes(ax, system=trajectory.system)
        ax.plot(times, z[:, 0], color=TRAIL, linewidth=1.2)
        draw_modes(ax, modes_of(trajectory))
        ax.margins(x=0)
        up_to_ticks(ax)
        named(ax, "$t$", "$z$" + _downhill_words(trajectory.system))
        legend_above(ax)
        return ax
    ax = plane_axes(ax, (WIDE[0], 4.2), trajectory.system)
    _draw_path(ax, trajectory, z)
    ends(ax, z[:, :2], INK, labelled=True)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    _draw_downhill(ax, trajectory.system, z[:, :2])
    named(ax, "$z_1$", "$z_2$")
    legend_above(ax, 3)
    return ax


def _downhill_words(system: System) -> str:
    """The downhill direction for a disk, which rolls along e1; empty on a level plane."""
    falls = _downhill(system)
    return "" if falls is None else " (downhill)" if falls[0] > 0 else " (uphill)"


def _downhill(system: System) -> Float[np.ndarray, "2"] | None:
    """The unit vector of steepest descent in the plane, space axes; None on a level plane."""
    if system.ground is None:
        return None
    up = np.asarray(system.ground.up())[:2]  # against gravity
    size = float(np.linalg.norm(up))
    return -up / size if size > 0 else None


def _draw_downhill(ax: Axes, system: System, points: Float[np.ndarray, "T 2"]) -> None:
    """An arrow down the slope with its label, in the corner farthest from the path."""
    falls = _downhill(system)
    if falls is None:
        return
    ax.autoscale_view()
    shares = ax.transAxes.inverted().transform(ax.transData.transform(points))
    corners = [np.array([x, y]) for y in (0.92, 0.14) for x in (0.88, 0.12)]
    at = max(corners, key=lambda corner: float(np.min(np.linalg.norm(shares - corner, axis=1))))
    look: dict[str, Any] = {"angles": "uv", "scale": 1 / ARROW, "scale_units": "inches", "units": "inches"}
    ax.quiver(*at[:, None], *falls[:, None], transform=ax.transAxes, pivot="middle", width=0.012, color=INK, **look)
    write(ax, at - [0.0, 0.05], "downhill", transform=ax.transAxes, ha="center", va="top")


def _draw_path(ax: Axes, trajectory: Trajectory, z: Float[np.ndarray, "T 3"]) -> None:
    """The path from above, with its modes, if any."""
    track, look = track_of(trajectory), {"color": TRAIL, "linewidth": 1.2}
    if track is None:
        ax.plot(z[:, 0], z[:, 1], **look)
        return
    for mode, dashes in PATHS.items():
        _, points = track.pieces(mode)
        if len(points):
            ax.plot(points[:, 0], points[:, 1], **look, **dashes, label=mode.name.lower())
    at = switch_points(trajectory)
    if len(at):
        ax.plot(at[:, 0], at[:, 1], "x", ms=4.0, mew=0.9, color=INK, linestyle="none", label="switch")


def _paths(
    trajectory: Trajectory,
    times: Float[np.ndarray, " T"],
    masses: Float[np.ndarray, "T n 3"],
    centre: Float[np.ndarray, "T 3"],
    frame: str,
    ax: Axes | None,
) -> Axes:
    system = trajectory.system
    r = float(system.radius)
    dashes = {i: sharing(k, len(sharers)) for sharers, _ in rails_of(system) for k, i in enumerate(sharers)}
    curves, named_already = [], set()
    for i, look in enumerate(looks(system), start=1):
        label = {} if look.name in named_already else {"label": look.name}
        named_already.add(look.name)
        curves.append(
            (masses[:, i - 1], mass_line(look.number, **label, **(dashes.get(i, {}) if frame == "E" else {})))
        )
    curves.append((centre, {"color": INK, "linestyle": "-", "linewidth": 1.6, "label": "CM"}))
    over_time = False
    if not isinstance(system, Disk):
        ax, columns = _sphere(space_axes(ax, system=system), r, frame), [0, 1, 2]
    elif ax is None or isinstance(ax, Axes3D):
        span = float(trajectory.times[0]), float(trajectory.times[-1])
        ax, columns, over_time = _cylinder(space_axes(ax, LONG, system), r, frame, span), [0, 2], True
        modes = modes_of(trajectory)
        for t in () if modes is None else modes.changes:
            _ring(ax, t, r, **SWITCH)
    else:
        ax, columns = _circle(plane_axes(ax), r, frame), [0, 2]
    points = np.zeros((0, len(columns) + over_time))
    for path, line in curves:
        points = np.column_stack([times, path[:, columns]]) if over_time else path[:, columns]
        ax.plot(*points.T, **line, zorder=3, **UNCUT)
        ends(ax, points, line["color"], zorder=4, **UNCUT)
    ends(ax, np.full_like(points[:1], np.nan), INK, labelled=True)
    legend_above(ax)
    return ax


def _sphere(ax: Axes3D, r: float, frame: str) -> Axes3D:
    cube(ax, r, frame)
    ax.plot(*outline(r, view(ax)).T, color=SHELL, linewidth=0.8, zorder=1)
    ax.plot(*(r * parallel(0.0)).T, color=SHELL, linewidth=0.4, zorder=1)
    return ax


def _cylinder(ax: Axes3D, r: float, frame: str, span: tuple[float, float]) -> Axes3D:
    limits, ticks = (-1.04 * r, 1.04 * r), (-r, 0.0, r)
    ax.set(xlim=span, ylim=limits, zlim=limits, yticks=ticks, zticks=ticks)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    ax.set_box_aspect((2.2, 1.0, 1.0), zoom=1.38)  # pyright: ignore[reportArgumentType]
    ax.view_init(elev=22, azim=-66)
    for t in span:
        _ring(ax, t, r, color=SHELL, linewidth=0.8)
    named(ax, "$t$", rf"$\mathbf{{{frame}}}_1$", rf"$\mathbf{{{frame}}}_3$")
    ax.xaxis.labelpad = 2
    return ax


def _ring(ax: Axes3D, t: float, r: float, **look: Any) -> None:
    circle = r * parallel(0.0)
    ax.plot(np.full(len(circle), t), circle[:, 0], circle[:, 1], zorder=1, **look, **UNCUT)


def _circle(ax: Axes, r: float, frame: str) -> Axes:
    circle = r * parallel(0.0)
    ax.plot(circle[:, 0], circle[:, 1], color=SHELL, linewidth=0.8, zorder=1)
    ax.set_aspect("equal")
    named(ax, rf"$\mathbf{{{frame}}}_1$", rf"$\mathbf{{{frame}}}_3$")
    return ax
