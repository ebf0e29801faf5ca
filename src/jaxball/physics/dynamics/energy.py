"""The energy of the ball, and the power supplied to it and dissipated (section 3.1).

The ``arm`` is Γ, or what a body that is no sphere has in its place.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.terms import add, convert
from ...numerics.vectors import apply, cross, dot
from ..forces.force import Wrench
from ..prescribed.motion import Kinematics
from .load import Load


def kinetic_energy(
    m: Float[Array, " n_plus_one"],
    inertia: Float[Array, "3 3"],
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    arm: Float[Array, "3"],
    drift: Float[Array, "3"] | None = None,
) -> Float[Array, ""]:
    """Computes T = ½ Ω·𝕀Ω + ½ Σ m |Ω × s + χ̇ + Λ⁻¹u|², over the shell (first) and the point masses.

    ``drift`` is Λ⁻¹ of what every mass has besides the velocity of rolling on a plane at rest, if there is any.
    """
    Y = add(velocities(r, masses, Omega, arm), convert(lambda drift: drift[None], drift))
    return 0.5 * dot(Omega, apply(inertia, Omega)) + 0.5 * jnp.sum(m * jnp.sum(Y**2, axis=1))


def velocities(
    r: Float[Array, ""], masses: Kinematics, Omega: Float[Array, "3"], arm: Float[Array, "3"]
) -> Float[Array, "n 3"]:
    """Computes Y = Ω × s + χ̇, the velocities in space of masses that roll with the ball, ``eq:roll_c_con``;
    body axes.
    """
    return jax.vmap(lambda chi, chidot: cross(Omega, r * arm + chi) + chidot)(masses.chi, masses.chidot)


def accelerations_of_masses(
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
    arm: Float[Array, "3"],
) -> Float[Array, "n 3"]:
    """Computes a = Ω̇ × s + Ω × (Ω × χ + 2χ̇) + χ̈, the accelerations in space of the masses; body axes."""

    def one(chi, chidot, chiddot):
        return cross(Omegadot, r * arm + chi) + cross(Omega, cross(Omega, chi) + 2 * chidot) + chiddot

    return jax.vmap(one)(*masses)


def potential_energy(
    m: Float[Array, " n_plus_one"],
    g: Float[Array, ""],
    masses: Kinematics,
    up: Float[Array, "3"],
    height: Float[Array, ""],
) -> Float[Array, ""]:
    """Computes V = g Σ m (χ·Λ⁻¹up + height): zero where every mass is at the height of the origin of space.

    ``up`` is the vertical in body axes, which is Γ on a level plane, and ``height`` that of the geometric centre.
    """
    return g * jnp.sum(m * (jnp.sum(masses.chi * up[None], axis=1) + height))


def actuation_power(
    m: Float[Array, " n_plus_one"], masses: Kinematics, a: Float[Array, "n_plus_one 3"], weight: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes Σ m χ̇·(γ + a), the rate at which motors and all other forces within the body do work;
    ``weight`` is γ.
    """
    return jnp.sum(m * jnp.sum(masses.chidot * (weight[None] + a), axis=1))


def dissipation(
    acting: Load,
    dry: Float[Array, "3"] | None,
    Lambda: Float[Array, "3 3"],
    velocity: Float[Array, "3"],
    omega: Float[Array, "3"],
) -> Float[Array, ""]:
    """Computes the rate at which resistance dissipates energy: −T·ω − F_m·ż, without the external force.

    ``dry`` is the torque of dry friction in body axes, and ``velocity`` ż.
    """
    turned = (convert(lambda torque: -dot(apply(Lambda, torque), omega), torque) for torque in (acting.torque, dry))
    moved = convert(lambda force: -dot(apply(Lambda, force), velocity), acting.force)
    supplied = None if acting.applied is None else external_power(acting.applied, Lambda, velocity, omega)
    return add(jnp.zeros_like(acting.g), *turned, moved, supplied)


def external_power(
    applied: Wrench, Lambda: Float[Array, "3 3"], velocity: Float[Array, "3"], omega: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes F·ż + T·ω, the rate at which the external force and its torque, in body axes, do work."""
    turned = convert(lambda torque: dot(apply(Lambda, torque), omega), applied.torque)
    return add(dot(apply(Lambda, applied.force), velocity), turned)
