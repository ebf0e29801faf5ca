"""Figures in space: the configuration of the body, and the paths of masses, of the centre of mass and of the centre."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle as Ring
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from .. import programs
from ..interface.arguments import require_count
from ..numerics.arrays import Numbers, to_array
from ..physics.body import System
from ..physics.dynamics.moments import kinematics, moments
from ..simulation.trajectory import Trajectory
from .labels import name_points
from .over_time import PATHS, SWITCH, draw_modes, modes_of, switch_points, track_of
from .palette import FAINT, INK, SHELL, TRAIL, mass_colour
from .record import record, require_one_of_body
from .shapes import arms, looks, on_surface, outline, parallel, rails_of, split, view, wireframe
from .style import (
    SQUARE,
    WIDE_FIGURE,
    cube,
    finish_path,
    label_axes,
    label_of_run,
    legend_above,
    mark_ends,
    mass_line,
    plane_axes,
    sharing,
    space_axes,
    up_to_ticks,
    write,
)

HALO = [withStroke(linewidth=2.2, foreground="white")]
DOT = 8.0  # the diameter of a mass, in points; coinciding masses are drawn smaller than the one beneath
EDGE: dict[str, Any] = {"markeredgecolor": "white", "zorder": 4}
COINCIDENT = 1e-6  # radii
# Three-dimensional Axes clip what is outside their square, and their layout would take these lines' coordinates in
# space for coordinates on the page.
LONG_FIGURE = (5.6, 3.6)
ARROW = 0.35  # inches, of the one that points down a slope
UNCUT: dict[str, Any] = {"clip_on": False, "in_layout": False}


class Positions(NamedTuple):
    """Body vectors from the geometric centre."""

    masses: Float[np.ndarray, "n 3"]
    arms: list[Float[np.ndarray, "n points 3"]]  # of each mechanism
    shell: Float[np.ndarray, "3"]
    system: Float[np.ndarray, "3"]


def configuration(
    source: Trajectory | System,
    ax: Axes | None = None,
    *,
    t: Numbers = 0.0,
    theta: Numbers = (),
) -> Axes:
    """Draws shell, rails and masses m_i, the shell's centre of mass m_0 and the system's, CM, in body axes.

    The ball is drawn in space, ``fig_ball_masses_rail_bf_gc``, the disk in its plane,
    ``fig_disk_masses_rails_bf_gc``. A rail that several masses share has dashes in the colour of each.
    Only the part of a tube inside the shell is drawn, and only the mass for other open rails and free motions.

    **Arguments:**

    - ``source``: a trajectory, drawn at its first saved time, or a system.
    - ``ax``: where to draw, three-dimensional for a ball; by default a new figure.
    - ``t``, ``theta``: for a system, the time and the angles of its driven masses.

    **Raises:** ``ValueError`` when ``ax`` is of the wrong kind, or the length of ``theta`` is wrong.
    """
    if isinstance(source, Trajectory):
        require_one_of_body(source)
        system, t, theta = source.system, np.asarray(source.times)[0], np.asarray(source.state.theta)[0]
    else:
        system = source
    positions = _positions(system, t, theta)
    r = float(system.radius)
    if system.planar:
        ax = plane_axes(ax, SQUARE, source)
        ax.add_patch(Ring((0.0, 0.0), r, facecolor="none", edgecolor=SHELL, linewidth=1.2))
        _draw(ax, system, positions, columns=[0, 2])
        limits, ticks = (-1.08 * r, 1.08 * r), (-r, 0.0, r)
        ax.set(xlim=limits, ylim=limits, xticks=ticks, yticks=ticks, aspect="equal")
        label_axes(ax, r"$\mathbf{E}_1$", r"$\mathbf{E}_3$")
        return ax
    ax = space_axes(ax, shown=source)
    cube(ax, r, "E")
    viewer = view(ax)
    front, back = (on_surface(system, normals) for normals in split(wireframe(), viewer))
    ax.plot(*back.T, color=FAINT, linewidth=0.4, zorder=1)
    ax.plot(*front.T, color="0.7", linewidth=0.4, zorder=1.5)
    ax.plot(*on_surface(system, outline(viewer)).T, color=SHELL, linewidth=0.9, zorder=1.5)
    _draw(ax, system, positions, columns=[0, 1, 2])
    return ax


def _draw(ax: Axes, system: System, positions: Positions, columns: list[int]) -> None:
    def mark(point, marker, size, color, **options):
        ax.plot(*point[columns, None], marker, ms=size, color=color, linestyle="none", **options)

    for sharers, rail in rails_of(system):
        for k, i in enumerate(sharers):
            ax.plot(*rail[:, columns].T, **mass_line(i, linewidth=1.0, zorder=2, **sharing(k, len(sharers))))
    mark(np.zeros(3), "+", 11, INK, mew=0.8, zorder=3, label="GC")
    mark(positions.shell, "s", 6, SHELL, mew=1.2, markerfacecolor="none", zorder=3.5, label="$m_0$")
    shown = looks(system)
    finite = [i for i, point in enumerate(positions.masses) if np.all(np.isfinite(point))]
    rods = [(j, arm) for j, mechanism in enumerate(positions.arms, system.n_masses + 1) for arm in mechanism]
    for (j, arm), (k, n) in zip(rods, _count_coincident([arm for _, arm in rods], system), strict=True):
        ax.plot(*arm[:, columns].T, color=mass_colour(j), linewidth=1.6, zorder=3.8, **sharing(k, n))
    for i, (k, n) in zip(finite, _count_coincident([positions.masses[i] for i in finite], system), strict=True):
        # Smaller and smaller, so that each of the masses in one place is seen around the next.
        mark(positions.masses[i], "o", DOT * (n - k) / n, shown[i].colour, mew=0.8 if k == 0 else 0.0, **EDGE)
    mark(positions.system, "*", 8, INK, mew=0.6, markeredgecolor="white", zorder=5, label="CM")
    # The masses of a mechanism have one name, which is written once.
    first = [i for i in finite if i == 0 or shown[i] != shown[i - 1]]
    names, colours = [shown[i].name for i in first], [shown[i].colour for i in first]
    name_points(ax, positions.masses[first][:, columns], names, colours, DOT / 2, path_effects=HALO, zorder=6)
    legend_above(ax)


def _count_coincident(places: Sequence[Float[np.ndarray, "..."]], system: System) -> list[tuple[int, int]]:
    """Counts the ``places`` before each that coincide with it, and those that coincide in total."""
    least = COINCIDENT * float(system.radius)
    same = [
        [place.shape == other.shape and bool(np.max(np.abs(place - other)) < least) for other in places]
        for place in places
    ]
    return [(sum(row[:i]), sum(row)) for i, row in enumerate(same)]


def _positions(system: System, t: Numbers, theta: Numbers) -> Positions:
    angles = to_array(theta)
    names = system.coordinates
    require_count("Argument `theta`", angles.shape, len(names), f"of the body's coordinates {list(names)}")
    return Positions(*jax.tree.map(np.asarray, _evaluate(system, to_array(t), angles)))


@programs.filter_jit
def _evaluate(system, t, theta):
    prepared, still = system.prepare(), jnp.zeros_like(theta)
    angles = (theta, still, still)
    body_moments = moments(prepared, t, angles)
    return kinematics(prepared, t, angles).chi, arms(prepared, t, theta), system.offset, body_moments.p / body_moments.M


def body_paths(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws trajectories of the masses and of the system's CM in the body frame translated to the GC.

    A ball's are drawn in space, ``fig_ball_cm_bf_gc``, a disk's over time, ``fig_disk_cm_time_bf_gc``, or, if ``ax`` is
    planar, in the plane of E1 and E3. A ring marks the start of a trajectory, a square its end.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or an ``ax`` of the wrong kind.
    """
    times, observables = record(trajectory)
    return _paths(trajectory, times, observables.mass_positions_body, observables.centre_of_mass_body, "E", ax)


