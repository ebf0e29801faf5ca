"""Momentum about the contact point and its balance; the integrals of the classical spheres, and Jellett's rate.

All vectors are in body axes. With s = rΓ + χ from the contact point to a mass, Ω × s + χ̇ is the mass's
velocity in space, because the body's point at the contact is at rest. The ``arm`` is Γ, or what a body that is no
sphere has in its place; then the integrals are none.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.terms import add, convert
from ...numerics.vectors import apply, cross, dot
from .equations import inertia_about_contact
from .load import Load
from .moments import AbstractMoments


def linear_momentum(
    body_moments: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], arm: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes P = Σ m (Ω × s + χ̇)."""
    return cross(Omega, body_moments.M * r * arm + body_moments.p) + body_moments.pdot


def contact_momentum(
    body_moments: AbstractMoments,
    r: Float[Array, ""],
    Omega: Float[Array, "3"],
    arm: Float[Array, "3"],
    square: Float[Array, ""] | None = None,
) -> Float[Array, "3"]:
    """Computes Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) = BΩ + rΓ × ṗ + ℓ, the angular momentum about the contact point."""
    return apply(inertia_about_contact(body_moments, r, arm, square), Omega) + internal_momentum(body_moments, r, arm)


def internal_momentum(body_moments: AbstractMoments, r: Float[Array, ""], arm: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes rΓ × ṗ + ℓ, the part of Π that the masses have by moving in the ball."""
    return r * cross(arm, body_moments.pdot) + body_moments.l


def contact_momentum_rate(
    body_moments: AbstractMoments, r: Float[Array, ""], acting: Load, Pi: Float[Array, "3"], Omega: Float[Array, "3"]
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
    body_moments: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes L·s, with L about the centre of mass of the whole and s = rΓ + χ to it from the contact point."""
    L, s, _ = _about_centre_of_mass(body_moments, r, Omega, Gamma)
    return dot(L, s)


def jellett_rate(
    body_moments: AbstractMoments,
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
    body_moments: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
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


def _about_centre_of_mass(body_moments: AbstractMoments, r, Omega, Gamma):
    """Computes L, s = rΓ + χ and Ω × χ + χ̇ for the centre of mass χ = p / M."""
    centre, rate = body_moments.p / body_moments.M, body_moments.pdot / body_moments.M
    velocity = cross(Omega, centre) + rate
    L = apply(body_moments.J, Omega) + body_moments.l - body_moments.M * cross(centre, velocity)
    return L, r * Gamma + centre, velocity
