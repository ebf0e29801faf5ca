"""Energy of the ball and the power that the actuation and the force put into it (section 3.1)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import apply, cross, dot
from .motion import Kinematics


def kinetic_energy(
    m: Float[Array, " n_plus_one"],
    inertia: Float[Array, "3 3"],
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    Gamma: Float[Array, "3"],
) -> Float[Array, ""]:
    """T = ½ Ω·𝕀Ω + ½ Σ m |Ω × s + χ̇|², over the shell (first) and the point masses."""
    Y = velocities(r, masses, Omega, Gamma)
    return 0.5 * dot(Omega, apply(inertia, Omega)) + 0.5 * jnp.sum(m * jnp.sum(Y**2, axis=1))


def velocities(
    r: Float[Array, ""], masses: Kinematics, Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "n 3"]:
    """Y = Ω × s + χ̇, the velocities in space of masses that roll with the ball, ``eq:roll_c_con``; body axes."""
    return jax.vmap(lambda chi, chidot: cross(Omega, r * Gamma + chi) + chidot)(masses.chi, masses.chidot)


def accelerations(
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
    Gamma: Float[Array, "3"],
) -> Float[Array, "n 3"]:
    """a = Ω̇ × s + Ω × (Ω × χ + 2χ̇) + χ̈, the accelerations in space of the masses; body axes."""

    def one(chi, chidot, chiddot):
        return cross(Omegadot, r * Gamma + chi) + cross(Omega, cross(Omega, chi) + 2 * chidot) + chiddot

    return jax.vmap(one)(*masses)


def potential_energy(
    m: Float[Array, " n_plus_one"], g: Float[Array, ""], masses: Kinematics, Gamma: Float[Array, "3"]
) -> Float[Array, ""]:
    """V = g Σ m χ·Γ, zero where every mass is at the height of the geometric centre."""
    return g * jnp.sum(m * jnp.sum(masses.chi * Gamma[None], axis=1))


def actuation_power(
    m: Float[Array, " n_plus_one"],
    g: Float[Array, ""],
    r: Float[Array, ""],
    masses: Kinematics,
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
    Gamma: Float[Array, "3"],
) -> Float[Array, ""]:
    """Σ m χ̇·(gΓ + a), the rate at which the actuators do work on the masses."""
    a = accelerations(r, masses, Omega, Omegadot, Gamma)
    return jnp.sum(m * jnp.sum(masses.chidot * (g * Gamma[None] + a), axis=1))


def force_power(Fe: Float[Array, "3"], r: Float[Array, ""], omega: Float[Array, "3"]) -> Float[Array, ""]:
    """Fe·(ω × r e3), the rate at which the external force does work at the geometric centre."""
    velocity = cross(omega, jnp.stack([jnp.zeros_like(r), jnp.zeros_like(r), r]))
    return dot(Fe, velocity)
