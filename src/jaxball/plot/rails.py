"""The figure of the configuration in the body: shell, rails, masses and centres of mass."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle as Ring
from matplotlib.patheffects import withStroke

from ..interface.wording import counted
from ..numerics import programs
from ..numerics.arrays import Numbers, to_array
from ..physics.body import Disk, System
from ..physics.moments import kinematics, moments
from ..simulation.trajectory import Trajectory
from .labels import name_points
from .mechanisms import arms, looks
from .palette import FAINT, INK, SHELL, mass_colour
from .record import require_one
from .shapes import outline, rails_of, split, view, wireframe
from .style import SQUARE, cube, legend_above, mass_line, named, plane_axes, sharing, space_axes

HALO = [withStroke(linewidth=2.2, foreground="white")]
DOT = 8.0  # the diameter of a mass, in points; coinciding masses are drawn smaller than the one beneath
EDGE: dict[str, Any] = {"markeredgecolor": "white", "zorder": 4}
COINCIDENT = 1e-6  # radii


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
    """Shell, rails and masses m_i, the shell's centre of mass m_0 and the system's, CM, in body axes.

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
        require_one(source)
        system, t, theta = source.system, np.asarray(source.times)[0], np.asarray(source.state.theta)[0]
    else:
        system = source
    positions = _positions(system, t, theta)
    r = float(system.radius)
    if isinstance(system, Disk):
        return _in_plane(system, positions, r, plane_axes(ax, SQUARE, system))
    ax = space_axes(ax, system=system)
    cube(ax, r, "E")
    viewer = view(ax)
    front, back = split(wireframe(r), viewer)
    ax.plot(*back.T, color=FAINT, linewidth=0.4, zorder=1)
    ax.plot(*front.T, color="0.7", linewidth=0.4, zorder=1.5)
    ax.plot(*outline(r, viewer).T, color=SHELL, linewidth=0.9, zorder=1.5)
    _draw(ax, system, positions, columns=[0, 1, 2])
    return ax


def _in_plane(disk: Disk, positions: Positions, r: float, ax: Axes) -> Axes:
    ax.add_patch(Ring((0.0, 0.0), r, facecolor="none", edgecolor=SHELL, linewidth=1.2))
    _draw(ax, disk, positions, columns=[0, 2])
    limits, ticks = (-1.08 * r, 1.08 * r), (-r, 0.0, r)
    ax.set(xlim=limits, ylim=limits, xticks=ticks, yticks=ticks, aspect="equal")
    named(ax, r"$\mathbf{E}_1$", r"$\mathbf{E}_3$")
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
    for (j, arm), (k, n) in zip(rods, _shared([arm for _, arm in rods], system), strict=True):
        ax.plot(*arm[:, columns].T, color=mass_colour(j), linewidth=1.6, zorder=3.8, **sharing(k, n))
    for i, (k, n) in zip(finite, _shared([positions.masses[i] for i in finite], system), strict=True):
        mark(positions.masses[i], "o", DOT * (n - k) / n, shown[i].colour, mew=0.8 if k == 0 else 0.0, **EDGE)
    mark(positions.system, "*", 8, INK, mew=0.6, markeredgecolor="white", zorder=5, label="CM")
    first = [i for i in finite if i == 0 or shown[i] != shown[i - 1]]
    names, colours = [shown[i].name for i in first], [shown[i].colour for i in first]
    name_points(ax, positions.masses[first][:, columns], names, colours, DOT / 2, path_effects=HALO, zorder=6)
    legend_above(ax)


def _shared(places: Sequence[Float[np.ndarray, "..."]], system: System) -> list[tuple[int, int]]:
    """How many of the ``places`` before each coincide with it, and how many coincide in total."""
    least = COINCIDENT * float(system.radius)
    same = [
        [place.shape == other.shape and bool(np.max(np.abs(place - other)) < least) for other in places]
        for place in places
    ]
    return [(sum(row[:i]), sum(row)) for i, row in enumerate(same)]


def _positions(system: System, t: Numbers, theta: Numbers) -> Positions:
    angles = to_array(theta)
    names = system.coordinates
    if angles.shape != (len(names),):
        raise ValueError(
            f"Argument `theta` must have {counted(len(names), 'entry', 'entries')}, as many as the body's coordinates "
            f"{list(names)}, but its shape is {angles.shape}."
        )
    masses, shell, whole = map(np.asarray, _evaluate(system, to_array(t), angles))
    moved = arms(system, np.atleast_1d(np.asarray(t)), np.asarray(angles)[None]) if system.mechanisms else []
    return Positions(masses, [arm[0] for arm in moved], shell, whole)


@programs.filter_jit
def _evaluate(system, t, theta):
    prepared, still = system.prepare(), jnp.zeros_like(theta)
    angles = (theta, still, still)
    at = moments(prepared, t, angles)
    return kinematics(prepared, t, angles).chi, system.offset, at.p / at.M
