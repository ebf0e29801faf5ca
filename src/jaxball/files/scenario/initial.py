"""Reads and writes the initial state of a scenario file."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ... import programs
from ...interface.compat import is_traced
from ...interface.wording import all_of, number_of
from ...numerics.arrays import to_array
from ...numerics.declare import ANGLE, LENGTH, NOT_ALL_ZERO, RATE, VELOCITY, Rule
from ...numerics.vectors import length
from ...physics.body import Ball, Disk, System
from ...physics.contact.released import ReleasedState
from ...physics.dynamics.parameters import PointMass
from ...physics.grounds.ground import Ground
from ...physics.own_states import OwnStates
from ...physics.prescribed.schedules import AbstractSchedule
from ...physics.state import BallState, DiskState, State
from .errors import ScenarioError, UntraceableError, key_error
from .mechanisms import ReadMechanism, joints_in_state
from .table import Key, join, read_one_of, read_table, write_table
from .values import Flag, Indices, Nested, Numbers, namespace, outside_of_traces, require

_BALANCE_KEYS = {
    "masses": Key(Indices(), says="the masses on rails whose θ is computed"),
    "above": Key(
        Flag(),
        None,
        says="whether the centre of mass is above the geometric centre, on a slope whether it is higher; either if not "
        "given",
    ),
}
_BALANCE = Nested(
    lambda values, path: read_table(values, path, _BALANCE_KEYS),
    lambda table, path: write_table(table, path, _BALANCE_KEYS),
    tables={"": _BALANCE_KEYS},
)
_DRIVEN = {
    "theta": Key(
        Numbers((None,), dimension=ANGLE),
        None,
        says="one for each mass that a feedback law drives, and then for each joint without a schedule of its own; "
        "those of "
        "the schedules to follow, or 0, if not given",
    ),
    "thetadot": Key(Numbers((None,), dimension=RATE), None, says="the rate of each of `theta`; likewise if not given"),
    "balance": Key(
        _BALANCE,
        None,
        says="masses whose θ is computed so that the centre of mass is over or under the geometric centre",
    ),
    "own": Key(Numbers((None,)), None, says="one for each of `own_states.names`; 0 if not given"),
}
_ABOVE = Rule("non-negative", lambda x: (x >= 0).all(), ", because a lower body would be inside the plane")
# Of a body that need not roll.
_RELEASED = {
    "velocity": Key(
        Numbers((3,), dimension=VELOCITY),
        None,
        says="with `contact`, the velocity of the geometric centre in space axes, whose second is 0 for a disk; that "
        "of rolling "
        "if not given, or 0 with `height`",
    ),
    "height": Key(
        Numbers((), _ABOVE, LENGTH),
        None,
        says="with `contact`, the height of the body above the ground, on a surface along the normal at `z`; 0 if not "
        "given",
    ),
}
VERSOR = {
    "versor": Key(
        Numbers((4,)), (1.0, 0.0, 0.0, 0.0), says="the rotation from body to space, of length 1, the real part first"
    )
}
AXIS_AND_ANGLE = {
    "axis": Key(
        Numbers((3,), NOT_ALL_ZERO), says="the axis of the rotation, of any length; with `angle`, instead of `versor`"
    ),
    "angle": Key(Numbers(dimension=ANGLE), says="the angle of the rotation, with `axis`"),
}
OMEGA = {"Omega": Key(Numbers((3,), dimension=RATE), (0.0, 0.0, 0.0), says="the angular velocity Ω in body axes")}
_CENTRE = "the position of the geometric centre, on a surface the coordinates of the contact point"
PLACE = {"z": Key(Numbers((2,), dimension=LENGTH), (0.0, 0.0), says=_CENTRE)}
_MOVING = {**OMEGA, **PLACE, **_RELEASED, **_DRIVEN}
_CHOICES = {"versor": {**VERSOR, **_MOVING}, "axis": {**AXIS_AND_ANGLE, **_MOVING}}
_DISK = {
    "phi": Key(Numbers(dimension=ANGLE), 0.0, says="φ, from e1 to E1"),
    "phidot": Key(Numbers(dimension=RATE), 0.0, says="φ̇; with φ̇ > 0 it rolls towards −e1"),
    "z": Key(Numbers(dimension=LENGTH), 0.0, says=_CENTRE),
    **_RELEASED,
    **_DRIVEN,
}
_BALL = {**_CHOICES["versor"], **_CHOICES["axis"]}
INITIAL = {"ball": _BALL, "disk": _DISK, "convex-body": _BALL}
UNIT_SQUARE = 1e-6


def read_initial(values: Any, path: str, kind: str) -> dict[str, Any]:
    """Reads the arguments of a state (for driven masses only those given), ``balance``, and how it is released.

    The velocity of a disk lies in its plane.
    """
    if kind != "disk":
        return read_orientation(*read_one_of(values, path, _CHOICES, otherwise=_MOVING), path)
    table = read_table(values, path, _DISK)
    if table["velocity"] is not None:
        must = "in the plane of a disk, e1 and e3, with second entry 0"
        require(table["velocity"][1] == 0, join(path, "velocity"), must, lambda: repr(values["velocity"]))
    return table


def read_orientation(choice: str, table: dict[str, Any], path: str) -> dict[str, Any]:
    """Returns ``table`` with the versor ``q`` in place of an axis and an angle, or of the key ``versor``."""
    if choice == "axis":
        axis, half = table.pop("axis"), table.pop("angle") / 2
        xp = namespace(axis, half)
        table["q"] = xp.stack([xp.cos(half), *(xp.sin(half) * (axis / _length(axis)))])
    elif choice == "versor":
        table["q"] = _unit(table.pop("versor"), join(path, "versor"))
    return table


def _unit(q: Any, path: str) -> Any:
    """Returns a versor, normalised only where it is off by more than rounding, so that it is read as it was written."""
    size = _length(q)
    must = "a versor, whose four numbers have squares that add up to 1"
    require(abs(size - 1) <= UNIT_SQUARE, path, must, lambda: str(q.tolist()))
    # A traced one is always normalised, because its derivatives are to be those of a unit vector.
    return q / size if is_traced(size) or abs(size - 1) >= 1e-15 else q


def _length(x: Any) -> Any:
    """Computes |x|, also where the squares overflow."""
    if not is_traced(x):
        return length(x)
    # The scale cancels, so that its derivative must not count.
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(x)))
    return largest * jnp.sqrt(jnp.sum((x / largest) ** 2))


def initial_state(
    fields: dict[str, Any],
    path: str,
    kind: str,
    coordinates: Sequence[str],
    targets: Sequence[AbstractSchedule | None],
    start: Any,
    own_states: OwnStates | None = None,
) -> BallState | DiskState:
    """Builds the state; θ and θ̇ of its ``coordinates`` are those of their schedules, or 0, unless they are given, and
    states of one's own are 0 unless they are given.
    """
    fields = {name: value for name, value in fields.items() if name not in ("balance", *_RELEASED)}
    for name in ("theta", "thetadot"):
        values = fields[name]
        if values is None:
            fields[name] = _starting(name, targets, start)
        elif len(values) != len(coordinates):
            joints = any(not path.startswith("masses") for path in coordinates)
            each = f"those of {all_of(coordinates)}" if joints else "one for each mass that a law drives"
            must = f"a list of {number_of(len(coordinates), 'number')}, {each}"
            raise key_error(join(path, name), must, f"one of {len(values)}")
    names = () if own_states is None else own_states.names
    if fields["own"] is None:
        fields["own"] = (0.0,) * len(names) if names else None
    elif len(fields["own"]) != len(names):
        must = f"a list of {number_of(len(names), 'number')}, those of `own_states.names`"
        raise key_error(join(path, "own"), must, f"one of {len(fields['own'])}")
    return (DiskState if kind == "disk" else BallState)(**fields)


def release(
    fields: dict[str, Any], path: str, state: BallState | DiskState, may_slip: bool
) -> BallState | DiskState | ReleasedState:
    """Releases the state, with the velocity and the height that are given, or 0; a body that rolls keeps its state.

    Only a body that ``may_slip`` can be, by a law of contact.
    """
    released = {name: fields[name] for name in _RELEASED if fields[name] is not None}
    if not released:
        return state
    if not may_slip:
        does = "slides without a law of friction" if "height" not in released else "lands without a law of impact"
        raise ScenarioError(
            f"Key `{join(path, next(iter(released)))}` needs a table [contact], because otherwise the body {does}; "
            "give one, such as `contact = { friction = 0.3 }`."
        )
    return ReleasedState(state, V=released.get("velocity", (0.0, 0.0, 0.0)), height=released.get("height", 0.0))


def _starting(name: str, targets: Sequence[AbstractSchedule | None], start: Any) -> Any:
    """Returns θ or θ̇ of each target at the start, 0 where there is no target."""
    places = [place for place, target in enumerate(targets) if target is not None]
    if not places:
        return (0.0,) * len(targets)
    values = starting_angles(tuple(target for target in targets if target is not None), to_array(start))[name]
    if len(places) == len(targets):
        return values
    rest = [jnp.zeros_like(values[0])] * len(targets)
    for place, value in zip(places, values, strict=True):
        rest[place] = value
    return jnp.stack(rest)


@programs.jit
def starting_angles(
    schedules: tuple[AbstractSchedule, ...], t: Float[ArrayLike, ""]
) -> dict[str, Float[Array, " schedules"]]:
    """Computes θ and θ̇ of one or more schedules at ``t``, by name; compiled once for schedules of the same kinds."""
    rates = [schedule.derivatives(jnp.asarray(t)) for schedule in schedules]
    return {"theta": jnp.stack([rate[0] for rate in rates]), "thetadot": jnp.stack([rate[1] for rate in rates])}


def balance_schedules(
    masses: list[PointMass],
    mechanisms: Sequence[ReadMechanism],
    shell_and_ground: dict[str, Any],
    fields: dict[str, Any],
    path: str,
    kind: str,
    start: Any,
) -> list[PointMass]:
    """Shifts the schedules of masses so that the body starts in balance, as the ``fields`` of the state ask for.

    ``shell_and_ground`` has the numbers of the shell, and the ground.
    """
    request = fields["balance"]
    # Imported here, because few files need it, and its imports take long.
    from ...simulation.equilibrium import balance, with_angles

    path = join(path, "balance")
    if kind == "convex-body":
        raise ScenarioError(f"Key `{path}` must be left out of a convex body; give `initial.theta` instead.")
    on_rails = [index for index, item in enumerate(masses) if item.schedule is not None]
    if not set(request["masses"]) <= set(on_rails):
        raise key_error(join(path, "masses"), f"masses on rails, which are {on_rails}", str(list(request["masses"])))
    if fields["theta"] is not None:
        raise ScenarioError(f"Key `{path}` must not be combined with `theta`, because it finds the angles.")
    ground = shell_and_ground["ground"]
    if isinstance(ground, Ground) and ground.moves:
        raise ScenarioError(
            f"Key `{path}` must not be combined with `ground.{ground.moves}`, because it is for a plane at rest."
        )
    for index, item in enumerate(masses):
        if item.rail is not None and item.schedule is None:
            must = f"masses with schedules, but `masses[{index}]` has none; give `initial.theta` instead"
            raise ScenarioError(f"Key `{path}` must name {must}.")
    # Without a law: balance needs positions only, and a law would need the state that is still to be found.
    still = [item.without_law() for item in mechanisms]
    system = (Disk if kind == "disk" else Ball)(**shell_and_ground, masses=masses, mechanisms=still)
    targets = [joint.target for joint in joints_in_state(mechanisms)]
    state = initial_state({**fields, "thetadot": None, "own": None}, path, kind, system.coordinates, targets, start)
    # A search for a balance is not traced: the numbers on which it depends must be known.
    try:
        answer = outside_of_traces(
            lambda: balance(system, request["masses"], above=request["above"], state=state, t=start)
        )
    except jax.errors.JAXTypeError:
        raise UntraceableError(
            f"Key `{path}` must not depend on a number that changes; give the angles of the masses instead."
        ) from None
    if not answer.ok:
        raise ScenarioError(f"Key `{path}` has no solution: {answer.message}")
    return list(with_angles(system, request["masses"], answer.theta, start).point_masses)


def write_initial(system: System, state: State | ReleasedState) -> dict[str, Any]:
    """Returns the table [initial].

    **Raises:** :class:`ScenarioError` for a state that is not that of a ball with a versor or of a disk.
    """
    released: dict[str, Any] = dict.fromkeys(_RELEASED)
    if isinstance(state, ReleasedState):
        released, state = {"velocity": state.V, "height": state.height}, state.body
    if not isinstance(state, BallState | DiskState):
        must = "a BallState or a DiskState to be written to a file"
        raise key_error("initial", must, f"a {type(state).__name__}")
    # A file has no key for an empty list.
    driven = {name: getattr(state, name) if system.coordinates else None for name in ("theta", "thetadot")}
    driven["own"] = state.own
    if isinstance(state, DiskState):
        fields = {name: getattr(state, name) for name in ("phi", "phidot", "z")}
        return write_table({**fields, **released, **driven, "balance": None}, "initial", _DISK)
    fields = {"versor": state.q, "Omega": state.Omega, "z": state.z, **released, **driven, "balance": None}
    return write_table(fields, "initial", _CHOICES["versor"])
