"""The variables of a saved trajectory, those of its contact included: dimensions, units, meaning and coordinates."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...interface.arguments import require_one_run
from ...numerics.arrays import arrays_of, to_array
from ...physics.body import AbstractBody
from ...physics.classical import LagrangianState
from ...physics.contact.history import NOWHERE, ContactHistory, ContactSwitches, HeldHistory, HeldSwitches
from ...physics.contact.law import COEFFICIENTS, AbstractFriction, Contact
from ...physics.contact.modes import Mode, SwitchCause
from ...physics.contact.released import ReleasedState
from ...physics.grounds import AbstractSurface
from ...physics.hybrid import NO_HISTORY, AbstractHistory, History, Switches
from ...physics.sensors import AbstractSensor
from ...physics.state import AbstractBodyState, DiskState, ReducedState
from ...physics.system import AbstractSystem
from ...simulation.events import Occurrences, prefix_of_event
from ...simulation.trajectory import Trajectory, always_rolls
from ...simulation.variables import (
    CLASSICAL_STATE,
    EVENTS,
    HISTORY,
    HISTORY_OF_JOINTS,
    HISTORY_OF_REST,
    LAGRANGIAN_STATE,
    LAWS,
    OBSERVABLES,
    OF_SLIDE,
    SIDES_OF_HELD,
    STATE,
    SWITCHES,
    Variable,
)
from ..scenario.body import CONTACT

Variables = dict[str, tuple[Variable, np.ndarray]]


def values(trajectory: Trajectory[Any, Any]) -> Variables:
    """Returns every variable of a trajectory over time with its array; NaN at times that the solve did not reach.

    A reduced trajectory has its state only, and one of a classical system its state, its laws and, if it rolls on a
    plane, the forces there. For a disk, ``z`` is one number.

    **Raises:** ``ValueError`` for a batch of trajectories.
    """
    require_one_run(trajectory.status, "A file")
    if not isinstance(trajectory.system, AbstractBody):
        return _classical_values(trajectory)
    variables = {}
    for name, leaf in arrays_of(trajectory.state).items():
        array = np.asarray(leaf)
        if array.size:
            variables[name] = (_of_body_state(name, trajectory), array)
    if isinstance(trajectory.state, ReducedState):
        return variables
    observables = trajectory.observables
    # What schedules alone determine is known also where the solve did not come, and would look like a part of the
    # run.
    missing = np.isnan(np.asarray(observables.normal_force))
    for name, variable in OBSERVABLES.items():
        array = np.array(getattr(observables, name))
        array[missing] = np.nan
        if array.size or not {"joint", "rail"} & set(variable.dimensions):
            variables[name] = (variable, array)
    return variables


def sensor_values(trajectory: Trajectory[Any, Any], sensors: Mapping[str, AbstractSensor]) -> Variables:
    """Returns the readings of sensors over time, named ``measured_…``; a vector has the axes of its sensor."""
    variables = {}
    for name, leaf in (trajectory.measured(sensors) if sensors else {}).items():
        array, sensor = np.asarray(leaf), sensors[name]
        axes = {(): (), (3,): ("axis",)}.get(array.shape[1:])
        dimensions = describe_unknown(name, array.ndim - 1).dimensions if axes is None else axes
        variables[f"measured_{name}"] = Variable(dimensions, sensor.units, sensor.meaning), array
    return variables


def _of_body_state(name: str, trajectory: Trajectory[Any, Any]) -> Variable:
    variable = describe(name, trajectory.system.planar)
    if name == "z" and isinstance(trajectory.system.ground, AbstractSurface):
        return variable._replace(units="", meaning="coordinates of the contact point on the ground")
    return variable


def describe(name: str, planar: bool) -> Variable:
    """Describes the variable of a field of a body's state; the position of a disk is one number."""
    return STATE[name]._replace(dimensions=()) if planar and name == "z" else STATE[name]


def describe_fields(states: Any) -> dict[str, Variable]:
    """Describes the variables of the fields of states along a leading axis, by name."""
    if isinstance(states, AbstractBodyState):
        return {name: describe(name, isinstance(states, DiskState)) for name in arrays_of(states)}
    if isinstance(states, LagrangianState):
        return {name: LAGRANGIAN_STATE[name] for name in vars(states)}
    return {name: of_classical_state(name, np.ndim(leaf) - 1) for name, leaf in vars(states).items()}


