"""The coordinates of masses along their rails and of joints: figures over time, and their units."""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from ..physics.mechanisms import Carriage, Hinge, Slider
from ..physics.motion import Driven, OnRail
from ..physics.rails import AbstractRail, FunctionRail, Tube
from ..simulation.trajectory import Trajectory
from .modes import modes_of
from .over_time import Series, over_time
from .palette import mass_look
from .record import drawn_run, finite_rows

ANGLE, LENGTH, UNKNOWN = "rad", "length", ""


def mass_angles(trajectory: Trajectory, ax: Axes | None = None) -> Axes:
    r"""θ_i of the masses on rails, in rad, or along a tube a length.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` when no mass is on a rail, for a reduced trajectory, a batch, or a three-dimensional
    ``ax``.

    **Example:**

    >>> from jaxball import Circle, ConstantRate, Disk, OnRail, PointMass, plot, simulate
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, OnRail(Circle(0.5), ConstantRate(0.0, 1.0)))])
    >>> plot.mass_angles(simulate(disk, [0.0, 1.0, 2.0])).get_ylabel()
    '$\\theta_i$ (rad)'
    """
    run = drawn_run(trajectory)
    angles = angles_of(run)
    if not angles:
        raise ValueError("Argument `trajectory` must be of a body with a mass on a rail, whose θ is drawn.")
    series = [Series(values, rf"$\theta_{{{i}}}$", *mass_look(i)) for i, values in angles.items()]
    times = np.asarray(run.times)[finite_rows(run)]
    name = rf"$\theta_i${units_of(mass_units(run.system).values())}"
    return over_time(run.system, times, series, name, ax, modes=modes_of(run), size=1.0)


def angles_of(trajectory: Trajectory) -> dict[int, Float[np.ndarray, " T"]]:
    """θ of each mass i = 1 … n on a rail, along a run at the times that are drawn."""
    rows, system = finite_rows(trajectory), trajectory.system
    times, theta = np.asarray(trajectory.times)[rows], np.asarray(trajectory.state.theta)[rows]
    angles = {index + 1: theta[:, slot] for slot, index in enumerate(system.driven)}
    for i, mass in enumerate(system.point_masses, start=1):
        if isinstance(mass.motion, OnRail):
            angles[i] = np.asarray(_angle(mass.motion.schedule, to_array(times)))
    return dict(sorted(angles.items()))


def mass_units(system: System) -> dict[int, str]:
    """The unit of θ_i of each mass on a rail."""
    return {
        i: unit_of(mass.motion.rail)
        for i, mass in enumerate(system.point_masses, start=1)
        if isinstance(mass.motion, OnRail | Driven)
    }


def unit_of(place: Any) -> str:
    """The unit of the coordinate along a rail or of a joint; none if it is unknown."""
    if isinstance(place, Carriage):
        return unit_of(place.rail)
    if isinstance(place, Tube | Slider):
        return LENGTH
    return UNKNOWN if isinstance(place, FunctionRail) or not isinstance(place, Hinge | AbstractRail) else ANGLE


def units_of(units: Iterable[str]) -> str:
    """The end of an axis label for coordinates with these units."""
    known = list(dict.fromkeys(unit for unit in units if unit))
    return f" ({', '.join(known)})" if known else ""


@programs.filter_jit
def _angle(schedule, times):
    prepared = schedule.prepare()
    return jax.vmap(lambda t: prepared.derivatives(t)[0])(times)
