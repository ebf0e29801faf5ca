"""Reads and writes the body of a scenario file: its shell, force, ground and resistance, contact, and sensors.

``files`` calls it for these tables. Analyses of bodies that always roll get their state from ``rolling_state``, and
those that need a whole run ask ``require_whole_run``.
"""

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...interface.arguments import require_function
from ...interface.wording import one_of
from ...numerics.arrays import a_vector, to_array
from ...numerics.declare import BETWEEN_0_AND_1, NOT_NEGATIVE, POSITIVE, TIME
from ...physics.body import AbstractBody, Ball, Disk, System
from ...physics.contact.law import (
    COEFFICIENTS,
    DEFAULT_CAPACITY,
    AbstractFriction,
    Contact,
    LimitSurface,
    SmoothedCoulomb,
)
from ...physics.contact.released import ReleasedState
from ...physics.contact.slide import find_rival
from ...physics.convex import ConvexBody
from ...physics.forces.force import AbstractWrench, FunctionWrench, HarmonicForce, require_wrench
from ...physics.forces.resistance import AbstractResistance, Resistance, find_contradiction
from ...physics.own_states import OwnStates
from ...physics.prescribed.frames import AbstractFrame
from ...physics.sensors import AbstractSensor, Accelerometer, Encoder, Gyroscope, Position, SensorErrors, Tachometer
from ...physics.shape import AbstractShape, Ellipsoid, SupportFunction
from ...physics.state import BallState, DiskState
from ...physics.system import AbstractState
from .errors import ScenarioError, each_of, key_error
from .grounds import GROUNDS, read_ground
from .mechanisms import MOST_EXPONENT
from .motions import FRAME, HARMONIC_FORCE
from .own import FUNCTION, Open, Parts, module_of, modules_of, names_own, read_open, read_own, trying, trying_class
from .table import (
    Family,
    Key,
    Module,
    join,
    keys_of,
    read_by_name,
    read_family,
    read_one_of,
    read_table,
    write_family,
    write_member,
)
from .values import (
    Integer,
    Names,
    Nested,
    Numbers,
    Text,
    WholeNumber,
    namespace,
    require,
    require_conditions,
    unread,
)

if TYPE_CHECKING:
    from .scenario import Scenario

SHAPES = Open(
    AbstractShape,
    {"ellipsoid": module_of(Ellipsoid), "function": module_of(SupportFunction, keys=FUNCTION)},
    lambda shape: require_function("shape", shape.height, (), Gamma=a_vector()),
)


SHAPE = Nested(
    functools.partial(read_open, family=SHAPES), functools.partial(write_family, family=SHAPES), tables=keys_of(SHAPES)
)


def _check_resistance(values: dict[str, Any], path: str) -> None:
    problem = find_contradiction(values, lambda name: join(path, name))
    if problem is not None:
        raise ScenarioError(f"Key {problem}")


RESISTANCE = module_of(Resistance, keys={"exponent": Key(Integer(1, MOST_EXPONENT), 2)}, check=_check_resistance)


RESISTANCES = Open(AbstractResistance, {"": RESISTANCE})


def read_resistance(values: Any, path: str) -> AbstractResistance:
    """Reads the coefficients of resistance, or a user's class."""
    if names_own(values):
        return read_own(values, path, RESISTANCES)
    resistance = RESISTANCE.read(values, path)
    require_conditions(resistance)
    return resistance


FRICTIONS = Open(AbstractFriction, modules_of({"smoothed-coulomb": SmoothedCoulomb, "limit-surface": LimitSurface}))


def _read_friction(value: Any, path: str) -> Any:
    """Reads the coefficient of friction, or a law that has it for each slip speed."""
    if names_own(value):
        return read_own(value, path, FRICTIONS)
    if not isinstance(value, dict):
        return _COEFFICIENT.read(value, path)
    friction = read_family(value, path, FRICTIONS)
    require_conditions(friction)
    return friction


