"""Momentum about the contact point, the force of the plane there, and the equations of motion for locked velocities.

A solve advances these instead of Ω and of free joints' θ̇. Locked velocities (W, ϑ̇) are those that the ball and its
free joints would have if everything prescribed or driven by a law were suddenly stopped in it, which does not change
the momenta: Π about the contact point, and π_a = Σ m χ_a·v of each free joint. Without mechanisms, W = B⁻¹Π. Their
rates do not contain the acceleration of a prescribed mass, unlike Ω̇ and θ̈. So where a prescribed θ̈ jumps, Ω̇ jumps
but Ẇ does not, and the derivative of a solve with respect to the time of the jump is right for each mass, even when
several masses jump at once.

The effect of a torque whose integral I_a is known in closed form is removed in the same way: locked velocities belong
to the momenta Π and π_a − I_a, whose rates do not contain it. Where any other force jumps, the rates jump with it. A
solve ends a step there, which carries the derivative; where several of these jump at once, it belongs to all of them
together.

With the balance of momentum are the integrals of the classical spheres, and Jellett's rate. All vectors are in body
axes. With s = rΓ + χ from the contact point to a mass, Ω × s + χ̇ is the mass's velocity in space, because the body's
point at the contact is at rest. The ``arm`` is Γ, or what a body that is no sphere has in its place; then the integrals
are none.
"""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.vectors import add, apply, convert, cross, dot
from ..rolling import Reaction
from ..state import BallState, DiskState, ReducedState, RotationState, State
from .coupling import (
    Joints,
    Linkage,
    inertia,
    inertia_rate,
    join_coordinates,
    joint_forces,
    joint_impulses,
    linkages,
    with_free_joints,
)
from .dry_friction import TurningMode
from .equations import Lever, accelerations, angles_in_state, inertia_about_contact, inertia_about_contact_rate
from .footing import contact_normal, rates as rates_of
from .load import Load, accelerations_in_turning_axes, load
from .moments import Moments, VelocityMoments, velocity_moments
from .parameters import BodyParameters


def linear_momentum(
    body_moments: VelocityMoments, r: Float[Array, ""], Omega: Float[Array, "3"], arm: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes P = Σ m (Ω × s + χ̇)."""
    return cross(Omega, body_moments.M * r * arm + body_moments.p) + body_moments.pdot


def contact_momentum(
    body_moments: VelocityMoments,
    r: Float[Array, ""],
    Omega: Float[Array, "3"],
    arm: Float[Array, "3"],
    square: Float[Array, ""] | None = None,
) -> Float[Array, "3"]:
    """Computes Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) = BΩ + rΓ × ṗ + ℓ, the angular momentum about the contact point."""
    return apply(inertia_about_contact(body_moments, r, arm, square), Omega) + internal_momentum(body_moments, r, arm)


def internal_momentum(body_moments: VelocityMoments, r: Float[Array, ""], arm: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes rΓ × ṗ + ℓ, the part of Π that the masses have by moving in the ball."""
    return r * cross(arm, body_moments.pdot) + body_moments.l