def _classical_values(trajectory: Trajectory[Any, Any]) -> Variables:
    described_state = describe_fields(trajectory.state)
    variables = {name: (described_state[name], np.asarray(leaf)) for name, leaf in vars(trajectory.state).items()}
    for name, leaf in trajectory.laws._asdict().items():
        variables[name] = LAWS.get(name) or describe_unknown(name, np.ndim(leaf) - 1), np.asarray(leaf)
    if always_rolls(trajectory):
        reaction = trajectory.plane_reaction
        forces = {"normal_force": reaction.normal, "friction_ratio": reaction.ratio}
        variables |= {name: (OBSERVABLES[name], np.asarray(array)) for name, array in forces.items()}
    return variables


def of_classical_state(name: str, dimensions: int) -> Variable:
    """Returns the variable of a field of a system that is not a body, such as z, which is a coordinate or a place."""
    for table in (CLASSICAL_STATE, STATE):
        if name in table and len(table[name].dimensions) == dimensions:
            return table[name]
    return describe_unknown(name, dimensions)


def describe_unknown(name: str, dimensions: int) -> Variable:
    """Describes a variable of a system that is not one of jaxball's: its dimensions are named after it."""
    return Variable(tuple(f"{name}_{k}" for k in range(dimensions)), "", name)


def with_units_of_own(variables: dict[str, tuple[Variable, Any]], system: Any) -> dict[str, tuple[Variable, Any]]:
    """Returns variables, each beside its array or shape, those of the states of one's own with the units of these."""
    states = getattr(system, "own_states", None)
    if states is None or states.units is None:
        return variables
    units = " or ".join(dict.fromkeys(unit or "1" for unit in states.units))
    return {
        name: (variable._replace(units=units) if "own_state" in variable.dimensions else variable, array)
        for name, (variable, array) in variables.items()
    }


