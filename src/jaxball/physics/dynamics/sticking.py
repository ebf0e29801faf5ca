"""Which joints of a body dry friction or a hard stop holds at rest, and which way the others slip.

A joint with :class:`~jaxball.JointFriction` slips in the direction 1 or −1, or sticks, 0. A solve knows these
directions (``contact.guards``). From a state alone they follow: a joint that moves slips, and one at rest sticks unless
friction would have to exceed its largest level for that. One with :class:`~jaxball.HardStops` is held, 0, where it is
pressed on a stop (``stops``); without friction it has the direction 1 as long as it is free, wherever it goes.
Directions are in the order of :func:`sticking_slots`.
"""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..mechanisms import AbstractMechanism
from ..state import State
from .coupling import Joints
from .law import load, release
from .parameters import BodyParameters
from .stops import Stops, guard_of_gap, has_stops, largest_frictions, rubs, sides, slack_of_effort

AnyParameters = TypeVar("AnyParameters", bound=BodyParameters)


def sticking_slots(system: BodyParameters) -> Int[np.ndarray, " sticking"]:
    """Returns the indices in a state's ``theta`` of the joints that friction or a stop may hold."""
    items = zip(system.mechanism_groups, system.mechanism_order, strict=True)
    slots = [
        system.slots(order, group.free)[:, list(group.holdable)].ravel() for group, order in items if group.holdable
    ]
    return np.concatenate([np.zeros(0, dtype=int), *slots])


def has_directions(system: BodyParameters) -> bool:
    """Returns whether it is known of all joints that may be held in which direction they slip."""
    laws = (law for group in system.mechanism_groups for law in (*group.frictions.values(), *group.stops.values()))
    return all(law.direction is not None for law in laws)


def with_directions(system: AnyParameters, directions: Float[Array, " sticking"]) -> AnyParameters:
    """Returns the same body where the joints slip in these directions, or stick, 0."""
    groups, start = [], 0
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        end = start + len(order) * len(group.holdable)
        if group.holdable:
            slips = jnp.reshape(directions[start:end], (len(order), -1))
            group = eqx.filter_vmap(lambda mechanism, slips: mechanism.slipping(slips))(group, slips)
        groups.append(group)
        start = end
    return eqx.tree_at(lambda body: body.mechanism_groups, system, tuple(groups))


def sticking_joints(group: AbstractMechanism) -> Bool[Array, "mechanisms free"] | None:
    """Finds which free joints of a group are held; None where nothing may hold one."""
    if not group.holdable:
        return None
    loose = jnp.zeros(group.mass.shape[0], bool)
    columns = [loose for _ in group.free]
    for place, law in (group.stops | group.frictions).items():
        assert law.direction is not None
        columns[place] = law.direction == 0
    return jnp.stack(columns, axis=-1)


def of_sticking(system: BodyParameters, values: Joints) -> Float[Array, " sticking"]:
    """Selects the entries of the joints that may be held from the entries of all free joints."""
    groups = (group for group in system.mechanism_groups if group.free)
    return jnp.concatenate(
        [
            jnp.ravel(group_values[:, list(group.holdable)])
            for group, group_values in zip(groups, values, strict=True)
            if group.holdable
        ]
    )


def among_free(system: BodyParameters, values: Float[Array, " sticking"]) -> Joints:
    """Returns entries of all free joints: 0, and the values of those that may be held."""
    joints, start = [], 0
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        end = start + len(order) * len(group.holdable)
        if group.free:
            entries = jnp.reshape(values[start:end], (len(order), len(group.holdable)))
            columns = [jnp.zeros(len(order), values.dtype) for _ in group.free]
            for which, place in enumerate(group.holdable):
                columns[place] = entries[:, which]
            joints.append(jnp.stack(columns, axis=-1))
        start = end
    return joints


def directions_of(system: BodyParameters, state: State) -> Float[Array, " sticking"]:
    """Returns the directions of a state in which all that rests is held, whether friction and stops can do it or not.

    A joint that moves to a stop which it touches is not held: it strikes the stop.
    """
    slots = sticking_slots(system)
    directions = jnp.sign(state.thetadot[slots])
    if not has_stops(system):
        return directions
    rests = (directions == 0) & (rubs(system) | (Stops.of(system).find_touched(state.theta[slots]) != 0))
    return jnp.where(rests, 0.0, _moving(system, directions))


def _moving(system: BodyParameters, directions: Float[Array, " sticking"]) -> Float[Array, " sticking"]:
    """Returns the directions of joints that move: 1 of those without friction."""
    return jnp.where(rubs(system), directions, 1.0) if has_stops(system) else directions


def release_joints(
    system: AnyParameters,
    t: Float[Array, ""],
    state: State,
    holding: Callable[[AnyParameters], Float[Array, " sticking"]],
) -> Float[Array, " sticking"]:
    """Releases every joint at rest that friction and stops cannot hold, the most overloaded one first, and returns the
    directions then.

    ``holding`` gives the effort that would hold the joints that are held, in a body with directions.
    """

    def weigh(directions: Float[Array, " sticking"]) -> tuple[Array, Array]:
        effort = holding(with_directions(system, directions))
        return overloads(system, t, state, directions, effort), effort

    def let_go(directions: Array, effort: Array, off: Array) -> Array:
        return loosen(system, directions, effort, off)

    directions = directions_of(system, state)
    return release(directions, weigh, let_go, jnp.zeros(directions.size, bool))


