"""The contact of a run in its file: the modes over time, the switches between them, and the coefficients of the law."""

from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..numerics.arrays import to_array
from ..physics.contact_law import AbstractFriction, Contact
from ..physics.modes import Cause, Mode
from ..physics.released import ReleasedState
from ..simulation.history import NOWHERE, ContactHistory, Switches
from .variables import Variable

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
COEFFICIENTS = ("sliding", "static", "restitution", "slowest")

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
    arrays: Mapping[str, np.ndarray],
    attribute: Callable[[str, Callable[[Any], Any]], Any],
    states: Any,
    friction: AbstractFriction | None = None,
) -> ContactHistory:
    """The history in a file, whose attributes ``attribute`` reads by name; ``states`` are those of the body.

    ``friction`` is that of the law, if it is not one coefficient.
    """
    sliding, *others = (attribute(f"contact_{name}", float) for name in COEFFICIENTS)
    law = Contact(sliding if friction is None else friction, *others, room=attribute("contact_room", int))
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