def labels(system: Any, sizes: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Returns the coordinate along each dimension: 0, 1, …, or the names of masses and joints,
    ``mechanisms[0].joints[1]``.

    Along ``driven`` are the numbers of the driven masses or, where joints are among what is driven, the names of all.
    """
    named: dict[str, Callable[[], Any]] = {
        "coordinate": lambda: system.coordinates,
        "driven": lambda: system.driven if len(system.driven) == len(system.coordinates) else system.coordinates,
        "own_state": lambda: system.own_states.names,
        "sticking": lambda: system.sticking,
        "rail": lambda: [f"masses[{index}]" for index in system.on_rails],
        "joint": lambda: [
            f"mechanisms[{k}].joints[{a}]" for k, item in enumerate(system.mechanisms) for a in range(item.n_joints)
        ],
    }
    return {name: np.asarray(named[name]()) if name in named else np.arange(size) for name, size in sizes.items()}


def event_values(events: Mapping[str, Occurrences]) -> dict[str, Variables]:
    """Returns the times of each event that happened, by the name of their dimension."""
    saved = {}
    for name, seen in events.items():
        rows = min(int(seen.count), seen.times.shape[-1])
        variable = Variable((), "time", f"time of the event {name}")
        if rows:
            saved[prefix_of_event(name)] = {f"{prefix_of_event(name)}_times": (variable, np.asarray(seen.times)[:rows])}
    return saved


SIDES = ("before", "after")
RELEASED = {name: HISTORY[name] for name in ("V", "height")}


@functools.singledispatch
def history_values(history: AbstractHistory, states: Any) -> Variables:
    """Returns the variables over time of a history, besides the ``states``."""
    over_time = history.over_time.items()
    descriptions = HISTORY | HISTORY_OF_REST | HISTORY_OF_JOINTS
    if isinstance(history, ContactHistory) and history.sigma.shape[-1] == 3:
        descriptions |= OF_SLIDE
    return {
        name: (descriptions.get(name) or describe_unknown(name, leaf.ndim - 1), _plain(leaf))
        for name, leaf in over_time
    }


@functools.singledispatch
def switch_values(history: AbstractHistory, of_state: Mapping[str, Variable]) -> Variables:
    """Returns the variables of the kept switches, which have the dimension ``switch``; none for a run without switches.

    ``of_state`` describes the fields of the state.
    """
    return {}


@switch_values.register
def _of_events(history: History, of_state: Mapping[str, Variable]) -> Variables:
    switches, variables = history.switches, {}
    for name, variable in EVENTS.items():
        variables[f"switch_{name}"] = variable, getattr(switches, name)
    for side in SIDES:
        for name, leaf in arrays_of(getattr(switches, side)).items():
            variables[f"switch_{side}_{name}"] = _beside(of_state[name], side), leaf
    return _keep(switches, variables)


@switch_values.register
def _of_changes(history: HeldHistory, of_state: Mapping[str, Variable]) -> Variables:
    switches, described = history.switches, {**of_state, **RELEASED, **SIDES_OF_HELD}
    variables = {f"switch_{name}": (variable, getattr(switches, name, None)) for name, variable in SWITCHES.items()}
    for side in SIDES:
        leaves = _leaves_of(getattr(switches, side))
        leaves |= {name: getattr(switches, f"{name}_{side}") for name in SIDES_OF_HELD}
        variables |= {f"switch_{side}_{name}": (_beside(described[name], side), leaf) for name, leaf in leaves.items()}
    there = {name: (variable, leaf) for name, (variable, leaf) in variables.items() if leaf is not None and leaf.size}
    return _keep(switches, there)


def _leaves_of(states: Any) -> dict[str, Array]:
    """Returns the arrays of states of a body, which may be released, by name."""
    if not isinstance(states, ReleasedState):
        return arrays_of(states)
    return arrays_of(states.body) | {name: getattr(states, name) for name in RELEASED}


def _beside(variable: Variable, side: str) -> Variable:
    return variable._replace(meaning=f"{variable.meaning}, {side} the switch")


def _keep(switches: Switches, variables: Mapping[str, tuple[Variable, Array]]) -> Variables:
    rows = min(int(switches.count), switches.times.shape[-1])
    plain = {name: (variable, _plain(leaf)[:rows]) for name, (variable, leaf) in variables.items()}
    return plain if rows else {}


@functools.singledispatch
def history_summary(history: AbstractHistory) -> dict[str, Any]:
    """Returns the part of a run's summary that its history adds, as JSON: the law of contact, the modes, the switches,
    the end.
    """
    return {}


@history_summary.register
def _of_run_with_modes(history: HeldHistory) -> dict[str, Any]:
    end = {name: np.asarray(leaf)[-1] for name, leaf in history.over_time.items()}
    return {"held": {"end": end, "count": int(history.switches.count), "switches": _list_switches(history.switches)}}


@history_summary.register
def _of_run_with_law(history: ContactHistory) -> dict[str, Any]:
    names = ("V", "height", "slip", "friction_loss", "impact_loss")
    end = {name: np.asarray(getattr(history, name))[-1] for name in names}
    switches = history.switches
    listed = _list_switches(switches)
    for k, switch in enumerate(listed):
        modes = {"from": _mode_name(switches.source[k]), "to": _mode_name(switches.target[k])}
        switch |= modes | {"lost": float(switches.lost[k])}
    modes = [_mode_name(mode) for mode in np.asarray(history.mode)]
    law, count = CONTACT.write(history.law, "contact"), int(switches.count)
    return {"contact": {"law": law, "modes": modes, "end": end, "count": count, "switches": listed}}


def _list_switches(switches: HeldSwitches) -> list[dict[str, Any]]:
    """Returns the time and the cause of each switch that was kept, and what changed in words."""
    return [
        {
            "time": float(switches.times[k]),
            "cause": SwitchCause(int(switches.cause[k])).sentence,
            "changed": switches.words(k),
            "grazing": bool(switches.grazing[k]),
        }
        for k in range(min(int(switches.count), switches.times.shape[-1]))
    ]


def _mode_name(mode: Any) -> str | None:
    """Returns the name of a mode; None at times that the solve did not reach."""
    return Mode(int(mode)).name.lower() if int(mode) >= 0 else None


@functools.singledispatch
def history_attributes(history: AbstractHistory) -> dict[str, Any]:
    """Returns the numbers of a history: how many switches there were and how many are kept, the coefficients
    of a law.
    """
    return {}


@history_attributes.register(History)
@history_attributes.register(HeldHistory)
def _of_all_events(history: History | HeldHistory) -> dict[str, int | float]:
    return {"switches": int(history.switches.count), "max_switches": history.switches.times.shape[-1]}


@history_attributes.register
def _of_law(history: ContactHistory) -> dict[str, int | float]:
    law = {f"contact_{name}": float(getattr(history.law, name)) for name in COEFFICIENTS}
    return law | {"contact_capacity": history.law.capacity, "contact_switches": int(history.switches.count)}


def read_history(
    about: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    attribute: Callable[[str, Callable[[Any], Any]], Any],
    states: Any,
    system: AbstractSystem,
    law: Contact | None = None,
) -> AbstractHistory:
    """Reads the history from a file with the attributes ``about``, which ``attribute`` reads by name, and with its
    ``states`` of the ``system``.

    ``law`` is that of the scenario in the file, whose friction may be a function instead of one coefficient.
    """
    if "contact_friction" in about:
        return _read_contact(arrays, attribute, states, system, getattr(law, "friction_law", None))
    if "switches" not in about:
        return NO_HISTORY
    if isinstance(system, AbstractBody):
        kept = attribute("switches", int), attribute("max_switches", int)
        return HeldHistory(**_read_held(arrays), switches=HeldSwitches(**_read_switches(arrays, kept, states, system)))
    filled = _pad_arrays(arrays, attribute("switches", int), attribute("max_switches", int))

    def side(name: str) -> Any:
        of_side = {field: filled(f"{name}_{field}", leaf.shape[1:]) for field, leaf in arrays_of(states).items()}
        return type(states)(**of_side)

    before, after = map(side, SIDES)
    switches = Switches(
        count=jnp.asarray(attribute("switches", int)),
        times=filled("times"),
        event=filled("event", nothing=NOWHERE),
        before=before,
        after=after,
        grazing=filled("grazing", nothing=False),
    )
    return History(switches=switches)


def _read_contact(
    arrays: Mapping[str, np.ndarray],
    attribute: Callable[[str, Callable[[Any], Any]], Any],
    states: Any,
    system: Any,
    friction_law: AbstractFriction | None,
) -> ContactHistory:
    friction, *others = (attribute(f"contact_{name}", float) for name in COEFFICIENTS)
    law = Contact(
        friction if friction_law is None else friction_law, *others, capacity=attribute("contact_capacity", int)
    )
    over_time = {
        name: to_array(arrays[name]) if variable.flags is None else jnp.asarray(arrays[name], dtype=int)
        for name, variable in HISTORY.items()
    }
    kept = attribute("contact_switches", int), law.capacity
    switches, filled = _read_switches(arrays, kept, states, system), _pad_arrays(arrays, *kept)
    for side in SIDES:
        switches[side] = ReleasedState(switches[side], filled(f"{side}_V", (3,)), filled(f"{side}_height"))
    switches |= {name: filled(name, nothing=NOWHERE) for name in ("source", "target")} | {"lost": filled("lost")}
    return ContactHistory(law=law, **over_time, **_read_held(arrays), switches=ContactSwitches(**switches))


def _read_held(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Reads what dry friction and hard stops hold over time, by the names of the fields of a history."""
    held: dict[str, Any] = dict.fromkeys(HISTORY_OF_REST | HISTORY_OF_JOINTS)
    held |= {name: to_array(arrays[name]) for name in held if name in arrays}
    if held["rests"] is not None:
        held["rests"] = held["rests"] != 0
    return held


def _read_switches(arrays: Mapping[str, np.ndarray], kept: tuple[int, int], states: Any, system: Any) -> dict[str, Any]:
    """Reads the switches of a body that has the ``states``, by the names of the fields of ``HeldSwitches``.

    ``kept``: how many there were, and how many there is room for.
    """
    filled, joints = _pad_arrays(arrays, *kept), (len(system.sticking),)
    read: dict[str, Any] = {"struck": filled("struck", joints, 0.0) if "stops" in arrays else None}
    for side in SIDES:
        body = {name: filled(f"{side}_{name}", leaf.shape[1:]) for name, leaf in arrays_of(states).items()}
        read[side] = type(states)(**body)
        for name, variable in SIDES_OF_HELD.items():
            there = {"rolls": "rests"}.get(name, name) in arrays
            shape, nothing = joints if variable.dimensions else (), 0.0 if name == "stops" else np.nan
            read[f"{name}_{side}"] = filled(f"{side}_{name}", shape, nothing) if there else None
    return read | {
        "count": jnp.asarray(kept[0]),
        "times": filled("times"),
        "event": filled("cause", nothing=NOWHERE),
        "grazing": filled("grazing", nothing=False),
        "joints": tuple(system.sticking),
    }


def _pad_arrays(arrays: Mapping[str, np.ndarray], count: int, capacity: int) -> Callable[..., Array]:
    """Pads the arrays of the kept switches in a file, by name, with values that stand for no switch."""
    rows = min(count, capacity)

    def pad(name: str, shape: tuple[int, ...] = (), nothing: float | int | bool = np.nan) -> Array:
        padded = np.full((capacity, *shape), nothing)
        if rows and padded.size:
            padded[:rows] = arrays[f"switch_{name}"]
        return jnp.asarray(padded)

    return pad


def _plain(leaf: Array) -> np.ndarray:
    """Returns numbers, with booleans as integers, which every format can hold."""
    array = np.asarray(leaf)
    return array.astype(int) if array.dtype == bool else array