def levels(
    system: BodyParameters, t: Float[Array, ""], state: State, directions: Float[Array, " sticking"]
) -> tuple[Float[Array, " sticking"], Float[Array, " sticking"]]:
    """Returns the largest positive and negative efforts that hold the joints: those of friction, or any of a stop."""
    largest = largest_frictions(system)
    if not has_stops(system):
        return largest, largest
    side, slack = sides(system, directions, state.theta[sticking_slots(system)]), slack_of_effort(system, t, state)
    largest = jnp.where(rubs(system), largest, slack)
    return jnp.where(side < 0, jnp.inf, largest), jnp.where(side > 0, jnp.inf, largest)


def overloads(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    directions: Float[Array, " sticking"],
    effort: Float[Array, " sticking"],
) -> Float[Array, " sticking"]:
    """Returns the loads of joints that are held although friction and stops cannot do it; −∞ of others."""
    up, down = levels(system, t, state, directions)
    largest = up if up is down else jnp.where(effort > 0, up, down)
    return jnp.where((directions == 0) & (jnp.abs(effort) > largest), load(effort**2, largest), -jnp.inf)


def loosen(
    system: BodyParameters,
    directions: Float[Array, " sticking"],
    effort: Float[Array, " sticking"],
    off: Bool[Array, " sticking"],
) -> Float[Array, " sticking"]:
    """Returns the directions after some joints have broken loose, against the effort that held them."""
    return jnp.where(off, _moving(system, -jnp.sign(effort)), directions)


def sticking_guards(
    system: BodyParameters,
    t: Float[Array, ""],
    state: State,
    directions: Float[Array, " sticking"],
    holding: Float[Array, " sticking"],
) -> Float[Array, " guards"]:
    """Computes two guards for each joint. Where it is held, what there is to spare against positive efforts, and
    against negative ones. Where it slips, θ̇ in its direction, and the gap to the stop ahead, 1 without one; if it has
    no friction, the gaps to the upper and to the lower stop.
    """
    sticks, (up, down), slots = directions == 0, levels(system, t, state, directions), sticking_slots(system)
    onward, ahead = directions * state.thetadot[slots], 1.0
    # Two guards for a held joint: which of them falls says in which direction it breaks loose.
    spare = up - holding, down + holding
    if has_stops(system):
        moved, upward, slides = (state.theta[slots], state.thetadot[slots]), jnp.ones_like(holding), rubs(system)
        onward = jnp.where(slides, onward, guard_of_gap(system, *moved, upward))
        ahead = guard_of_gap(system, *moved, jnp.where(slides & (directions > 0), upward, -upward))
        spare = [jnp.where(jnp.isfinite(level), x, 1.0) for level, x in zip((up, down), spare, strict=True)]
    return jnp.concatenate([jnp.where(sticks, spare[0], onward), jnp.where(sticks, spare[1], ahead)])


def change_joint(
    system: BodyParameters,
    directions: Float[Array, " sticking"],
    thetadot: Float[Array, " rates"],
    which: Int[Array, ""],
) -> tuple[Float[Array, " sticking"], Float[Array, " rates"]]:
    """Returns directions and θ̇ after one of :func:`sticking_guards`: a joint that slipped is held, and one that was
    held slips. One that has turned back, as while the end of a slip was followed, is held, too.

    - ``which``: the index of the guard; negative where it is none of these, and nothing changes.
    """
    joints = np.arange(directions.size)
    changes, sticks = (joints == which % joints.size) & (which >= 0), directions == 0
    # The first guard of a held joint is what friction has to spare against positive forces, the second against negative
    # ones.
    loose = jnp.where(which < joints.size, -1.0, 1.0)
    stops = ~sticks & (changes | (directions * thetadot[sticking_slots(system)] < 0))
    if has_stops(system):
        stops, loose = stops & rubs(system), jnp.where(rubs(system), loose, 1.0)
    after = jnp.where(stops, 0.0, jnp.where(changes & sticks, loose, directions))
    rests = jnp.any(_slots_of(system, thetadot) & (after == 0)[None], axis=1)
    return after, jnp.where(rests, 0.0, thetadot)


def put(
    system: BodyParameters,
    coordinates: Float[Array, " coordinates"],
    which: Bool[Array, " sticking"],
    values: Float[Array, " sticking"],
) -> Float[Array, " coordinates"]:
    """Returns θ or θ̇ with the values of some joints among those that may be held."""
    there = _slots_of(system, coordinates) & which[None]
    return jnp.where(jnp.any(there, axis=1), jnp.sum(jnp.where(there, values[None], 0.0), axis=1), coordinates)


def _slots_of(system: BodyParameters, coordinates: Float[Array, " coordinates"]) -> Bool[Array, "coordinates sticking"]:
    """Returns the places of the joints that may be held among all coordinates."""
    slots = sticking_slots(system)
    places = np.zeros((coordinates.size, slots.size), dtype=bool)
    places[slots, np.arange(slots.size)] = True
    return jnp.asarray(places)
