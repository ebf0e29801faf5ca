"""The variables of a saved trajectory, those of its contact included: dimensions, units, meaning and coordinates."""

import enum
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..numerics.arrays import to_array
from ..physics.body import AbstractBody
from ..physics.contact_law import Contact
from ..physics.modes import Cause, Mode
from ..physics.released import ReleasedState
from ..physics.state import DiskState, ReducedState
from ..scenario.body import COEFFICIENTS
from ..sensors import AbstractSensor
from ..simulation.history import NOWHERE, ContactHistory, Switches
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


HISTORY = {
    "mode": Variable((), "1", "mode of the motion, -1 at times that the solve did not reach", Mode),
    "V": Variable(("axis",), "length/time", "velocity of the geometric centre in space axes"),
    "height": Variable((), "length", "height of the body above the plane"),
    "slip": Variable(("axis",), "length/time", "velocity of the lowest point relative to the plane, space axes"),
    "sigma": Variable(("direction",), "1", "direction of slip"),
    "rubbed": Variable((), "energy", "energy dissipated by sliding friction"),
    "struck": Variable((), "energy", "energy dissipated by impacts"),
}

# By the names of the fields of Switches. Those of the states before and after come with the kind of the state.
SWITCHES = {
    "times": Variable((), "time", "time of a change of mode"),
    "cause": Variable((), "1", "why the mode ended", Cause),
    "source": Variable((), "1", "mode before the switch", Mode),
    "target": Variable((), "1", "mode after the switch", Mode),
    "lost": Variable((), "energy", "energy dissipated by the impact"),
    "grazing": Variable((), "1", "1 if the function that ended the mode touched zero without crossing it"),
}
SIDES = ("before", "after")
RELEASED = {name: HISTORY[name] for name in ("V", "height")}

Variables = dict[str, tuple[Variable, np.ndarray]]


def history_values(history: ContactHistory) -> Variables:
    """The variables over time."""
    return {name: (variable, np.asarray(getattr(history, name))) for name, variable in HISTORY.items()}


def switch_values(history: ContactHistory, of_state: Mapping[str, Variable]) -> Variables:
    """The variables of the kept switches, which have the dimension ``switch``; none for a run without switches.

    ``of_state`` describes the fields of the body's state.
    """
    switches = history.switches
    kept = min(int(switches.count), history.law.room)
    if not kept:
        return {}
    variables = {f"switch_{name}": (variable, getattr(switches, name)) for name, variable in SWITCHES.items()}
    for side in SIDES:
        released = getattr(switches, side)
        leaves = vars(released.body) | {name: getattr(released, name) for name in RELEASED}
        for name, leaf in leaves.items():
            if leaf.size:
                variable = RELEASED.get(name) or of_state[name]
                meaning = f"{variable.meaning}, {side} the switch"
                variables[f"switch_{side}_{name}"] = variable._replace(meaning=meaning), leaf
    return {name: (variable, _plain(leaf)[:kept]) for name, (variable, leaf) in variables.items()}


def contact_attributes(history: ContactHistory) -> dict[str, int | float]:
    """The coefficients of the law, how many switches it keeps, and how many there were."""
    law = {f"contact_{name}": float(getattr(history.law, name)) for name in COEFFICIENTS}
    return law | {"contact_room": history.law.room, "contact_switches": int(history.switches.count)}


def read_history(
    arrays: Mapping[str, np.ndarray], attribute: Callable[[str, Callable[[Any], Any]], Any], states: Any
) -> ContactHistory:
    """The history in a file, whose attributes ``attribute`` reads by name; ``states`` are those of the body."""
    coefficients = [attribute(f"contact_{name}", float) for name in COEFFICIENTS]
    law = Contact(*coefficients, room=attribute("contact_room", int))
    over_time = {
        name: to_array(arrays[name]) if variable.flags is None else jnp.asarray(arrays[name], dtype=int)
        for name, variable in HISTORY.items()
    }
    switches = _read_switches(arrays, attribute("contact_switches", int), law.room, vars(states), type(states))
    return ContactHistory(law=law, **over_time, switches=switches)


def _read_switches(
    arrays: Mapping[str, np.ndarray], count: int, room: int, fields: Mapping[str, Array], state_type: Any
) -> Switches:
    kept = min(count, room)

    def filled(name: str, shape: tuple[int, ...] = (), nothing: float | int | bool = np.nan) -> Array:
        """An array of the file, padded with the values that stand for no switch."""
        whole = np.full((room, *shape), nothing)
        if kept and whole.size:
            whole[:kept] = arrays[f"switch_{name}"]
        return jnp.asarray(whole)

    def released(side: str) -> ReleasedState:
        body = {name: filled(f"{side}_{name}", leaf.shape[1:]) for name, leaf in fields.items()}
        return ReleasedState(state_type(**body), filled(f"{side}_V", (3,)), filled(f"{side}_height"))

    before, after = map(released, SIDES)
    return Switches(
        count=jnp.asarray(count),
        times=filled("times"),
        cause=filled("cause", nothing=NOWHERE),
        source=filled("source", nothing=NOWHERE),
        target=filled("target", nothing=NOWHERE),
        before=before,
        after=after,
        lost=filled("lost"),
        grazing=filled("grazing", nothing=False),
    )


def _plain(leaf: Array) -> np.ndarray:
    """Numbers, with booleans as integers, which every format can hold."""
    array = np.asarray(leaf)
    return array.astype(int) if array.dtype == bool else array