def _write_friction(value: Any, path: str) -> Any:
    return (
        write_family(value, path, FRICTIONS) if isinstance(value, AbstractFriction) else _COEFFICIENT.write(value, path)
    )


_COEFFICIENT = Numbers()
_FRICTION = Nested(_read_friction, _write_friction, _COEFFICIENT.words, keys_of(FRICTIONS), others=(_COEFFICIENT,))


def _law(friction: Any, static_friction: Any = None, *, capacity: int, **others: Any) -> Contact:
    """Makes the law of contact without the checks of its constructor, because a reader reports these in the words of
    the file.
    """
    is_law = isinstance(friction, AbstractFriction)
    at_rest = friction(jnp.zeros(())) if is_law else friction
    static = at_rest if static_friction is None else static_friction
    values = {"friction": at_rest, "static_friction": static, **others}
    arrays = [to_array(values[name], name) for name in COEFFICIENTS]
    # The constructor checks numbers in words of Python; what it is given here is valid, and replaced below.
    law = Contact(friction if is_law else 0.0, capacity=capacity)
    return eqx.tree_at(lambda law: [getattr(law, name) for name in COEFFICIENTS], law, arrays)


CONTACT = module_of(
    Contact,
    keys={
        "friction": Key(
            _FRICTION, says="the kinetic coefficient of friction μ, or a law that has it for each slip speed"
        ),
        "static_friction": Key(
            Numbers(), None, says="the static coefficient of friction μ_s, `friction` or more; that if not given"
        ),
        "capacity": Key(Integer(1, 10**6), DEFAULT_CAPACITY),
    },
    build=_law,
    attributes={"friction": "friction_or_law"},
)


def read_contact(values: Any, path: str) -> Contact:
    """Reads the law of contact."""
    contact = CONTACT.read(values, path)
    require_conditions(contact)
    return contact


def check_contact(contact: Contact, path: str, system: AbstractBody) -> None:
    """Raises a :class:`ScenarioError` for a law of contact that cannot be solved with a body."""
    if (rival := find_rival(system, contact)) is not None:
        raise ScenarioError(f"Key `{join(path, 'friction')}` must be no limit surface where there is {rival}.")


def rolling_state(scenario: "Scenario", what: str, error: type[ScenarioError] = ScenarioError) -> AbstractState:
    """Returns the state of a scenario, for ``what`` (with its verb), which is for bodies that always roll, without
    feedback.

    **Raises:** ``error`` where the scenario has a law of contact, feedback, or an event that ends its run.
    """
    if scenario.may_slip:
        raise error(
            f"Key `contact` must be left out here, because {what} for bodies that always roll; `jaxball simulate` and "
            "studies accept it."
        )
    require_whole_run(scenario, what, error)
    assert not isinstance(scenario.state, ReleasedState)  # which exists only with a law
    return scenario.state


def require_whole_run(scenario: "Scenario", what: str, error: type[ScenarioError] = ScenarioError) -> None:
    """Refuses feedback, and events that end a run, for ``what`` (with its verb)."""
    if scenario.feedback is not None:
        raise error(
            f"Key `feedback` must be left out here, because {what} for runs without sampled feedback; `jaxball "
            "simulate` and `jaxball track` accept it."
        )
    for name, event in scenario.events.items():
        if event.terminal:
            raise error(
                f"Key `events.{name}.terminal` must be false here, because {what} for runs that no event ends; "
                "`jaxball simulate` and studies accept it."
            )


FLAT = "in the plane of a disk, E1 and E3, with second entry 0"
BODIES: Family = {
    name: module_of(body, {AbstractShape: SHAPE}, required=("radius", "gravity"))
    for name, body in {"ball": Ball, "disk": Disk, "convex-body": ConvexBody}.items()
}
FORCES = Open(AbstractWrench, {"": HARMONIC_FORCE, "function": module_of(FunctionWrench, keys=FUNCTION)})


