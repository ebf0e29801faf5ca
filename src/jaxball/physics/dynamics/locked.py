"""The equations of motion for the locked velocities, which a solve advances instead of Ω and of free joints' θ̇.

Locked velocities (W, ϑ̇) are those that the ball and its free joints would have if everything prescribed or driven by a
law were suddenly stopped in it, which does not change the momenta: Π about the contact point, and π_a = Σ m χ_a·v of
each free joint. Without mechanisms, W = B⁻¹Π. Their rates do not contain the acceleration of a prescribed mass, unlike
Ω̇ and θ̈. So where a prescribed θ̈ jumps, Ω̇ jumps but Ẇ does not, and the derivative of a solve with respect to the
time of the jump is right for each mass, even when several masses jump at once.

The effect of a torque whose integral I_a is known in closed form is removed in the same way: locked velocities belong
to the momenta Π and π_a − I_a, whose rates do not contain it. Where any other force jumps, the rates jump with it. A
solve ends a step there, which carries the derivative; where several of these jump at once, it belongs to all of them
together.
"""

from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.vectors import cross, dot, outer
from ..state import BallState, DiskState, ReducedState, RotationState, State
from .coupling import Joints, inertia, inertia_rate, join_coordinates, joint_forces, joint_impulses, with_free_joints
from .equations import Lever, accelerations, angles_in_state
from .footing import contact_normal, rates as rates_of
from .linkage import Linkage, linkages
from .load import Load, load
from .moments import AbstractMoments, VelocityMoments, velocity_moments
from .momentum import contact_momentum_rate, internal_momentum
from .parameters import BodyParameters

AnyState = TypeVar("AnyState", BallState, RotationState, ReducedState, DiskState)


def to_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """Returns ``state`` with the locked velocities in place of Ω (for a disk, of φ̇) and of free joints' θ̇."""
    return _move(system, t, state, 1.0)


def from_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """Inverts :func:`to_locked`."""
    return _move(system, t, state, -1.0)


def field_of_locked(system: BodyParameters, t: Float[Array, ""], packed: AnyState) -> AnyState:
    """Computes the rates of a state that holds (W, ϑ̇): with 𝔐 the inertia of ``coupling``, 𝔐⁻¹ ((Π̇, π̇) − 𝔐̇ (W,
    ϑ̇)).
    """
    r, W, Gamma = system.radius, packed.Omega, contact_normal(system, t, packed)
    body_moments, links = _stop_joints(system, t, packed)
    free = with_free_joints(links)
    locked = [link.own(packed.thetadot) for link in free]
    lever = Lever.of(system, Gamma, body_moments)
    matrix = inertia(lever.inertia_about_contact(body_moments, r), r, lever.arm, links)
    factors = matrix.factorise()
    # By so much the locked velocities exceed the real ones, which forces and the directions of friction depend on.
    excess = factors.solve(*_momenta_of_motions(t, body_moments, r, lever.arm, free))
    state = _with_velocities(packed, links, -1.0, *excess)
    Omega, angles = W - excess[0], angles_in_state(system, t, state)
    # So far the free joints were still; from here on they have their real rates.
    if free:
        links = [link.moving(link.own(state.thetadot)) if link.group.free else link for link in links]
        body_moments, free = velocity_moments(system, t, angles[:2], links), with_free_joints(links)
    acting = _with_dry_friction(system, t, state, load(system, t, state))
    armdot = acting.arm.rate_in_body(Omega)
    acting = acting.of_momenta(r, Omega)
    # By their definition, the locked velocities have the whole momentum.
    Pi, _ = matrix.times(W, locked)
    Pidot = contact_momentum_rate(body_moments, r, acting, Pi, Omega)
    forces = joint_forces(t, state, links, impulses=False)
    pidot = [Q + _momentum_rate(link, r, acting, Omega) for link, Q in zip(free, forces, strict=True)]
    Bdot = inertia_about_contact_rate(body_moments, r, lever, armdot)
    changing = inertia_rate(Bdot, r, lever.arm, armdot, links)
    turned, pulled = changing.times(W, locked)
    Wdot, rates = factors.solve(Pidot - turned, [x - y for x, y in zip(pidot, pulled, strict=True)])
    theta, thetadot, driven_thetaddot = angles
    return rates_of(
        system, t, state, Wdot, (theta, thetadot, join_coordinates(driven_thetaddot, links, rates)), acting.footing
    )


