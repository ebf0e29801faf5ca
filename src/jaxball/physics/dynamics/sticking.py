"""Which joints of a body dry friction holds at rest, and which way the others slip.

A joint with :class:`~jaxball.JointFriction` slips in the direction 1 or −1, or sticks, 0. A solve knows these
directions (``contact.guards``). From a state alone they follow: a joint that moves slips, and one at rest sticks unless
friction would have to exceed its largest level for that. Directions are in the order of :func:`sticking_slots`.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..hybrid import AbstractHistory, Switches
from ..mechanisms import AbstractMechanism
from .coupling import Joints
from .law import load, release
from .parameters import BodyParameters

AnyParameters = TypeVar("AnyParameters", bound=BodyParameters)


def sticking_slots(system: BodyParameters) -> Int[np.ndarray, " sticking"]:
    """Returns the indices in a state's ``theta`` of the joints that friction may hold."""
    items = zip(system.mechanism_groups, system.mechanism_order, strict=True)
    slots = [
        system.slots(order, group.free)[:, list(group.frictions)].ravel() for group, order in items if group.frictions
    ]
    return np.concatenate([np.zeros(0, dtype=int), *slots])


def largest_frictions(system: BodyParameters) -> Float[Array, " sticking"]:
    """Returns the largest friction, at rest, of each joint that friction may hold."""
    levels = [
        jnp.ravel(jnp.stack([friction.largest for friction in group.frictions.values()], axis=-1))
        for group in system.mechanism_groups
        if group.frictions
    ]
    return jnp.concatenate(levels)


def has_directions(system: BodyParameters) -> bool:
    """Returns whether it is known of all joints with friction in which direction they slip."""
    frictions = (friction for group in system.mechanism_groups for friction in group.frictions.values())
    return all(friction.direction is not None for friction in frictions)


def with_directions(system: AnyParameters, directions: Float[Array, " sticking"]) -> AnyParameters:
    """Returns the same body where the joints slip in these directions, or stick, 0."""
    groups, start = [], 0
    for group, order in zip(system.mechanism_groups, system.mechanism_order, strict=True):
        end = start + len(order) * len(group.frictions)
        if group.frictions:
            slips = jnp.reshape(directions[start:end], (len(order), -1))
            group = eqx.filter_vmap(lambda mechanism, slips: mechanism.slipping(slips))(group, slips)
        groups.append(group)
        start = end
    return eqx.tree_at(lambda body: body.mechanism_groups, system, tuple(groups))


def sticking_joints(group: AbstractMechanism) -> Bool[Array, "mechanisms free"] | None:
    """Finds which free joints of a group stick; None where there is no friction that may hold one."""
    if not group.frictions:
        return None
    loose = jnp.zeros(group.mass.shape[0], bool)
    columns = [loose for _ in group.free]
    for place, friction in group.frictions.items():
        assert friction.direction is not None
        columns[place] = friction.direction == 0
    return jnp.stack(columns, axis=-1)


def of_sticking(system: BodyParameters, values: Joints) -> Float[Array, " sticking"]:
    """Selects the entries of the joints that friction may hold from the entries of all free joints."""
    groups = (group for group in system.mechanism_groups if group.free)
    return jnp.concatenate(
        [
            jnp.ravel(group_values[:, list(group.frictions)])
            for group, group_values in zip(groups, values, strict=True)
            if group.frictions
        ]
    )


def release_joints(
    system: AnyParameters,
    directions: Float[Array, " sticking"],
    holding: Callable[[AnyParameters], Float[Array, " sticking"]],
) -> Float[Array, " sticking"]:
    """Releases every joint that friction cannot hold, the most overloaded one first, and returns the directions then.

    ``holding`` gives the friction that would hold the joints that stick, in a body with directions.
    """

    def weigh(directions: Float[Array, " sticking"]) -> tuple[Array, Array]:
        friction = holding(with_directions(system, directions))
        return overloads(system, directions, friction), friction

    return release(directions, weigh, loosen, jnp.zeros(directions.size, bool))


def overloads(
    system: BodyParameters, directions: Float[Array, " sticking"], friction: Float[Array, " sticking"]
) -> Float[Array, " sticking"]:
    """Returns the loads of joints that stick although friction cannot hold them; −∞ of others."""
    largest = largest_frictions(system)
    return jnp.where((directions == 0) & (jnp.abs(friction) > largest), load(friction**2, largest), -jnp.inf)


def loosen(
    directions: Float[Array, " sticking"], friction: Float[Array, " sticking"], off: Bool[Array, " sticking"]
) -> Float[Array, " sticking"]:
    """Returns the directions after some joints have broken loose, against the friction that held them."""
    return jnp.where(off, -jnp.sign(friction), directions)


def sticking_guards(
    system: BodyParameters,
    directions: Float[Array, " sticking"],
    thetadot: Float[Array, " rates"],
    holding: Float[Array, " sticking"],
) -> Float[Array, " guards"]:
    """Computes two guards for each joint: θ̇ in its direction and 1 where it slips, what friction has to spare where it
    sticks.
    """
    sticks, largest = directions == 0, largest_frictions(system)
    onward = directions * thetadot[sticking_slots(system)]
    # Two guards for a held joint: which of them falls says in which direction it breaks loose.
    first = jnp.where(sticks, largest - holding, onward)
    return jnp.concatenate([first, jnp.where(sticks, largest + holding, 1.0)])


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
    after = jnp.where(stops, 0.0, jnp.where(changes & sticks, loose, directions))
    slots = np.zeros((thetadot.size, joints.size), dtype=bool)
    slots[sticking_slots(system), joints] = True
    rests = jnp.any(jnp.asarray(slots) & (after == 0)[None], axis=1)
    return after, jnp.where(rests, 0.0, thetadot)


class JointSwitches(Switches):
    """The times at which joints stick, break loose or turn back; a subclass may have other switches, too.

    - ``before``, ``after``: the states of the body, with a leading axis.
    - ``directions_before``, ``directions_after``: in which each joint with dry friction slips, 0 where it sticks,
      shape (max_switches, joints).
    - ``joints``: what these joints are called.
    """

    directions_before: Float[Array, "*batch switches joints"]
    directions_after: Float[Array, "*batch switches joints"]
    joints: tuple[str, ...] = eqx.field(static=True)

    def changes(self, k: int) -> list[str]:
        """Describes which joints stick, break loose or turn back at switch ``k``."""
        return describe_changes(self.joints, self.directions_before, self.directions_after, k)


def describe_changes(joints: tuple[str, ...], before: Any, after: Any, k: int) -> list[str]:
    """Describes which joints stick, break loose or turn back at switch ``k``, from their directions on both sides; none
    where these are None.
    """
    if before is None:
        return []
    return [
        f"{name} {'sticks' if then == 0 else 'breaks loose' if now == 0 else 'turns back'}"
        for name, now, then in zip(joints, np.asarray(before[k]), np.asarray(after[k]), strict=True)
        if now != then
    ]


class JointHistory(AbstractHistory):
    """Which joints stick at the saved times of a run.

    - ``directions``: in which each joint with dry friction slips, 1 or −1, and 0 where it sticks, shape (T, joints).
    """

    directions: Float[Array, "*batch T joints"]

    @property
    def sticks(self) -> Bool[Array, "*batch T joints"]:
        """Whether each joint sticks at the saved times."""
        return self.directions == 0

    def at_rows(self, rows: slice) -> Any:
        return dataclasses.replace(super().at_rows(rows), directions=self.directions[rows])
