"""Momentum about the contact point, and its balance.

All vectors are in body axes; the velocity of a mass in space is Ω × s + χ̇ with s = rΓ + χ.
"""

from jaxtyping import Array, Float

from ...numerics.vectors import apply, cross
from .equations import inertia_about_contact
from .load import Load
from .moments import AbstractMoments


def linear_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes P = Σ m (Ω × s + χ̇)."""
    return cross(Omega, at.M * r * Gamma + at.p) + at.pdot


def contact_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) = BΩ + rΓ × ṗ + ℓ, the angular momentum about the contact point."""
    return apply(inertia_about_contact(at, r, Gamma), Omega) + internal_momentum(at, r, Gamma)


def internal_momentum(at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
    """Computes rΓ × ṗ + ℓ, the part of Π that the masses have by moving in the ball."""
    return r * cross(Gamma, at.pdot) + at.l


def contact_momentum_rate(
    at: AbstractMoments, r: Float[Array, ""], acting: Load, Pi: Float[Array, "3"], Omega: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Computes Π̇ = Π × Ω + T + rΓ̇ × P, with T the torque of the load about the contact point, gΓ × p + rΓ × F̃ and
    more.

    The last term is there because the contact point moves along the plane. Where p = 0 at all times
    and no force acts, ΛΠ is constant (Chaplygin's sphere), also while the masses move.
    """
    P = linear_momentum(at, r, Omega, acting.Gamma)
    return cross(Pi, Omega) + acting.about_contact(at, r) + cross(r * acting.Gammadot(Omega), P)