def inertia_about_contact_rate(
    body_moments: AbstractMoments, r: Float[Array, ""], lever: Lever, armdot: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Computes Ḃ, by the rule of products."""
    arm, identity = lever.arm, jnp.eye(3, dtype=armdot.dtype)
    turn = outer(armdot, arm)
    mixed = outer(armdot, body_moments.p) + outer(arm, body_moments.pdot)
    trace = dot(armdot, body_moments.p) + dot(arm, body_moments.pdot)
    spread = -(turn + turn.T)
    if lever.square is not None:
        spread = spread + 2 * dot(arm, armdot) * identity
    return body_moments.Jdot + body_moments.M * r**2 * spread + r * (2 * trace * identity - mixed - mixed.T)


def _move(system: BodyParameters, t: Float[Array, ""], state: AnyState, sign: float) -> AnyState:
    body_moments, links = _stop_joints(system, t, state)
    r, lever = system.radius, Lever.of(system, contact_normal(system, t, state), body_moments)
    factors = inertia(lever.inertia_about_contact(body_moments, r), r, lever.arm, links).factorise()
    momenta = _momenta_of_motions(t, body_moments, r, lever.arm, with_free_joints(links))
    return _with_velocities(state, links, sign, *factors.solve(*momenta))


def _stop_joints(system: BodyParameters, t: Float[Array, ""], state: State) -> tuple[VelocityMoments, list[Linkage]]:
    """Computes moments and mechanisms as they would be if the free joints were still."""
    still = state.thetadot
    if len(system.accelerated) < len(system.coordinates):
        moving = np.zeros(len(system.coordinates), dtype=bool)
        moving[list(system.accelerated)] = True
        still = jnp.where(moving, still, 0.0)
    links = linkages(system, t, (state.theta, still, still))  # θ̈ is not used
    return velocity_moments(system, t, (state.theta, still), links), links


def _momenta_of_motions(
    t: Float[Array, ""],
    body_moments: AbstractMoments,
    r: Float[Array, ""],
    arm: Float[Array, "3"],
    free: list[Linkage],
) -> tuple[Float[Array, "3"], Joints]:
    """Computes the known parts of Π and π_a: from prescribed or driven motions in the ball, and from integrated forces.

    The free joints are still.
    """
    pi = [jnp.sum((link.m[..., None] * link.chidot)[:, None] * link.partial, axis=(-2, -1)) for link in free]
    return internal_momentum(body_moments, r, arm), [x - I for x, I in zip(pi, joint_impulses(t, free), strict=True)]


def _with_velocities(
    state: AnyState, links: list[Linkage], sign: float, Omega: Float[Array, "3"], thetadot: Joints
) -> AnyState:
    """Returns the state with changes of Ω and of free joints' θ̇ added, times ``sign``."""
    moved = state.with_Omega(state.Omega + sign * Omega)
    if not thetadot:
        return moved
    changes = join_coordinates(jnp.zeros_like(state.thetadot), links, thetadot)
    return eqx.tree_at(lambda s: s.thetadot, moved, state.thetadot + sign * changes)


def _momentum_rate(
    link: Linkage, r: Float[Array, ""], acting: Load, Omega: Float[Array, "3"]
) -> Float[Array, "mechanisms free"]:
    """Computes π̇_a − Q_a = Σ m [ v·(Ω × χ_a + d/dt χ_a) − χ_a·γ ], with v = Ω × s + χ̇."""
    turning = jnp.broadcast_to(Omega, link.chi.shape)
    v = cross(turning, r * acting.arm.along[None, None] + link.chi) + link.chidot
    partial = link.partial
    carried = cross(jnp.broadcast_to(Omega, partial.shape), partial) + link.slope[:, link.free]
    power = jnp.sum(v[:, None] * carried, axis=-1) - jnp.sum(partial * acting.weight[None, None, None], axis=-1)
    return jnp.sum(link.m[:, None] * power, axis=-1)


def _with_dry_friction(system: BodyParameters, t: Float[Array, ""], state: State, acting: Load) -> Load:
    if system.resistance is None or not system.resistance.is_dry:
        return acting
    # It is proportional to the normal force, which the accelerations determine: these are solved for first, in any
    # form.
    return acting.with_torque(accelerations(system, t, state, acting).dry)
