"""Where a sensor is mounted: on the shell, on a link of a mechanism or on a mass, and how the mount moves in the body.

A position on a link is given like those of joints and carried masses: from the geometric centre, in body axes, where
every θ is 0. A position on a mass is given from the mass. The axes are those of the body where every θ is 0, and turn
with the link; a mass on a rail, or of a mechanism given by a function, has no axes of its own and keeps those of the
body.
"""

import re
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.calculus import two_derivatives
from ..physics.body import AbstractBody
from ..physics.mechanisms import Mechanism
from ..physics.mechanisms.mechanism import EachJoint
from ..physics.moments import kinematics
from ..physics.motion import Kinematics
from ..physics.state import Rates

_ON = re.compile(r"(masses|mechanisms)\[(\d+)\](?:\.(joints|masses)\[(\d+)\])?")


class Mount(NamedTuple):
    """A mount in the body: the rotation from its axes to those of the body, its rate in the body, and its position."""

    turn: Float[Array, "3 3"]
    rate: Float[Array, "3"]
    point: Kinematics


def mounts(system: AbstractBody) -> tuple[str, ...]:
    """The parts that a mount can be on, besides the shell, by name."""
    names = [f"masses[{index}]" for index in range(system.n_masses)]
    for index, mechanism in enumerate(system.mechanisms):
        joints = range(mechanism.n_joints if isinstance(mechanism, Mechanism) else 0)
        names += [f"mechanisms[{index}].joints[{a}]" for a in joints]
        names += [f"mechanisms[{index}].masses[{i}]" for i in range(mechanism.mass.shape[-1])]
    return tuple(names)


def mount(system: AbstractBody, t: Float[Array, ""], angles: Rates, on: str | None, at: Float[Array, "3"]) -> Mount:
    """The mount at ``at`` on a part of the body, None for the shell; ``angles`` are θ, θ̇ and θ̈ of the state."""
    still, upright = jnp.zeros_like(at), jnp.eye(3, dtype=at.dtype)
    if on is None:
        return Mount(upright, still, Kinematics(at, still, still))
    kind, index, part, number = parts(on)
    if kind == "masses":
        return Mount(upright, still, _beside(system, t, angles, index, at))
    mechanism = system.mechanisms[index]
    if not isinstance(mechanism, Mechanism):
        before = sum(one.mass.shape[-1] for one in system.mechanisms[:index])
        return Mount(upright, still, _beside(system, t, angles, system.n_masses + before + number, at))
    link = number if part == "joints" else mechanism.carrier[number]
    return _on_link(
        mechanism, joint_rates(system, t, angles, index), link, at if part == "joints" else at + mechanism.place[number]
    )


def parts(on: str) -> tuple[str, int, str, int]:
    """The kind and index of the part that a sensor is on, and the part within a mechanism."""
    found = _ON.fullmatch(on)
    assert found is not None
    kind, index, part, number = found.groups()
    return kind, int(index), part or "", int(number or 0)


def joint_rates(system: AbstractBody, t: Float[Array, ""], angles: Rates, index: int) -> EachJoint:
    """θ, θ̇ and θ̈ of every joint of a mechanism."""
    mechanism = system.mechanisms[index]
    places = system.slots((index,), mechanism.in_state)[0]
    return mechanism.rates(t, (angles[0][places], angles[1][places], angles[2][places]))


def _beside(system: AbstractBody, t: Float[Array, ""], angles: Rates, row: int, at: Float[Array, "3"]) -> Kinematics:
    """A point at a constant distance from a mass, in the body."""
    chi, chidot, chiddot = (values[row] for values in kinematics(system, t, angles))
    return Kinematics(chi + at, chidot, chiddot)


def _on_link(mechanism: Mechanism, rates: EachJoint, link: int, at: Float[Array, "3"]) -> Mount:
    theta, thetadot, thetaddot = rates

    def placed(s: Float[Array, ""]) -> Float[Array, "4 3"]:
        """The rotation of the link and the point, along a motion with these rates."""
        placement = mechanism.links(theta + s * thetadot + s**2 / 2 * thetaddot)[link].placement
        return jnp.concatenate([placement.turn, placement.of_point(at)[None]])

    place, velocity, acceleration = two_derivatives(placed, jnp.zeros((), at.dtype))
    turn = place[:3]
    spin = jnp.sum(velocity[:3, None, :] * turn[None, :, :], axis=-1)  # ŵ = Ṙ Rᵀ
    return Mount(
        turn, jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), Kinematics(place[3], velocity[3], acceleration[3])
    )