def space_paths(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws trajectories of the masses and of the system's CM in the spatial frame translated to the GC.

    As :func:`body_paths`: ``fig_ball_cm_spatial_gc`` and ``fig_disk_cm_time_spatial_gc``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or an ``ax`` of the wrong kind.
    """
    times, observables = record(trajectory)
    return _paths(trajectory, times, observables.mass_positions_space, observables.centre_of_mass_space, "e", ax)


def centre_path(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws the path of the GC and of the contact point below it.

    A ball's is drawn in the plane of e1 and e2, ``fig_ball_gc_path``, with a ring at its start and a square at its end;
    for the disk, z is drawn over time, ``fig_disk_gc``. On a slope an arrow, or for the disk the label, points
    downhill. The path is dashed where the ball slides and dotted where it flies, with crosses at changes of mode.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a reduced trajectory, a batch, or a three-dimensional ``ax``.

    **Example:**

    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> ax = run.plot("centre_path")
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('$t$', '$z$')
    """
    times, observables = record(trajectory)
    z = observables.geometric_centre
    if trajectory.system.planar:
        ax = plane_axes(ax, shown=trajectory)
        ax.plot(times, z[:, 0], color=TRAIL, linewidth=1.2)
        draw_modes(ax, modes_of(trajectory))
        ax.margins(x=0)
        up_to_ticks(ax)
        falls = _downhill(trajectory.system)  # a disk rolls along e1
        way = "" if falls is None else ", downhill" if falls[0] > 0 else ", uphill"
        label_axes(ax, label_of_run(trajectory, "$t$", "time"), label_of_run(trajectory, f"$z${way}", "length"))
        legend_above(ax)
        return ax
    ax = plane_axes(ax, (WIDE_FIGURE[0], 4.2), trajectory)
    _draw_path(ax, trajectory, z)
    mark_ends(ax, z[:, :2], INK, labelled=True)
    finish_path(ax, *(label_of_run(trajectory, f"$z_{k}$", "length") for k in (1, 2)), most=3)
    _draw_downhill(ax, trajectory.system, z[:, :2])
    return ax


def _downhill(system: System) -> Float[np.ndarray, "2"] | None:
    """Returns the unit vector of steepest descent in the plane, space axes; None on a level plane."""
    if system.ground is None:
        return None
    up = np.asarray(system.ground.up())[:2]  # against gravity
    size = float(np.linalg.norm(up))
    return -up / size if size > 0 else None


def _draw_downhill(ax: Axes, system: System, points: Float[np.ndarray, "T 2"]) -> None:
    """Draws an arrow down the slope with its label, in the corner farthest from the path."""
    falls = _downhill(system)
    if falls is None:
        return
    # The limits must be known, because places are compared on the page.
    ax.autoscale_view()
    shares = ax.transAxes.inverted().transform(ax.transData.transform(points))
    corners = [np.array([x, y]) for y in (0.92, 0.14) for x in (0.88, 0.12)]
    place = max(corners, key=lambda corner: float(np.min(np.linalg.norm(shares - corner, axis=1))))
    look: dict[str, Any] = {"angles": "uv", "scale": 1 / ARROW, "scale_units": "inches", "units": "inches"}
    ax.quiver(*place[:, None], *falls[:, None], transform=ax.transAxes, pivot="middle", width=0.012, color=INK, **look)
    write(ax, place - [0.0, 0.05], "downhill", transform=ax.transAxes, ha="center", va="top")


def _draw_path(ax: Axes, trajectory: Trajectory, z: Float[np.ndarray, "T 3"]) -> None:
    """Draws the path from above, with its modes, if any."""
    track, look = track_of(trajectory), {"color": TRAIL, "linewidth": 1.2}
    if track is None:
        ax.plot(z[:, 0], z[:, 1], **look)
        return
    for mode, dashes in PATHS.items():
        _, points = track.pieces(mode)
        if len(points):
            ax.plot(points[:, 0], points[:, 1], **look, **dashes, label=mode.name.lower())
    switches = switch_points(trajectory)
    if len(switches):
        ax.plot(switches[:, 0], switches[:, 1], "x", ms=4.0, mew=0.9, color=INK, linestyle="none", label="switch")


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
    curves, shown = [], looks(system)
    for i, look in enumerate(shown, start=1):
        label = {} if look in shown[: i - 1] else {"label": look.name}
        # Masses on one rail have one path in the body, but not in space.
        shared = dashes.get(i, {}) if frame == "E" else {}
        curves.append((masses[:, i - 1], mass_line(look.number, **label, **shared)))
    curves.append((centre, {"color": INK, "linestyle": "-", "linewidth": 1.6, "label": "CM"}))
    over_time = False
    if not system.planar:
        ax, columns = space_axes(ax, shown=trajectory), [0, 1, 2]
        cube(ax, r, frame)
        # A body that is no sphere has no outline in space, where it turns.
        for normals, width in ((outline(view(ax)), 0.8), (parallel(0.0), 0.4)):
            around = on_surface(system, normals) if frame == "E" else r * normals
            ax.plot(*around.T, color=SHELL, linewidth=width, zorder=1)
    elif ax is None or isinstance(ax, Axes3D):
        span = float(trajectory.times[0]), float(trajectory.times[-1])
        ax, columns, over_time = _cylinder(space_axes(ax, LONG_FIGURE, trajectory), r, frame, span), [0, 2], True
        for t in modes_of(trajectory).changes:
            _ring(ax, t, r, **SWITCH)
    else:
        ax, columns = plane_axes(ax), [0, 2]
        ax.plot(*(r * parallel(0.0))[:, :2].T, color=SHELL, linewidth=0.8, zorder=1)
        ax.set_aspect("equal")
        label_axes(ax, rf"$\mathbf{{{frame}}}_1$", rf"$\mathbf{{{frame}}}_3$")
    points = np.zeros((0, len(columns) + over_time))
    for path, line in curves:
        points = np.column_stack([times, path[:, columns]]) if over_time else path[:, columns]
        ax.plot(*points.T, **line, zorder=3, **UNCUT)
        mark_ends(ax, points, line["color"], zorder=4, **UNCUT)
    # A point that is not there, for the entries of the legend.
    mark_ends(ax, np.full_like(points[:1], np.nan), INK, labelled=True)
    legend_above(ax)
    return ax


def _cylinder(ax: Axes3D, r: float, frame: str, span: tuple[float, float]) -> Axes3D:
    limits, ticks = (-1.04 * r, 1.04 * r), (-r, 0.0, r)
    ax.set(xlim=span, ylim=limits, zlim=limits, yticks=ticks, zticks=ticks)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    ax.set_box_aspect((2.2, 1.0, 1.0), zoom=1.38)  # pyright: ignore[reportArgumentType]
    ax.view_init(elev=22, azim=-66)
    for t in span:
        _ring(ax, t, r, color=SHELL, linewidth=0.8)
    label_axes(ax, "$t$", rf"$\mathbf{{{frame}}}_1$", rf"$\mathbf{{{frame}}}_3$")
    ax.xaxis.labelpad = 2
    return ax


def _ring(ax: Axes3D, t: float, r: float, **look: Any) -> None:
    circle = r * parallel(0.0)
    ax.plot(np.full(len(circle), t), circle[:, 0], circle[:, 1], zorder=1, **look, **UNCUT)
