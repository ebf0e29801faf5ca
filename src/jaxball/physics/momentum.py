"""Momentum about the contact point, and its balance.

All vectors are in body axes; the velocity of a mass in space is Ω × s + χ̇ with s = rΓ + χ.
"""

from jaxtyping import Array, Float

from ..numerics.vectors import apply, cross
from .dynamics import inertia_about_contact
from .moments import AbstractMoments


def linear_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """P = Σ m (Ω × s + χ̇)."""
    return cross(Omega, at.M * r * Gamma + at.p) + at.pdot


def contact_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) = BΩ + rΓ × ṗ + ℓ, the angular momentum about the contact point."""
    return apply(inertia_about_contact(at, r, Gamma), Omega) + internal_momentum(at, r, Gamma)


def internal_momentum(at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"]) -> Float[Array, "3"]:
    """rΓ × ṗ + ℓ, the part of Π that the masses have by moving in the ball."""
    return r * cross(Gamma, at.pdot) + at.l


def contact_momentum_rate(
    at: AbstractMoments,
    r: Float[Array, ""],
    g: Float[Array, ""],
    Pi: Float[Array, "3"],
    Omega: Float[Array, "3"],
    Gamma: Float[Array, "3"],
    Ftilde: Float[Array, "3"] | None = None,
) -> Float[Array, "3"]:
    """Π̇ = Π × Ω + g Γ × p + rΓ × F̃ + (rΓ × Ω) × P.

    The last term is there because the contact point moves along the plane. Where p = 0 at all times
    and no force acts, ΛΠ is constant (Chaplygin's sphere), also while the masses move.
    """
    push = g * at.p if Ftilde is None else g * at.p + r * Ftilde
    P = linear_momentum(at, r, Omega, Gamma)
    return cross(Pi, Omega) + cross(Gamma, push) + cross(r * cross(Gamma, Omega), P)
