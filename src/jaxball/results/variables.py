"""The variables of a saved trajectory: their dimensions, units, meaning and coordinates."""

import enum
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..physics.body import AbstractBody
from ..physics.state import DiskState, ReducedState
from ..sensors import AbstractSensor
from ..simulation.trajectory import Trajectory


class Variable(NamedTuple):
    """Dimensions after ``time``, units in terms of those of the parameters, and the meaning of the variable.

    ``flags`` gives the names that its numbers stand for, if any.
    """

    dimensions: tuple[str, ...]
    units: str
    meaning: str
    flags: type[enum.IntEnum] | None = None

    @property
    def notes(self) -> dict[str, Any]:
        """The attributes of the variable; flags are as the conventions for climate and forecasts (CF) say them."""
        notes: dict[str, Any] = {"units": self.units, "long_name": self.meaning}
        if self.flags is not None:
            notes["flag_values"] = np.array([int(one) for one in self.flags])
            notes["flag_meanings"] = " ".join(one.name.lower() for one in self.flags)
        return notes


STATE = {
    "q": Variable(("component",), "1", "versor of the rotation from body to space, scalar first"),
    "Lambda": Variable(("row", "axis"), "1", "rotation matrix from body to space"),
    "Omega": Variable(("axis",), "rad/time", "angular velocity in body axes"),
    "Gamma": Variable(("axis",), "1", "upward vertical in body axes"),
    "z": Variable(("direction",), "length", "position of the geometric centre on the plane"),
    "phi": Variable((), "rad", "angle of the disk"),
    "phidot": Variable((), "rad/time", "rate of the disk's angle"),
    "theta": Variable(("driven",), "rad or length", "parameter of a driven mass on its rail, or of a joint"),
    "thetadot": Variable(("driven",), "rad or length / time", "rate of theta"),
}

CLASSICAL_STATE = {
    "q": STATE["q"],
    "Omega": STATE["Omega"],
    "x": Variable((), "length", "coordinate x"),
    "y": Variable((), "length", "coordinate y"),
    "z": Variable((), "length", "coordinate z"),
    "xdot": Variable((), "length/time", "rate of x"),
    "ydot": Variable((), "length/time", "rate of y"),
    "multiplier": Variable((), "momentum", "multiplier of the constraint"),
}

LAWS = {
    "energy": Variable((), "energy", "total energy"),
    "spatial_momentum": Variable(("axis",), "angular momentum", "angular momentum in space axes"),
    "momentum_squared": Variable((), "angular momentum^2", "square of the angular momentum"),
    "vertical_momentum": Variable((), "angular momentum", "angular momentum about the vertical"),
    "axial_momentum": Variable((), "angular momentum * length", "angular momentum along chi, Lagrange's integral"),
    "vertical_squared": Variable((), "1", "square of the upward vertical in body axes"),
    "versor_squared": Variable((), "1", "square of the versor"),
    "constraint": Variable((), "rad/time", "angular velocity along xi, 0 by the constraint"),
    "p_y": Variable((), "momentum", "momentum along y"),
    "p_xz": Variable((), "momentum", "momentum in the plane of x and z"),
    "p_x": Variable((), "momentum", "momentum along x, that of the multiplier included"),
    "p_z": Variable((), "momentum", "momentum along z, that of the multiplier included"),
}

OBSERVABLES = {
    "mass_positions_body": Variable(("mass", "axis"), "length", "position of a mass from the centre, body axes"),
    "mass_positions_space": Variable(("mass", "axis"), "length", "position of a mass from the centre, space axes"),
    "centre_of_mass_body": Variable(("axis",), "length", "position of the centre of mass, body axes"),
    "centre_of_mass_space": Variable(("axis",), "length", "position of the centre of mass, space axes"),
    "geometric_centre": Variable(("axis",), "length", "position of the geometric centre in space"),
    "contact_point": Variable(("axis",), "length", "position of the contact point in space"),
    "vertical_body": Variable(("axis",), "1", "upward vertical in body axes"),
    "angular_velocity_body": Variable(("axis",), "rad/time", "angular velocity in body axes"),
    "angular_velocity_space": Variable(("axis",), "rad/time", "angular velocity in space axes"),
    "angular_acceleration_body": Variable(("axis",), "rad/time^2", "angular acceleration in body axes"),
    "kinetic_energy": Variable((), "energy", "kinetic energy"),
    "potential_energy": Variable((), "energy", "potential energy, 0 at the height of the centre"),
    "energy": Variable((), "energy", "total energy"),
    "power": Variable((), "power", "power of the actuation, the external force and everything else that does work"),
    "dissipation": Variable((), "power", "power dissipated by resistance"),
    "normal_force": Variable((), "force", "normal force of the plane"),
    "friction": Variable(("direction",), "force", "friction force of the plane"),
    "friction_ratio": Variable((), "1", "ratio of friction to normal force"),
    "joint_angles": Variable(("joint",), "rad or length", "parameter of each joint of the mechanisms"),
    "joint_rates": Variable(("joint",), "rad or length / time", "rate of joint_angles"),
    "joint_efforts": Variable(("joint",), "torque or force", "generalised force on each joint"),
}


