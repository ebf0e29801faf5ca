"""Which joints of a body dry friction or a hard stop holds at rest, and which way the others slip.

A joint with :class:`~jaxball.JointFriction` slips in the direction 1 or −1, or sticks, 0. A solve knows these
directions (``contact.guards``). From a state alone they follow: a joint that moves slips, and one at rest sticks unless
friction would have to exceed its largest level for that. One with :class:`~jaxball.HardStops` is held, 0, where it is
pressed on a stop; without friction it has the direction 1 as long as it is free, wherever it goes.
All arrays are in the order of :func:`sticking_slots`.

A joint without a stop has one at infinity. The side of a stop is 1 for the upper and −1 for the lower one. A joint is
held at a stop by whatever push that takes, inward, and, if it has dry friction, by that in both directions.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.vectors import root
from ..conditions import Condition
from ..mechanisms import AbstractMechanism, HardStops
from ..state import State
from .coupling import Joints, linkages
from .dry_friction import load, release
from .parameters import BodyParameters

ROUNDING_OF_STOP = 64  # of the range of a joint, in units of rounding: one that is closer to a stop touches it
ROUNDING_OF_EFFORT = 64  # of the efforts that its masses need, in units of rounding: what is smaller holds a joint
MOVED_OFF = 1e-6  # of √(r/g): a joint that moves off a stop counts as being as far from it as after this time, at least


class Stops(NamedTuple):
    """The stops of all joints that may be held, with the fields of ``HardStops``."""

    lower: Float[Array, " sticking"]
    upper: Float[Array, " sticking"]
    restitution: Float[Array, " sticking"]
    slowest: Float[Array, " sticking"]

    @classmethod
    def of(cls, system: BodyParameters) -> "Stops":
        """Collects the stops of a body."""
        default = HardStops(-np.inf, np.inf)
        columns = [
            _of_groups(system, lambda group, place, name=name: getattr(group.stops.get(place, default), name))
            for name in cls._fields
        ]
        return cls(*columns)

    @property
    def rounding(self) -> Float[Array, " sticking"]:
        """How close to a stop a joint touches it."""
        sizes = [jnp.where(jnp.isfinite(end), jnp.abs(end), 0.0) for end in (self.lower, self.upper)]
        limits = jnp.finfo(self.lower.dtype)
        return jax.lax.stop_gradient(ROUNDING_OF_STOP * float(limits.eps) * sum(sizes) + float(limits.tiny) ** 0.5)

    def at(self, side: Float[Array, " sticking"]) -> Float[Array, " sticking"]:
        """Returns the places of the stops on these sides."""
        return jnp.where(side > 0, self.upper, self.lower)

    def gap(self, theta: Float[Array, " sticking"], side: Float[Array, " sticking"]) -> Float[Array, " sticking"]:
        """Computes how far joints are from their stops on a side; infinite without a stop there."""
        return side * (self.at(side) - theta)

    def find_touched(self, theta: Float[Array, " sticking"]) -> Float[Array, " sticking"]:
        """Returns the side on which each joint touches a stop; 0 for none."""
        up, down = (self.gap(theta, jnp.full_like(theta, side)) <= self.rounding for side in (1.0, -1.0))
        return jnp.where(up, 1.0, jnp.where(down, -1.0, 0.0))

    def find_closing(
        self, theta: Float[Array, " sticking"], thetadot: Float[Array, " sticking"]
    ) -> Float[Array, " sticking"]:
        """Returns the side of the stop that each joint touches and moves against; 0 for none."""
        touched = self.find_touched(theta)
        return jnp.where(touched * thetadot > 0, touched, 0.0)


def _of_groups(system: BodyParameters, value) -> Float[Array, " sticking"]:
    """Joins the values of the joints that may be held, where ``value`` gives that of a place in a group."""
    columns = []
    for group in system.mechanism_groups:
        if group.holdable:
            each = [jnp.broadcast_to(value(group, place), group.mass.shape[:1]) for place in group.holdable]
            columns.append(jnp.ravel(jnp.stack(each, axis=-1)))
    return jnp.concatenate(columns)


def has_stops(system: BodyParameters) -> bool:
    """Returns whether any joint of a body has hard stops."""
    return any(group.stops for group in system.mechanism_groups)


def rubs(system: BodyParameters) -> Bool[np.ndarray, " sticking"]:
    """Returns which of the joints that may be held have dry friction; the others are held at their stops alone."""
    items = zip(system.mechanism_groups, system.mechanism_order, strict=True)
    return np.asarray([p in group.frictions for group, order in items for _ in order for p in group.holdable], bool)


def largest_frictions(system: BodyParameters) -> Float[Array, " sticking"]:
    """Returns the largest friction, at rest, of each joint that may be held; 0 without friction."""

    def largest(group: AbstractMechanism, place: int) -> Array:
        friction = group.frictions.get(place)
        return jnp.zeros_like(group.mass[:, 0]) if friction is None else jnp.asarray(friction.largest)

    return _of_groups(system, largest)


def sides(
    system: BodyParameters, directions: Float[Array, " sticking"], theta: Float[Array, " sticking"]
) -> Float[Array, " sticking"]:
    """Returns at which stop each joint is held; 0 for none.

    A joint without friction is held at stops alone, so it is at the nearer one, whatever the rounding of its place.
    """
    stops, up = Stops.of(system), jnp.ones_like(theta)
    nearer = jnp.where(stops.gap(theta, up) <= stops.gap(theta, -up), 1.0, -1.0)
    return jax.lax.stop_gradient(
        jnp.where(directions == 0, jnp.where(rubs(system), stops.find_touched(theta), nearer), 0.0)
    )


class Reach(NamedTuple):
    """How the masses of joints move with them: ``lever``, Σ m |∂χ/∂θ|, and their ``mean`` |∂χ/∂θ|, by that weight."""

    lever: Float[Array, " sticking"]
    mean: Float[Array, " sticking"]

    @classmethod
    def of(cls, system: BodyParameters, t: Float[Array, ""], state: State) -> "Reach":
        """Computes it at a state, without derivatives."""
        levers, squares = [], []
        for link in linkages(system, t, (state.theta, state.thetadot, state.thetadot)):  # no rates are used
            if link.group.holdable:
                square = jnp.sum(link.partial[:, list(link.group.holdable)] ** 2, axis=-1)
                levers.append(jnp.ravel(jnp.sum(link.m[:, None] * root(square), axis=-1)))
                squares.append(jnp.ravel(jnp.sum(link.m[:, None] * square, axis=-1)))
        lever = jnp.concatenate(levers)
        return cls(*jax.lax.stop_gradient((lever, jnp.concatenate(squares) / lever)))


def slack_of_effort(system: BodyParameters, t: Float[Array, ""], state: State) -> Float[Array, " sticking"]:
    """Estimates the rounding of the efforts that hold joints, with which one still rests where nothing presses it."""
    g, r = jnp.abs(system.gravity), system.radius
    scale = Reach.of(system, t, state).lever * (g + r * jnp.sum(state.Omega**2))
    limits = jnp.finfo(scale.dtype)
    return jax.lax.stop_gradient(ROUNDING_OF_EFFORT * float(limits.eps) * scale + float(limits.tiny) ** 0.5)


def guard_of_gap(
    system: BodyParameters,
    theta: Float[Array, " sticking"],
    thetadot: Float[Array, " sticking"],
    side: Float[Array, " sticking"],
) -> Float[Array, " sticking"]:
    """Computes the gap between joints and their stops on a side, as a guard; 1 without a stop there."""
    stops = Stops.of(system)
    g, r, slack = jax.lax.stop_gradient((jnp.abs(system.gravity), system.radius, stops.rounding))
    time = MOVED_OFF * root(r / jnp.where(g > 0, g, 1.0))
    ends, leaves = jnp.isfinite(stops.at(side)), side * thetadot < 0
    gap = stops.gap(theta, side) + slack
    # A joint that moves off its stop does not strike it, where rounding has it beyond.
    gap = jnp.where(leaves, jnp.maximum(gap, -time * side * thetadot), gap)
    return jnp.where(ends, gap, 1.0)


def range_conditions(system: BodyParameters, slots: np.ndarray, theta: Float[Array, " joints"]) -> Iterator[Condition]:
    """Yields the condition on an initial state that no joint is beyond its stops."""
    stops, joints = Stops.of(system), theta[slots]
    holds = (joints >= stops.lower - stops.rounding) & (joints <= stops.upper + stops.rounding)
    for k, slot in enumerate(slots):
        must = f"between the HardStops of {system.coordinates[slot]}"
        yield Condition(holds[k], f"state.theta[{slot}]", joints[k], must)


def describe_joints(
    joints: tuple[str, ...], before: Any, after: Any, rested: Any, rests: Any, struck: Any, k: int
) -> list[str]:
    """Describes what joints do at switch ``k``, from their directions on both sides, the stops at which they rest on
    both, and those that they strike; None stands for no stops, and for no such joints.
    """
    none = np.zeros(len(joints))
    columns = [none if column is None else np.asarray(column[k]) for column in (before, after, rested, rests, struck)]
    said = (_describe(*values) for values in zip(*columns, strict=True))
    return [f"{name} {words}" for name, words in zip(joints, said, strict=True) if words]


def _describe(before: float, after: float, rested: float, rests: float, strikes: float) -> str:
    if rested and not rests:
        return f"leaves its {_NAMES[int(rested)]} stop"
    if rests and not rested:
        return f"comes to rest against its {_NAMES[int(rests)]} stop"
    if strikes:
        return f"strikes its {_NAMES[int(strikes)]} stop"
    if before == after:
        return ""
    return "sticks" if after == 0 else "breaks loose" if before == 0 else "turns back"


_NAMES = {1: "upper", -1: "lower"}


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
    groups = tuple(
        eqx.filter_vmap(lambda mechanism, slips: mechanism.slipping(slips))(group, slips) if group.holdable else group
        for group, slips in _in_groups(system, directions)
    )
    return eqx.tree_at(lambda body: body.mechanism_groups, system, groups)


def _in_groups(
    system: BodyParameters, values: Float[Array, " sticking"]
) -> Iterator[tuple[AbstractMechanism, Float[Array, "mechanisms holdable"]]]:
    """Yields each group of mechanisms with the values of its joints that may be held."""
    start = 0
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        end = start + len(order) * len(group.holdable)
        yield group, jnp.reshape(values[start:end], (len(order), len(group.holdable)))
        start = end


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
    joints = []
    for group, entries in _in_groups(system, values):
        if group.free:
            columns = [jnp.zeros(len(entries), values.dtype) for _ in group.free]
            for which, place in enumerate(group.holdable):
                columns[place] = entries[:, which]
            joints.append(jnp.stack(columns, axis=-1))
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
