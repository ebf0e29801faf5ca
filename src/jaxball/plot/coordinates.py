"""The coordinates of masses along their rails and of joints: figures over time of angles, accelerations and efforts."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .. import programs
from ..numerics.arrays import Numbers, to_array
from ..physics.body import System
from ..physics.mechanisms import Carriage, Hinge, Slider
from ..physics.observables import evaluate_law, evaluate_schedules
from ..physics.prescribed.rails import AbstractRail, FunctionRail, Tube
from ..simulation.trajectory import Trajectory, times_looked_at
from .over_time import NO_MODES, Series, draw_modes, modes_of, over_run, sizes_of, tell_apart
from .palette import INK, mass_look
from .record import finite_rows, record, require_one_of_body, with_jumps
from .shapes import group_equal
from .style import label_axes, legend_above, mass_line, plane_axes, up_to_ticks, zero_line

ANGLE, LENGTH, UNKNOWN = "rad", "length", ""
Curve = tuple[np.ndarray, np.ndarray]


def mass_angles(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    r"""Draws θ_i of the masses on rails, in rad, or along a tube a length.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` when no mass is on a rail, for a reduced trajectory, a batch, or a three-dimensional
    ``ax``.

    **Example:**

    >>> from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass, plot, simulate
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, OnRail(Circle(0.5), ConstantRate(0.0, 1.0)))])
    >>> simulate(disk, [0.0, 1.0, 2.0]).plot("mass_angles").get_ylabel()
    '$\\theta_i$ (rad)'
    """
    run = with_jumps(trajectory)
    angles = angles_of(run)
    if not angles:
        raise ValueError("Argument `trajectory` must be of a body with a mass on a rail, whose θ is drawn.")
    series = [Series(values, rf"$\theta_{{{i}}}$", *mass_look(i)) for i, values in angles.items()]
    return over_run(run, series, rf"$\theta_i${units_of(mass_units(run.system).values())}", ax, size=1.0)


def angles_of(trajectory: Trajectory) -> dict[int, Float[np.ndarray, " T"]]:
    """Returns θ of each mass i = 1 … n on a rail, along a run at the times that are drawn."""
    values = record(trajectory).observables.mass_angles
    return {index + 1: values[:, k] for k, index in enumerate(trajectory.system.on_rails)}


def mass_units(system: System) -> dict[int, str]:
    """Returns the unit of θ_i of each mass on a rail."""
    masses = system.point_masses
    return {index + 1: unit_of(masses[index].rail) for index in system.on_rails}


def unit_of(place: Any) -> str:
    """Returns the unit of the coordinate along a rail or of a joint; none if it is unknown."""
    if isinstance(place, Carriage):
        return unit_of(place.rail)
    if isinstance(place, Tube | Slider):
        return LENGTH
    return UNKNOWN if isinstance(place, FunctionRail) or not isinstance(place, Hinge | AbstractRail) else ANGLE


def units_of(units: Iterable[str]) -> str:
    """Returns the end of an axis label for coordinates with these units."""
    names = list(dict.fromkeys(unit for unit in units if unit))
    return f" ({', '.join(names)})" if names else ""


def joint_units(system: System) -> str:
    """Returns the end of an axis label for the coordinates of all joints."""
    return units_of([unit_of(joint) for mechanism in system.mechanisms for joint in getattr(mechanism, "joints", ())])


def joints_of(system: System) -> list[str]:
    """Lists the joints a = 1 … of the mechanisms j = 1 …, as ``j,a``."""
    return [f"{j},{a}" for j, mechanism in enumerate(system.mechanisms, 1) for a in range(1, mechanism.n_joints + 1)]


def joint_angles(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws θ of every joint of the mechanisms: rad for a hinge, a length for a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a body without mechanisms, a reduced trajectory, a batch, or a three-dimensional
    ``ax``.
    """
    run = _run(trajectory)
    name = rf"$\theta_{{j,a}}${joint_units(run.system)}"
    return _of_joints(run, record(run).observables.joint_angles, r"\theta", name, 1.0, ax)


def joint_efforts(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    """Draws Q of every joint of the mechanisms: the torque of a hinge, the force along a slider.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** as :func:`joint_angles`, also for a three-dimensional ``ax``.
    """
    run = _run(trajectory)
    size = sizes_of(run.system).energy
    ax = _of_joints(run, record(run).observables.joint_efforts, "Q", "joint effort", size, ax)
    zero_line(ax)
    return ax


def _run(trajectory: Trajectory) -> Trajectory:
    require_one_of_body(trajectory)
    run = with_jumps(trajectory)
    if not run.system.mechanisms:
        raise ValueError("Argument `trajectory` must be of a body with mechanisms, whose joints are drawn.")
    return run


def _of_joints(
    run: Trajectory, values: Float[np.ndarray, "T joints"], symbol: str, label: str, size: float, ax: Axes | None
) -> Axes:
    names = (f"${symbol}_{{{joint}}}$" for joint in joints_of(run.system))
    series = [Series(values[:, k], name, *mass_look(k + 1)) for k, name in enumerate(names)]
    return over_run(run, series, label, ax, size=size)


def acceleration(source: Trajectory | System, ax: Axes | None = None, *, times: Numbers | None = None) -> Axes:
    """Draws the magnitudes |θ̈_i| over time, ``fig_abs_ui``; masses with the same curve share a line.

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
    ax = plane_axes(ax, shown=source)
    groups = group_equal(
        curves.items(), lambda curve, other: all(_close(a, b) for a, b in zip(curve, other, strict=True))
    )
    for members, (t, size) in groups:
        shared = {"color": INK, "linestyle": "-"} if len(groups) == 1 < len(members) else {}
        ax.plot(t, size, **mass_line(members[0], **shared), label=_names(members))
    draw_modes(ax, modes_of(source) if isinstance(source, Trajectory) else NO_MODES)
    ax.margins(x=0)
    active = [t[size > 0].max() for t, size in curves.values() if np.any(size > 0)]
    if active:
        # Half as long again as anything moves, so that the end is seen; zeros until the end of the run are cut off.
        start, end = min(t[0] for t, _ in curves.values()), max(t[-1] for t, _ in curves.values())
        ax.set_xlim(start, min(end, start + 1.5 * (max(active) - start)))
    up_to_ticks(ax, low=0.0)
    top = ax.get_ylim()[1]
    ax.set_ylim(-0.03 * top, top)  # so that the line at zero of a mass that is not pushed is visible
    label_axes(ax, "$t$", r"$|\ddot{\theta}_i|$")
    tell_apart(ax)
    legend_above(ax)
    return ax


def accelerations(source: Trajectory | System, times: Numbers | None = None) -> dict[int, Curve]:
    """Returns times and |θ̈_i| for each mass i = 1 … n on a rail whose acceleration is known."""
    curves: dict[int, Curve] = {}
    system = source.system if isinstance(source, Trajectory) else source
    if isinstance(source, Trajectory):
        require_one_of_body(source)
        rows = finite_rows(source)
        if rows.size and system.driven and system.law is not None:
            by_law = _accelerations_by_law(system, to_array(source.times), source.ends, source.state)
            size = np.abs(np.asarray(by_law))[rows]
            t = np.asarray(source.times)[rows]
            curves |= {index + 1: (t, size[:, slot]) for slot, index in enumerate(system.driven)}
        if times is None:
            # A schedule is known at all times, however few were saved.
            times = np.linspace(float(source.times[0]), float(source.times[-1]), 2001)
    elif times is None:
        raise ValueError("Argument `times` must be given with a system, because a system has no run to take them from.")
    for index, (t, thetaddot) in evaluate_schedules(system, to_array(times)).items():
        curves[index + 1] = t, np.abs(thetaddot)
    return dict(sorted(curves.items()))


@programs.filter_jit
def _accelerations_by_law(system, times, ends, states):
    return evaluate_law(system, times_looked_at(system, times, ends), states)


def _close(a: np.ndarray, b: np.ndarray) -> bool:
    return len(a) == len(b) and np.allclose(a, b, atol=1e-12)


def _names(members: list[int]) -> str:
    first, last = members[0], members[-1]
    if last - first > 2 and len(members) == last - first + 1:
        return rf"$i = {first}, \ldots, {last}$"
    return "$i = " + ", ".join(map(str, members)) + "$"