def values(trajectory: Trajectory[Any, Any]) -> dict[str, tuple[Variable, np.ndarray]]:
    """Every variable of a trajectory with its array, ``time`` first; NaN at times that the solve did not reach.

    A reduced trajectory has its state only, and one of a classical system its state and its laws. For a disk, ``z`` is
    one number.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    if np.ndim(trajectory.times) != 1 or np.ndim(trajectory.status) != 0:
        raise ValueError(
            "Argument `trajectory` must be a single trajectory, but it is a batch with times of shape "
            f"{np.shape(trajectory.times)}; save its members one by one."
        )
    if not isinstance(trajectory.system, AbstractBody):
        return _classical_values(trajectory)
    variables = {}
    for name, leaf in vars(trajectory.state).items():
        array = np.asarray(leaf)
        if array.size:
            variables[name] = (described(name, isinstance(trajectory.state, DiskState)), array)
    if isinstance(trajectory.state, ReducedState):
        return variables
    observables = trajectory.observables
    missing = np.isnan(np.asarray(observables.normal_force))
    for name, variable in OBSERVABLES.items():
        array = np.array(getattr(observables, name))
        array[missing] = np.nan
        if array.size or "joint" not in variable.dimensions:
            variables[name] = (variable, array)
    return variables


def measured_values(
    trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]
) -> dict[str, tuple[Variable, np.ndarray]]:
    """The readings of sensors over time, named ``measured_…``; a vector has the axes of its sensor."""
    variables = {}
    for name, leaf in (trajectory.measured(sensors) if sensors else {}).items():
        array, sensor = np.asarray(leaf), sensors[name]
        known = {(): (), (3,): ("axis",)}.get(array.shape[1:])
        dimensions = undescribed(name, array.ndim - 1).dimensions if known is None else known
        variables[f"measured_{name}"] = Variable(dimensions, sensor.units, sensor.meaning), array
    return variables


def described(name: str, planar: bool) -> Variable:
    """The variable of a field of a body's state; the position of a disk is one number."""
    return STATE[name]._replace(dimensions=()) if planar and name == "z" else STATE[name]


def _classical_values(trajectory: Trajectory[Any, Any]) -> dict[str, tuple[Variable, np.ndarray]]:
    variables = {}
    for known, leaves in ((CLASSICAL_STATE, vars(trajectory.state)), (LAWS, trajectory.laws._asdict())):
        for name, leaf in leaves.items():
            array = np.asarray(leaf)
            variables[name] = known.get(name) or undescribed(name, array.ndim - 1), array
    return variables


def undescribed(name: str, dimensions: int) -> Variable:
    """A variable of a system that is not one of jaxball's: its dimensions are named after it."""
    return Variable(tuple(f"{name}_{k}" for k in range(dimensions)), "", name)


def labels(system: Any, sizes: Mapping[str, int]) -> dict[str, np.ndarray]:
    """The coordinate along each dimension: 0, 1, …, or the names of joints, ``mechanisms[0].joints[1]``.

    Along ``driven`` are the numbers of the driven masses or, where joints are among what is driven, the names of all.
    """
    coordinates = {name: np.arange(size) for name, size in sizes.items()}
    if "driven" in sizes:
        coordinates["driven"] = np.asarray(system.coordinates if system.joints else system.driven)
    if "joint" in sizes:
        coordinates["joint"] = np.asarray(
            [f"mechanisms[{k}].joints[{a}]" for k, item in enumerate(system.mechanisms) for a in range(item.n_joints)]
        )
    return coordinates
