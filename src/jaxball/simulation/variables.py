"""The variables of runs, each stated once: dimensions, units, meaning and symbol.

Files of runs, stores of studies, figures and views read them here.
"""

import enum
from typing import Any, NamedTuple

import numpy as np

from ..physics.contact.modes import Mode, SwitchCause


class Variable(NamedTuple):
    """Dimensions after those of time, units in terms of those of the parameters, and the meaning of a variable.

    - ``symbol``: the paper's, in TeX.
    - ``words``: those of labels in figures, in place of the name.
    - ``flags``: the names that its numbers stand for, if any.
    - ``dtype``: the type of its numbers in the store of a study.
    """

    dimensions: tuple[str, ...]
    units: str
    meaning: str
    symbol: str = ""
    words: str = ""
    flags: type[enum.IntEnum] | None = None
    dtype: str = "f8"

    @property
    def notes(self) -> dict[str, Any]:
        """The attributes of the variable; flags are as the conventions for climate and forecasts (CF) say them."""
        notes: dict[str, Any] = {"units": self.units, "long_name": self.meaning}
        if self.flags is not None:
            notes["flag_values"] = np.array([int(flag) for flag in self.flags])
            notes["flag_meanings"] = " ".join(flag.name.lower() for flag in self.flags)
        return notes


STATE = {
    "q": Variable(("component",), "1", "versor of the rotation from body to space, scalar first", symbol="q"),
    "Lambda": Variable(("row", "axis"), "1", "rotation matrix from body to space", symbol=r"\Lambda"),
    "Omega": Variable(("axis",), "rad/time", "angular velocity in body axes", symbol=r"\Omega"),
    "Gamma": Variable(("axis",), "1", "upward vertical in body axes", symbol=r"\Gamma"),
    "z": Variable(("direction",), "length", "position of the geometric centre on the plane", symbol="z"),
    "phi": Variable((), "rad", "angle of the disk", symbol=r"\phi"),
    "phidot": Variable((), "rad/time", "rate of the disk's angle", symbol=r"\dot{\phi}"),
    "theta": Variable(
        ("driven",), "rad or length", "parameter of a driven mass on its rail, or of a joint", symbol=r"\theta"
    ),
    "thetadot": Variable(("driven",), "rad or length / time", "rate of theta", symbol=r"\dot{\theta}"),
    "own": Variable(("own_state",), "", "state of the user's own", symbol="x"),
}

CLASSICAL_STATE = {
    "q": STATE["q"],
    "Omega": STATE["Omega"],
    "x": Variable((), "length", "coordinate x", symbol="x"),
    "y": Variable((), "length", "coordinate y", symbol="y"),
    "z": Variable((), "length", "coordinate z", symbol="z"),
    "xdot": Variable((), "length/time", "rate of x", symbol=r"\dot{x}"),
    "ydot": Variable((), "length/time", "rate of y", symbol=r"\dot{y}"),
    "multiplier": Variable((), "momentum", "multiplier of the constraint", symbol=r"\lambda"),
}

LAGRANGIAN_STATE = {
    "q": Variable(("coordinate",), "", "generalised coordinates", symbol="q"),
    "qdot": Variable(("coordinate",), "", "rates of the generalised coordinates", symbol=r"\dot{q}"),
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
    "velocity_constraints": Variable(("constraint",), "", "constraints of velocities, 0 along every motion"),
    "position_constraints": Variable(("holonomic",), "", "holonomic constraints, 0 along every motion"),
    "p_y": Variable((), "momentum", "momentum along y", symbol="p_y"),
    "p_xz": Variable((), "momentum", "momentum in the plane of x and z", symbol="p_{xz}"),
    "p_x": Variable((), "momentum", "momentum along x, that of the multiplier included", symbol="p_x"),
    "p_z": Variable((), "momentum", "momentum along z, that of the multiplier included", symbol="p_z"),
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
    "contact_force": Variable(("axis",), "force", "force of the ground on the body, in space axes"),
    "normal_force": Variable((), "force", "normal force of the plane"),
    "friction": Variable(("direction",), "force", "friction force of the plane"),
    "friction_ratio": Variable((), "1", "ratio of friction to normal force"),
    "mass_angles": Variable(("rail",), "rad or length", "parameter of each mass on its rail", symbol=r"\theta_i"),
    "mass_rates": Variable(("rail",), "rad or length / time", "rate of mass_angles"),
    "joint_angles": Variable(("joint",), "rad or length", "parameter of each joint of the mechanisms"),
    "joint_rates": Variable(("joint",), "rad or length / time", "rate of joint_angles"),
    "joint_efforts": Variable(("joint",), "torque or force", "generalised force on each joint"),
}

HISTORY = {
    "mode": Variable((), "1", "mode of the motion, -1 at times that the solve did not reach", flags=Mode, dtype="i1"),
    "V": Variable(("axis",), "length/time", "velocity of the geometric centre in space axes"),
    "height": Variable((), "length", "height of the body above the ground"),
    "slip": Variable(("axis",), "length/time", "slip velocity, along the ground and its normal"),
    "sigma": Variable(("direction",), "1", "direction of slip"),
    "friction_loss": Variable((), "energy", "energy dissipated by sliding friction"),
    "impact_loss": Variable((), "energy", "energy dissipated by impacts"),
}