def _check_names(values: dict[str, Any], path: str) -> None:
    names = values["names"]
    if not all(names) or len(set(names)) < len(names):
        raise key_error(join(path, "names"), "a list of names, each of them once", str(list(names)))
    if values["units"] is not None and len(values["units"]) != len(names):
        raise key_error(join(path, "units"), "a list with one for each of `names`", str(list(values["units"])))


OWN_STATES = Module(
    OwnStates,
    {
        "names": Key(Names()),
        "units": Key(Names(words="a list of dimensions or units"), None),
        **FUNCTION,
        "kink_times": Key(Numbers((None,), dimension=TIME), ()),
    },
    check=_check_names,
)


def _read_own_states(values: Any, path: str) -> OwnStates:
    with trying(join(path, "function")):
        return OWN_STATES.read(values, path)


def check_own_states(system: System, start: Any, state: BallState | DiskState) -> None:
    """Raises unless a user's function gives a rate for each state of one's own of the body."""
    with trying("own_states.function"):
        jax.eval_shape(system.own_rates, start, state)


def read_shell(values: Any, path: str, kind: str) -> dict[str, Any]:
    """Reads the arguments of a body for its shell. An impossible shell raises."""
    shell = read_table(values, path, BODIES[kind].keys)
    # Built for its conditions alone: the shell is an argument of the body with its masses later.
    system = BODIES[kind].type(**shell)
    require_conditions(system, under=f"{path}.")
    return shell


def read_force(values: Any, path: str, kind: str) -> AbstractWrench:
    """Reads the external force: a user's class or function, or a series, which on a disk must lie in the
    disk's plane.
    """
    if names_own(values):
        return read_own(values, path, FORCES)
    choices = {name: force.keys for name, force in FORCES.items() if name}
    if read_one_of(values, path, choices, HARMONIC_FORCE.keys)[0]:
        with trying(join(path, "function")):
            return FORCES["function"].read(values, path)
    force = HARMONIC_FORCE.read(values, path)
    for name in ("constant", "amplitude", "powers"):
        array = getattr(force.series, name)
        if array is None:
            continue
        flat = kind != "disk" or (namespace(array).asarray(array)[..., 1] == 0).all()
        require(flat, join(path, name), FLAT, lambda name=name: repr(values[name]))
    return force


def read_surroundings(document: dict[str, Any], kind: str) -> dict[str, Any]:
    """Reads the arguments of a body for external loads, if the document has them; a plate as a ``ReadPlate``."""
    tables = {
        "force": lambda values, path: read_force(values, path, kind),
        "ground": lambda values, path: read_ground(values, path, kind),
        "resistance": read_resistance,
        "own_states": _read_own_states,
    }
    present = {name: functools.partial(read, document[name], name) for name, read in tables.items() if name in document}
    return dict(zip(present, each_of(*present.values()), strict=True))


def check_force(force: AbstractWrench | None, path: str, coordinates: int, own: int) -> None:
    """Raises unless a user's function or class returns a force on a body with this number of ``coordinates``,
    and of states of its ``own``.
    """
    if isinstance(force, FunctionWrench):
        with trying(join(path, "function")):
            require_wrench("function", force, coordinates, own)
    elif force is not None and not isinstance(force, HarmonicForce):
        with trying_class(path, type(force).__name__):
            require_wrench("wrench", force, coordinates, own)


_SURROUNDINGS: dict[str, Family] = {
    "force": FORCES,
    "ground": GROUNDS,
    "resistance": RESISTANCES,
    "own_states": {"": OWN_STATES},
}


def write_body(system: System) -> dict[str, Any]:
    """Returns the table [body], and [force], [ground], [resistance] and [own_states] where these exist."""
    kind = kind_of(system)
    return {
        "body": BODIES[kind].write(system, "body"),
        **write_surroundings({name: getattr(system, name) for name in _SURROUNDINGS}),
    }


