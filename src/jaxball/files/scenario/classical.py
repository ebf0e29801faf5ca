"""Classical systems, and users' own, in a scenario file: their parameters and initial states."""

from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...interface.compat import is_traced
from ...numerics.arrays import to_array
from ...numerics.declare import OF_MOMENTUM
from ...physics.classical import (
    AbstractAxis,
    AbstractLagrangianSystem,
    ChaplyginSleigh,
    EllipsoidState,
    FreeRigidBody,
    HarmonicAxis,
    HeavyTop,
    KnifeEdge,
    NonholonomicParticle,
    ParticleState,
    RigidBodyState,
    RollerRacer,
    RollingCoin,
    RollingEllipsoid,
    Snakeboard,
    SuslovProblem,
    VakonomicParticle,
    VakonomicState,
)
from ...physics.conditions import Condition
from ...physics.system import AbstractState, AbstractSystem
from .body import read_resistance, write_surroundings
from .errors import ScenarioError, key_error
from .initial import AXIS_AND_ANGLE, OMEGA, PLACE, VERSOR, read_orientation
from .motions import SERIES, WAVES, waves_of
from .own import Open, module_of, modules_of, trying_class
from .table import Key, Keys, join, read_one_of, read_table, write_member, write_table
from .values import Nested, Numbers, require_condition

_AMPLITUDE = Key(Numbers((None, 3)), (), says="a row for each sinusoid")
_AXIS = waves_of(HarmonicAxis, {"constant": Key(Numbers((3,))), **WAVES, "amplitude": _AMPLITUDE}, SERIES)
# A family of one, so that a FunctionAxis is refused by name when a file is written.
_XI = Nested(_AXIS.read, lambda item, path: write_member(item, path, {"harmonic": _AXIS})[1], tables={"": _AXIS.keys})


# Those of systems that are made with a Lagrangian, whose states are its coordinates and their rates.
LAGRANGIAN = modules_of(
    {
        "chaplygin-sleigh": ChaplyginSleigh,
        "knife-edge": KnifeEdge,
        "rolling-coin": RollingCoin,
        "snakeboard": Snakeboard,
        "roller-racer": RollerRacer,
    }
)
_REQUIRED = "mass", "gravity"
CLASSICAL = Open(
    AbstractSystem,
    {
        "free-rigid-body": module_of(FreeRigidBody),
        "heavy-top": module_of(HeavyTop, required=_REQUIRED),
        "suslov": module_of(SuslovProblem, {AbstractAxis: _XI}),
        "rolling-ellipsoid": module_of(RollingEllipsoid, required=_REQUIRED),
        "nonholonomic-particle": module_of(NonholonomicParticle),
        "vakonomic-particle": module_of(VakonomicParticle),
        **LAGRANGIAN,
    },
)

# What resists a system that rolls, in a table of its own, as for a ball.
RESISTED = ("rolling-ellipsoid",)

_VERSOR = {**VERSOR, **OMEGA}
_ORIENTED = {"versor": _VERSOR, "axis": {**AXIS_AND_ANGLE, **OMEGA}}
# The keys of states that begin with an orientation and Ω, besides these.
_BESIDE_ORIENTATION: dict[type[AbstractState], Keys] = {RigidBodyState: {}, EllipsoidState: PLACE}
_PARTICLE = module_of(ParticleState).keys
_PARTICLES = {
    ParticleState: _PARTICLE,
    VakonomicState: {**_PARTICLE, "multiplier": Key(Numbers(dimension=OF_MOMENTUM), None, says="λ; −y ẋ if not given")},
}


def _rest(system: type[AbstractLagrangianSystem]) -> Keys:
    """Returns the keys of a state of a system with a Lagrangian, which is at rest, with all coordinates 0, if not
    given.
    """
    n, names = len(system.coordinates), ", ".join(system.coordinates)
    says = {
        "q": f"the coordinates {names}, lengths and angles",
        "qdot": "their rates, which must fulfil the constraints",
    }
    return {name: Key(Numbers((n,)), (0.0,) * n, says[name]) for name in ("q", "qdot")}


# The keys of [initial] by the kind of the system.
INITIAL = {
    **{kind: {**_ORIENTED["versor"], **_ORIENTED["axis"]} for kind in ("free-rigid-body", "heavy-top", "suslov")},
    "rolling-ellipsoid": {**_ORIENTED["versor"], **_ORIENTED["axis"], **PLACE},
    "nonholonomic-particle": _PARTICLES[ParticleState],
    "vakonomic-particle": _PARTICLES[VakonomicState],
    **{kind: _rest(module.type) for kind, module in LAGRANGIAN.items()},
}