# In the place of the direction of slip, with a limit surface.
OF_SLIDE = {"sigma": Variable(("axis",), "1", "direction of slip, and of the spin over the ground times the radius")}

# The same of a body that exact dry resistance may hold, besides these.
HISTORY_OF_REST = {
    "rests": Variable((), "1", "1 where dry resistance holds the body against rolling", dtype="i1"),
    "spin": Variable((), "1", "sign of the spinning that dry resistance acts against, 0 where it holds the body"),
    "rolling": Variable(("direction",), "1", "direction of rolling, 0 where dry resistance holds the body"),
}

# The same of a body with joints that dry friction or hard stops may hold.
HISTORY_OF_JOINTS = {
    "directions": Variable(("sticking",), "1", "direction in which a joint with dry friction slips, 0 where it sticks"),
    "stops": Variable(("sticking",), "1", "1 or -1 where a joint rests against its upper or lower stop, else 0"),
    "stop_loss": Variable((), "energy", "energy dissipated where joints strike their stops"),
}

# By the names of the fields of the switches of a body. Those of the states before and after come with the kind of the
# state.
SWITCHES = {
    "times": Variable((), "time", "time of a change of mode"),
    "cause": Variable((), "1", "why the mode ended", flags=SwitchCause),
    "source": Variable((), "1", "mode before the switch", flags=Mode),
    "target": Variable((), "1", "mode after the switch", flags=Mode),
    "lost": Variable((), "energy", "energy dissipated by the impact"),
    "grazing": Variable((), "1", "1 if the function that ended the mode touched zero without crossing it"),
    "struck": Variable(("sticking",), "1", "1 or -1 where a joint strikes its upper or lower stop, else 0"),
}
# The same before and after, of what dry friction or hard stops may hold.
SIDES_OF_HELD = {
    "rolls": Variable((), "1", "1 where the body rolls, 0 where dry resistance holds it"),
    "spin": HISTORY_OF_REST["spin"],
    "directions": HISTORY_OF_JOINTS["directions"],
    "stops": HISTORY_OF_JOINTS["stops"],
}

# Of a hybrid system of another kind, by the names of the fields of its Switches.
EVENTS = {
    "times": Variable((), "time", "time of an event"),
    "event": Variable((), "1", "index of the guard that fell to zero, or the number of guards for a time event"),
    "grazing": Variable((), "1", "1 if the guard touched zero without crossing it"),
}

# Of a run as a whole, in the store of a study.
RUN = {
    "status": Variable(
        (), "", "how the solve ended, the number of a jaxball.Status; -1 before it is computed", dtype="i1"
    ),
    "steps": Variable((), "", "steps taken, accepted and rejected", dtype="i4"),
    "rejected": Variable((), "", "steps rejected", dtype="i4"),
    "reached": Variable((), "time", "the time that the solve reached", words="time reached"),
}
RUN_SWITCHES = {
    "switches": Variable((), "", "how often the mode of contact switched", dtype="i4"),
    "first_switch": Variable((), "time", "time of the first switch; NaN if there is none"),
    "modes": Variable(
        (), "", "the modes of the run: the sum of 1 for rolling, 2 for sliding, 4 for flight and 8 for rest", dtype="i1"
    ),
}
EXTREMES = {
    "least_normal_force": Variable((), "force", "least normal force of the run", words="least $N$"),
    "least_normal_force_time": Variable((), "time", "least normal force time of the run"),
    "friction_needed": Variable((), "1", "friction needed of the run", words=r"$\mu_{\min}$"),
    "friction_needed_time": Variable((), "time", "friction needed time of the run"),
    "largest_friction": Variable((), "force", "largest friction of the run"),
    "largest_friction_time": Variable((), "time", "largest friction time of the run"),
}
# Of a row whose least normal force is found.
LEFT_PLANE = {
    "left_plane": Variable(
        (), "", "1 if the body would have left the plane, because N was not positive; -1 if unknown", dtype="i1"
    ),
}


def variables_of_event(name: str) -> dict[str, Variable]:
    """Returns the variables of an event of a scenario in the store of a study."""
    return {
        f"{name}_count": Variable((), "", f"how often the event {name} happened", dtype="i4"),
        f"{name}_time": Variable((), "time", f"time of the first {name}; NaN if there is none"),
    }


# Quantities that a study can find by itself, in whose store there are no units.
FINDS = {
    "distance": Variable((), "length", "distance of the run"),
    "largest_angular_speed": Variable((), "rad/time", "largest angular speed of the run"),
    "energy_drift": Variable((), "energy", "energy drift of the run"),
}

_SYMBOLS = {name: one.symbol for table in (LAWS, CLASSICAL_STATE, STATE) for name, one in table.items() if one.symbol}


def symbol_of(name: str) -> str:
    """Returns the symbol of a component of a state or of a conserved quantity, in TeX; empty if it has none."""
    return _SYMBOLS.get(name, "")


def symbol(path: str) -> str:
    """Returns the symbol of a component by its path, which counts from 0, for a figure: Ω₁ for ``Omega[0]``, but q₀ for
    ``q[0]``.
    """
    name, _, index = path.removesuffix("]").partition("[")
    subscript = f"_{{{int(index) if name == 'q' else int(index) + 1}}}" if index else ""
    return f"${symbol_of(name) or name}{subscript}$"