def write_surroundings(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the tables [force], [ground] … for the ``parts`` that are not None, by their names."""
    tables = {}
    for name, part in parts.items():
        if part is None:
            continue
        family = _SURROUNDINGS[name]
        kind, table = write_member(part, name, family)
        if kind not in family or (kind and family is GROUNDS):
            tables[name] = {"kind": kind, **table}
            continue
        first, key = next(iter(family[kind].keys.items()))
        tables[name] = table or {
            first: key.kind.write(key.default, name)
        }  # an empty table would be left out like one that is missing
    return tables


def kind_of(system: System) -> str:
    """Returns the name of the kind of body in a file, such as ``ball``.

    **Raises:** :class:`ScenarioError` for another, which no file can hold.
    """
    for kind, body in BODIES.items():
        if isinstance(system, body.type):
            return kind
    raise ScenarioError(
        f"Key `body.kind` must be {one_of(tuple(BODIES))} in a file, but the system is a {type(system).__name__}; keep "
        "the Python program that makes it."
    )


_PART = Text("the name of a part of the body, such as masses[0] or mechanisms[0].joints[0]")
_ERRORS = Module(
    SensorErrors,
    {
        "noise": Key(Numbers(rule=NOT_NEGATIVE), 0.0),
        "bias": Key(Numbers((None,)), (0.0,)),
        "random_walk": Key(Numbers(rule=NOT_NEGATIVE), 0.0),
        "rate": Key(Numbers(rule=POSITIVE), None),
        "delay": Key(Numbers(rule=NOT_NEGATIVE, dimension=TIME), 0.0),
        "missing": Key(Numbers(rule=BETWEEN_0_AND_1._replace(phrase="")), 0.0),
        "seed": Key(WholeNumber(0, 2**31 - 1), 0),
    },
)
_PARTS: Parts = {AbstractFrame: FRAME.kind, SensorErrors: _ERRORS.nested}
_MOUNTED = {"accelerometer": Accelerometer, "gyroscope": Gyroscope, "position": Position}
_SENSORS: Family = {
    **{name: module_of(sensor, _PARTS, keys={"on": Key(_PART, None)}) for name, sensor in _MOUNTED.items()},
    "encoder": module_of(Encoder, _PARTS, keys={"on": Key(_PART)}),
    "tachometer": module_of(Tachometer, _PARTS, keys={"on": Key(_PART)}),
}
SENSORS = Open(AbstractSensor, _SENSORS, parts=_PARTS)


def read_sensors(values: Any, path: str) -> dict[str, AbstractSensor]:
    """Reads the sensors by their names, which files and figures use."""
    return read_by_name(values, path, functools.partial(read_family, family=SENSORS))


def check_sensors(sensors: Mapping[str, AbstractSensor], path: str, system: AbstractBody) -> None:
    """Raises where the body lacks the part that a sensor is on."""
    for name, sensor in sensors.items():
        try:
            sensor.require_on(system, join(path, name))
        except ValueError as error:
            raise ScenarioError(str(error).replace("Argument ", "Key ", 1)) from None


def write_sensors(sensors: Mapping[str, AbstractSensor], path: str) -> dict[str, Any]:
    """Returns the tables of the sensors by name."""
    return {name: write_family(sensor, join(path, name), SENSORS) for name, sensor in sensors.items()}


KEYS = {
    "body": Key(unread(tables=keys_of(BODIES)), says="the shell and gravity"),
    "force": Key(unread(tables=keys_of(FORCES), own=True), None, says="an external force at the geometric centre"),
    "ground": Key(
        unread(tables=keys_of(GROUNDS)),
        None,
        says="the tilt and motion of the plane, or a surface; a level plane at rest if not given",
    ),
    "resistance": Key(unread(tables=keys_of(RESISTANCES), own=True), None, says="friction against rolling, and drag"),
    "own_states": Key(
        unread(tables={"": OWN_STATES.keys}), None, says="states of your own beside the body, such as those of a drive"
    ),
    "contact": Key(
        unread(tables={"": CONTACT.keys}),
        None,
        says="friction and impact, with which the body can slip and fly; if not given, it always rolls",
    ),
    "sensors": Key(
        unread("a table of tables", keys_of(SENSORS), forms=("by name",)),
        None,
        says="sensors, each under [sensors.name]",
    ),
}