def read_classical(
    kind: str, body: Any, initial: Any, start: Any, resistance: Any = None
) -> tuple[AbstractSystem, AbstractState]:
    """Reads the system from the tables ``body`` and ``resistance`` and the state from the table ``initial`` at time
    ``start``.

    ``kind`` is a name in ``CLASSICAL``, or that of a user's class.

    **Raises:** :class:`ScenarioError` for impossible parameters and states.
    """
    module = CLASSICAL[kind] if kind in CLASSICAL else CLASSICAL.own(kind, "kind")
    system = module.read({} if body is None else body, "body")
    _refuse(system.conditions())
    if resistance is not None:
        read = read_resistance(resistance, "resistance")
        if read.holds:
            raise ScenarioError(
                "Key `resistance.exact` must be false for a rolling ellipsoid, which has no mode of rest; leave it out."
            )
        system = eqx.tree_at(lambda s: s.resistance, system, read, is_leaf=lambda leaf: leaf is None)
    state = _read_state(kind, system.state_type, {} if initial is None else initial)
    _refuse(state.conditions())
    try:
        system.require_state(state)
    except ValueError as error:
        raise ScenarioError(str(error).replace("Argument `state.", "Key `initial.")) from None
    # Here, because it evaluates the equations, which a state of another shape would break.
    _refuse(system.start_conditions(to_array(start), state), kind in CLASSICAL)
    if kind not in CLASSICAL:
        _require_rates(kind, system, to_array(start), state)
    return system, state


def write_classical(system: AbstractSystem, state: AbstractState) -> dict[str, Any]:
    """Returns the kind and the tables [body], [resistance] and [initial].

    **Raises:** :class:`ScenarioError` for a system that a file cannot hold: a user's own, or one with a function.
    """
    kind, body = write_member(system, "body", CLASSICAL)
    if type(state) in _BESIDE_ORIENTATION:
        keys = {**_VERSOR, **_BESIDE_ORIENTATION[type(state)]}
        named = {"versor" if name == "q" else name: value for name, value in vars(state).items()}
        initial = write_table(named, "initial", keys)
    elif kind not in CLASSICAL:
        initial = module_of(type(state)).write(state, "initial")
    else:
        keys = INITIAL[kind]
        initial = write_table({name: getattr(state, name) for name in keys}, "initial", keys)
    resistance = getattr(system, "resistance", None) if kind in RESISTED else None
    return {"kind": kind, "body": body, **write_surroundings({"resistance": resistance}), "initial": initial}


def _read_state(kind: str, state_type: type[AbstractState], values: Any) -> AbstractState:
    if state_type in _BESIDE_ORIENTATION:
        beside = _BESIDE_ORIENTATION[state_type]
        choices = {choice: {**keys, **beside} for choice, keys in _ORIENTED.items()}
        choice, table = read_one_of(values, "initial", choices, otherwise={**OMEGA, **beside})
        return state_type(**read_orientation(choice, table, "initial"))
    keys = INITIAL.get(kind, _PARTICLES.get(state_type))
    if keys is None:
        with trying_class("initial", state_type.__name__):
            return module_of(state_type).read(values, "initial")
    return state_type(**read_table(values, "initial", keys))


def _require_rates(kind: str, system: AbstractSystem, start: Any, state: AbstractState) -> None:
    """Raises unless ``field`` of a user's system returns the rate of each number of the state."""
    with trying_class("initial", kind):
        rates = jax.eval_shape(system.field, start, state)
    moved, state_shapes = ({name: np.shape(value) for name, value in vars(each).items()} for each in (rates, state))
    if moved != state_shapes:
        raise key_error(
            "initial",
            f"a state of the shapes that `field` of {kind} returns, {moved}",
            f"one of the shapes {state_shapes}",
        )


def _refuse(conditions: Iterable[Condition], builtin: bool = False) -> None:
    """Raises for the first condition that does not hold, with the path of its key; see ``require``.

    An error of a kind of its own, such as that about constraints, names the key or the part of the class itself. The
    parts of a ``builtin`` class fit all numbers but those that overflow.
    """
    for condition in conditions:
        if type(condition) is not Condition:
            if not is_traced(condition.holds):
                for problem in condition.problems():
                    table, _, name = problem.name.rpartition(".")
                    if builtin and not table:
                        raise key_error(
                            "initial",
                            "a state in which the equations of motion can be computed",
                            "one in which numbers here or in `body` are too large or too small",
                        )
                    raise ScenarioError(
                        problem.sentence("Key", f"initial.{name}") if table else problem.sentence("Part")
                    )
                continue
            condition = Condition(jnp.all(condition.holds), "constraints", condition.value, condition.must)
        table, _, name = str(condition.name).rpartition(".")
        require_condition(condition, join("initial" if table else "body", name))
