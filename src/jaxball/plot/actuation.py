"""The figure of the masses' accelerations along their rails."""

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..numerics import programs
from ..numerics.arrays import Numbers, to_array
from ..numerics.kinks import seen_from_before
from ..physics.body import System
from ..physics.dynamics import given_angles
from ..physics.motion import OnRail
from ..simulation.trajectory import Trajectory, times_looked_at
from .modes import draw_modes, modes_of
from .over_time import tell_apart
from .palette import INK
from .record import finite_rows, require_one
from .shapes import grouped
from .style import legend_above, mass_line, named, plane_axes, up_to_ticks

Curve = tuple[np.ndarray, np.ndarray]


def acceleration(
    source: Trajectory | System,
    ax: Axes | None = None,
    *,
    times: Numbers | None = None,
) -> Axes:
    """The magnitudes |θ̈_i| over time, ``fig_abs_ui``; masses with the same curve share a line.

    A line that several masses share is black if it is the only one. If all curves end at zero, the time axis ends soon
    after the last of them becomes zero.

    **Arguments:**

    - ``source``: a trajectory, or a system.
    - ``ax``: where to draw; by default a new figure.
    - ``times``: the times, to which kinks are added; by default those of the run. Driven masses are drawn only from a
      trajectory, at its saved times.

    **Raises:** ``ValueError`` when no mass has an angle to draw, or a system comes without times.
    """
    curves = accelerations(source, times)
    if not curves:
        raise ValueError(
            "Argument `source` must have a mass with a schedule, or be a trajectory with a driven mass, "
            "but it has neither; there is no acceleration to draw."
        )
    ax = plane_axes(ax, system=source.system if isinstance(source, Trajectory) else source)
    groups = grouped(curves.items(), _are_equal)
    for members, (t, size) in groups:
        shared = {"color": INK, "linestyle": "-"} if len(groups) == 1 < len(members) else {}
        ax.plot(t, size, **mass_line(members[0], **shared), label=_names(members))
    draw_modes(ax, modes_of(source) if isinstance(source, Trajectory) else None)
    ax.margins(x=0)
    _show_the_active_part(ax, list(curves.values()))
    up_to_ticks(ax, low=0.0)
    top = ax.get_ylim()[1]
    ax.set_ylim(-0.03 * top, top)  # so that the line at zero of a mass that is not pushed is visible
    named(ax, "$t$", r"$|\ddot{\theta}_i|$")
    tell_apart(ax)
    legend_above(ax)
    return ax


def accelerations(source: Trajectory | System, times: Numbers | None = None) -> dict[int, Curve]:
    """Times and |θ̈_i| for each mass i = 1 … n on a rail whose acceleration is known."""
    curves: dict[int, Curve] = {}
    system = source.system if isinstance(source, Trajectory) else source
    if isinstance(source, Trajectory):
        require_one(source)
        if system.driven and system.law is not None:
            curves |= _driven(source)
        if times is None:
            times = np.linspace(float(source.times[0]), float(source.times[-1]), 2001)
    elif times is None:
        raise ValueError("Argument `times` must be given with a system, because a system has no run to take them from.")
    for i, mass in enumerate(system.point_masses, start=1):
        if isinstance(mass.motion, OnRail):
            curves[i] = _scheduled(mass.motion, to_array(times))
    return dict(sorted(curves.items()))


def _scheduled(motion: OnRail, times: Float[jax.Array, " T"]) -> Curve:
    t = np.asarray(times)
    kinks, end = map(np.asarray, _kinks_and_end(motion.schedule, to_array(t[-1])))
    kinks = kinks[(kinks > t[0]) & (kinks < end)]
    # With a value just before each kink, a jump is drawn as a jump; a jump at the end is not drawn.
    t = np.unique(np.concatenate([t[:-1], end[None], kinks, np.nextafter(kinks, t.dtype.type(-np.inf))]))
    return t, np.abs(np.asarray(_second_derivative(motion.schedule, to_array(t))))


@programs.filter_jit
def _second_derivative(schedule, times):
    prepared = schedule.prepare()
    return jax.vmap(lambda t: prepared.derivatives(t)[2])(times)


@programs.filter_jit
def _kinks_and_end(schedule, end):
    """The kinks, and the time at which to evaluate the end of the run."""
    kinks = schedule.kinks().astype(end.dtype)
    return kinks, seen_from_before(kinks, end)


def _driven(trajectory: Trajectory) -> dict[int, Curve]:
    rows = finite_rows(trajectory)
    if rows.size == 0:
        return {}
    given = trajectory.system, to_array(trajectory.times), trajectory.reached, trajectory.state
    size = np.abs(np.asarray(_feedback(*given)))[rows]
    t = np.asarray(trajectory.times)[rows]
    return {index + 1: (t, size[:, slot]) for slot, index in enumerate(trajectory.system.driven)}


@programs.filter_jit
def _feedback(system, times, reached, states):
    prepared, times = system.prepare(), times_looked_at(system, times, reached)
    return jax.vmap(lambda t, state: given_angles(prepared, t, state)[2])(times, states)


def _are_equal(curve: Curve, other: Curve) -> bool:
    return all(len(a) == len(b) and np.allclose(a, b, atol=1e-12) for a, b in zip(curve, other, strict=True))


def _names(members: list[int]) -> str:
    first, last = members[0], members[-1]
    if last - first > 2 and len(members) == last - first + 1:
        return rf"$i = {first}, \ldots, {last}$"
    return "$i = " + ", ".join(map(str, members)) + "$"


def _show_the_active_part(ax: Axes, curves: list[Curve]) -> None:
    active = [t[size > 0].max() for t, size in curves if np.any(size > 0)]
    if active:
        start, end = min(t[0] for t, _ in curves), max(t[-1] for t, _ in curves)
        ax.set_xlim(start, min(end, start + 1.5 * (max(active) - start)))
