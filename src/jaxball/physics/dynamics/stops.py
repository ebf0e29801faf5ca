"""Where the joints of a body have hard stops: how far they are from these, and at which one each is held.

All arrays are of the joints that may be held, in the order of ``sticking.sticking_slots``; a joint without a stop has
one at infinity. The side of a stop is 1 for the upper and −1 for the lower one. A joint is held at a stop by whatever
push that takes, inward, and, if it has dry friction, by that in both directions.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics.vectors import root
from ..conditions import Condition
from ..mechanisms import AbstractMechanism, HardStops
from ..state import State
from .linkage import linkages
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
