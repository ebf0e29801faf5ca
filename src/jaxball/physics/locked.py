"""The equations of motion for the locked velocities, which a solve advances in the place of Ω and of free joints' θ̇.

Locked velocities (W, ϑ̇) are those that the ball and its free joints would have if all that is prescribed or driven by a
law were stopped in it at once, for that leaves the momenta as they are: Π about the contact point, and of each
free joint π_a = Σ m χ_a·v. Without mechanisms, W = B⁻¹Π. Their rates hold no acceleration of a prescribed
mass, where Ω̇ and θ̈ do. So where a prescribed θ̈ jumps, Ω̇ jumps and Ẇ does not, and the derivative of a
solve with respect to the time of the jump is right for each mass, also when several masses jump at once. Where a force
jumps, Π̇ or π̇ jumps with it: a solve steps there, and its step carries the derivative.
"""

from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics.vectors import cross, dot, outer
from .coupling import (
    FreeJoints,
    Joints,
    along,
    free_joints,
    inertia,
    inertia_rate,
    joined,
    joint_forces,
)
from .dynamics import accelerations, given_angles, inertia_about_contact
from .load import Load, load
from .moments import AbstractMoments, velocity_moments
from .momentum import contact_momentum_rate, internal_momentum
from .parameters import BodyParameters
from .state import BallState, DiskState, ReducedState, RotationState, State

AnyState = TypeVar("AnyState", BallState, RotationState, ReducedState, DiskState)


def to_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """``state`` with the locked velocities in the place of Ω (for a disk, of φ̇) and of free joints' θ̇."""
    return _moved(system, t, state, 1.0)


def from_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """The inverse of :func:`to_locked`."""
    return _moved(system, t, state, -1.0)


def locked_field(system: BodyParameters, t: Float[Array, ""], packed: AnyState) -> AnyState:
    """The rates of a state that holds (W, ϑ̇): with 𝔐 the inertia of ``coupling``, 𝔐⁻¹ ((Π̇, π̇) − 𝔐̇ (W, ϑ̇))."""
    r, W, Gamma = system.radius, packed.Omega, packed.Gamma
    at, joints = _stopped(system, t, packed)
    locked = [joint.own(packed.thetadot) for joint in joints]
    matrix = inertia(inertia_about_contact(at, r, Gamma), r, Gamma, joints)
    factors = matrix.factored()
    state = _with_velocities(packed, joints, -1.0, *factors.solve(*_given_momenta(at, r, Gamma, joints)))
    Omega = state.Omega
    angles = given_angles(system, t, state)
    if joints:
        at, joints = velocity_moments(system, t, angles[:2]), free_joints(system, t, angles)
    acting = _with_dry_friction(system, t, state, load(system, t, state))
    Pi, _ = matrix.times(W, locked)
    Pidot = contact_momentum_rate(at, r, acting, Pi, Omega)
    efforts = joint_forces(system, t, state, joints)
    pidot = [Q + _momentum_rate(joint, r, acting, Omega) for joint, Q in zip(joints, efforts, strict=True)]
    Gammadot = cross(Gamma, Omega)
    changing = inertia_rate(inertia_about_contact_rate(at, r, Gamma, Gammadot), r, Gamma, Gammadot, joints)
    turned, pulled = changing.times(W, locked)
    Wdot, rates = factors.solve(Pidot - turned, [x - y for x, y in zip(pidot, pulled, strict=True)])
    theta, thetadot, given = angles
    return state.rates(r, Wdot, (theta, thetadot, joined(given, joints, rates)), system.drift(t, state))


def inertia_about_contact_rate(
    at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"], Gammadot: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Ḃ, by the rule of products."""
    turn = outer(Gammadot, Gamma)
    mixed = outer(Gammadot, at.p) + outer(Gamma, at.pdot)
    trace = dot(Gammadot, at.p) + dot(Gamma, at.pdot)
    identity = jnp.eye(3, dtype=Gamma.dtype)
    return at.Jdot - at.M * r**2 * (turn + turn.T) + r * (2 * trace * identity - mixed - mixed.T)


def _moved(system: BodyParameters, t: Float[Array, ""], state: AnyState, sign: float) -> AnyState:
    at, joints = _stopped(system, t, state)
    r, Gamma = system.radius, state.Gamma
    factors = inertia(inertia_about_contact(at, r, Gamma), r, Gamma, joints).factored()
    return _with_velocities(state, joints, sign, *factors.solve(*_given_momenta(at, r, Gamma, joints)))


def _stopped(system: BodyParameters, t: Float[Array, ""], state: State) -> tuple[AbstractMoments, list[FreeJoints]]:
    """Moments and joints as they would be if the free joints were still."""
    still = state.thetadot
    if len(system.accelerated) < len(system.coordinates):
        moving = np.zeros(len(system.coordinates), dtype=bool)
        moving[list(system.accelerated)] = True
        still = jnp.where(moving, still, 0.0)
    return velocity_moments(system, t, (state.theta, still)), free_joints(system, t, (state.theta, still, still))


def _given_momenta(
    at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"], joints: list[FreeJoints]
) -> tuple[Float[Array, "3"], Joints]:
    """The parts of Π and π_a that what is not free has by moving in the ball; the free joints are still."""
    pi = []
    for joint in joints:
        momenta = joint.m[..., None] * along(joint.partial, joint.rates[1])
        pi.append(jnp.sum(momenta[:, None] * joint.partial[:, joint.free], axis=(-2, -1)))
    return internal_momentum(at, r, Gamma), pi


def _with_velocities(
    state: AnyState, joints: list[FreeJoints], sign: float, Omega: Float[Array, "3"], thetadot: Joints
) -> AnyState:
    """The state with changes of Ω and of free joints' θ̇ added, times ``sign``."""
    moved = state.with_Omega(state.Omega + sign * Omega)
    if not joints:
        return moved
    changes = joined(jnp.zeros_like(state.thetadot), joints, thetadot)
    return eqx.tree_at(lambda s: s.thetadot, moved, state.thetadot + sign * changes)


def _momentum_rate(
    joint: FreeJoints, r: Float[Array, ""], acting: Load, Omega: Float[Array, "3"]
) -> Float[Array, "mechanisms joints"]:
    """π̇_a − Q_a = Σ m [ v·(Ω × χ_a + d/dt χ_a) − χ_a·γ ], with v = Ω × s + χ̇."""
    turning = jnp.broadcast_to(Omega, joint.chi.shape)
    v = cross(turning, r * acting.Gamma[None, None] + joint.chi) + along(joint.partial, joint.rates[1])
    partial, slope = joint.partial[:, joint.free], joint.slope[:, joint.free]
    carried = cross(jnp.broadcast_to(Omega, partial.shape), partial) + slope
    power = jnp.sum(v[:, None] * carried, axis=-1) - jnp.sum(partial * acting.weight[None, None, None], axis=-1)
    return jnp.sum(joint.m[:, None] * power, axis=-1)


def _with_dry_friction(system: BodyParameters, t: Float[Array, ""], state: State, acting: Load) -> Load:
    if system.resistance is None or system.resistance.dry is None:
        return acting
    return acting._replace(torque=acting.torque + accelerations(system, t, state).dry)
