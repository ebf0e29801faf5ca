"""The variables of a saved trajectory: their dimensions, units and meaning."""

from typing import NamedTuple

import numpy as np

from ..state import DiskState, ReducedState
from ..trajectory import Trajectory

AXES = ("1", "2", "3")
COORDINATES = {
    "axis": AXES,
    "row": AXES,
    "direction": ("1", "2"),
    "component": ("0", "1", "2", "3"),
}


class Variable(NamedTuple):
    """Dimensions after ``time``, units in terms of those of the parameters, and what the variable is."""

    dimensions: tuple[str, ...]
    units: str
    meaning: str


STATE = {
    "q": Variable(("component",), "1", "versor of the rotation from body to space, scalar first"),
    "Lambda": Variable(("row", "axis"), "1", "rotation matrix from body to space"),
    "Omega": Variable(("axis",), "rad/time", "angular velocity in body axes"),
    "Gamma": Variable(("axis",), "1", "upward vertical in body axes"),
    "z": Variable(("direction",), "length", "place of the geometric centre on the plane"),
    "phi": Variable((), "rad", "angle of the disk"),
    "phidot": Variable((), "rad/time", "rate of the disk's angle"),
    "theta": Variable(("driven",), "rad or length", "parameter of a driven mass on its rail"),
    "thetadot": Variable(("driven",), "rad or length / time", "rate of theta"),
}

OBSERVABLES = {
    "mass_positions_body": Variable(("mass", "axis"), "length", "place of a mass from centre, body axes"),
    "mass_positions_space": Variable(("mass", "axis"), "length", "place of a mass from centre, space axes"),
    "centre_of_mass_body": Variable(("axis",), "length", "place of the centre of mass, body axes"),
    "centre_of_mass_space": Variable(("axis",), "length", "place of the centre of mass, space axes"),
    "geometric_centre": Variable(("axis",), "length", "place of the geometric centre in space"),
    "contact_point": Variable(("axis",), "length", "place of the contact point in space"),
    "vertical_body": Variable(("axis",), "1", "upward vertical in body axes"),
    "angular_velocity_body": Variable(("axis",), "rad/time", "angular velocity in body axes"),
    "angular_velocity_space": Variable(("axis",), "rad/time", "angular velocity in space axes"),
    "angular_acceleration_body": Variable(("axis",), "rad/time^2", "angular acceleration in body axes"),
    "kinetic_energy": Variable((), "energy", "kinetic energy"),
    "potential_energy": Variable((), "energy", "potential energy, 0 at the height of the centre"),
    "energy": Variable((), "energy", "total energy"),
    "power": Variable((), "power", "power of the actuation and of the external force"),
    "normal_force": Variable((), "force", "normal force of the plane"),
    "friction": Variable(("direction",), "force", "friction force of the plane"),
    "friction_ratio": Variable((), "1", "friction over normal force"),
}


def values(trajectory: Trajectory) -> dict[str, tuple[Variable, np.ndarray]]:
    """Every variable of a trajectory with its array, ``time`` first; NaN where the solve did not come.

    A reduced trajectory has its state only. ``z`` of a disk is one number.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    if np.ndim(trajectory.times) != 1 or np.ndim(trajectory.status) != 0:
        raise ValueError(
            "Argument `trajectory` must be a single trajectory, but it is a batch with times of shape "
            f"{np.shape(trajectory.times)}; save its members one by one."
        )
    found = {}
    for name, leaf in vars(trajectory.state).items():
        array, variable = np.asarray(leaf), STATE[name]
        if isinstance(trajectory.state, DiskState) and name == "z":
            variable = variable._replace(dimensions=())
        if array.size:
            found[name] = (variable, array)
    if isinstance(trajectory.state, ReducedState):
        return found
    observables = trajectory.observables
    missing = np.isnan(np.asarray(observables.normal_force))
    for name, variable in OBSERVABLES.items():
        array = np.array(getattr(observables, name))
        array[missing] = np.nan
        found[name] = (variable, array)
    return found