def contact_momentum_rate(
    body_moments: VelocityMoments, r: Float[Array, ""], acting: Load, Pi: Float[Array, "3"], Omega: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes Π̇ = Π × Ω + T + rΓ̇ × P, with T the torque of the load about the contact point, gΓ × p + rΓ × F̃ and
    more. The load is that ``of_momenta``.

    The last term is there because the contact point moves along the plane. Where p = 0 at all times
    and no force acts, ΛΠ is constant (Chaplygin's sphere), also while the masses move.
    """
    P = linear_momentum(body_moments, r, Omega, acting.arm.along)
    return cross(Pi, Omega) + acting.about_contact(body_moments, r) + cross(r * acting.arm.rate_in_body(Omega), P)


class RouthIntegrals(NamedTuple):
    """The two integrals of a Routh sphere besides its energy."""

    jellett: Float[Array, ""]
    routh: Float[Array, ""]


def jellett(
    body_moments: VelocityMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes L·s, with L about the centre of mass of the whole and s = rΓ + χ to it from the contact point."""
    L, s, _ = _about_centre_of_mass(body_moments, r, Omega, Gamma)
    return dot(L, s)


def jellett_rate(
    body_moments: VelocityMoments,
    r: Float[Array, ""],
    Omega: Float[Array, "3"],
    Gamma: Float[Array, "3"],
    force: Float[Array, "3"] | None = None,
    torque: Float[Array, "3"] | None = None,
) -> Float[Array, ""]:
    """Computes d/dt (L·s) = L·(Ω × χ + χ̇) − s·(χ × F̃) + s·T̃ with χ the centre of mass of the whole.

    The reaction of the plane, friction included, has no moment along s and does not appear; nor do gravity and the
    motion of the plane, which act at the centre of mass. ``force`` is F̃, at the geometric centre, and ``torque`` T̃.
    """
    L, s, velocity = _about_centre_of_mass(body_moments, r, Omega, Gamma)
    pushed = convert(lambda force: -dot(s, cross(body_moments.p / body_moments.M, force)), force)
    return add(dot(L, velocity), pushed, convert(lambda torque: dot(s, torque), torque))


def routh_integrals(
    body_moments: VelocityMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> RouthIntegrals:
    """Computes the integrals of Jellett and Routh, constant for d1 = d2, every mass fixed on E3, and no force."""
    height = body_moments.p[2] / body_moments.M
    d1, d3 = body_moments.J[0, 0] - body_moments.M * height**2, body_moments.J[2, 2]
    axial = height + r * Gamma[2]
    spin = d1 * d3 + body_moments.M * (d1 * r**2 * (1 - Gamma[2] ** 2) + d3 * axial**2)
    return RouthIntegrals(
        jellett=d1 * r * (Omega[0] * Gamma[0] + Omega[1] * Gamma[1]) + d3 * Omega[2] * axial,
        routh=Omega[2] * jnp.sqrt(spin),
    )


def _about_centre_of_mass(body_moments: VelocityMoments, r, Omega, Gamma):
    """Computes L, s = rΓ + χ and Ω × χ + χ̇ for the centre of mass χ = p / M."""
    centre, rate = body_moments.p / body_moments.M, body_moments.pdot / body_moments.M
    velocity = cross(Omega, centre) + rate
    L = apply(body_moments.J, Omega) + body_moments.l - body_moments.M * cross(centre, velocity)
    return L, r * Gamma + centre, velocity


def reaction_in_body(
    body_moments: Moments, r: Float[Array, ""], acting: Load, Omega: Float[Array, "3"], Omegadot: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes R̃ = Σ m a + Mγ − F̃ by Newton's second law for the whole system, in body axes.

    With a_i = Ω̇ × s_i + Ω × (Ω × χ_i + 2χ̇_i) + χ̈_i, Σ m a depends only on the moments.
    """
    R = total_inertial_force(body_moments, r, acting.arm.along, Omega, Omegadot) + body_moments.M * acting.weight
    return add(R, convert(jnp.negative, acting.force))


def reaction(system: BodyParameters, t: Float[Array, ""], state: State, mode: TurningMode | None = None) -> Reaction:
    """Computes N and |f|² from any kind of state, in body axes, so that the heading need not be known; in a mode of
    turning, if it is known.
    """
    acting = load(system, t, state)
    solution = accelerations(system, t, state, acting, mode)
    R = reaction_in_body(solution.body_moments, system.radius, acting, state.Omega, solution.Omegadot)
    return Reaction.of(R, acting.Gamma)


def total_inertial_force(
    body_moments: Moments,
    r: Float[Array, ""],
    arm: Float[Array, "3"],
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Computes Σ m a in body axes, with a the accelerations in space as far as the arm, Γ of a sphere, is at rest."""
    apparent = accelerations_in_turning_axes(Omega, body_moments.p, body_moments.pdot, body_moments.pddot)
    return cross(Omegadot, body_moments.M * r * arm + body_moments.p) + apparent


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


@eqx.filter_jit  # a function of programs, which pack and unpack at many places
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
    body_moments: VelocityMoments,
    r: Float[Array, ""],
    arm: Float[Array, "3"],
    free: list[Linkage],
) -> tuple[Float[Array, "3"], Joints]:
    """Computes the known parts of Π and π_a: from prescribed or driven motions in the ball, and from integrated forces.

    The free joints are still.
    """
    pi = [link.along(link.chidot) - I for link, I in zip(free, joint_impulses(t, free), strict=True)]
    return internal_momentum(body_moments, r, arm), pi


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
