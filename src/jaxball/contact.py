"""The force of the plane on the ball at the contact point."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .moments import Moments
from .vectors import apply, cross


class ContactForce(NamedTuple):
    """The reaction of the plane: ``normal`` N (> 0 while the ball is held down) and ``friction`` f."""

    normal: Float[Array, ""]
    friction: Float[Array, "2"]

    @property
    def ratio(self) -> Float[Array, ""]:
        """|f| / N, the coefficient of friction that this instant needs; infinite where N ≤ 0."""
        size = jnp.sqrt(jnp.sum(self.friction**2, axis=-1))
        held = ~(self.normal <= 0)  # NaN counts as held, so that it stays NaN
        return jnp.where(held, size / jnp.where(held, self.normal, 1.0), jnp.inf)


def contact_force(
    at: Moments,
    r: Float[Array, ""],
    g: Float[Array, ""],
    Lambda: Float[Array, "3 3"],
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
    Fe: Float[Array, "3"],
) -> ContactForce:
    """R = Λ Σ m a − Fe + M g e3 by Newton's second law for the whole system, in space axes.

    With a_i = Ω̇ × s_i + Ω × (Ω × χ_i + 2χ̇_i) + χ̈_i, Σ m a depends on the moments alone. The paper's
    disk (section 3.3) writes the friction as −f_s e1.
    """
    R = apply(Lambda, total_inertial_force(at, r, Lambda[2], Omega, Omegadot)) - Fe
    return ContactForce(normal=R[2] + at.M * g, friction=R[:2])


def total_inertial_force(
    at: Moments,
    r: Float[Array, ""],
    Gamma: Float[Array, "3"],
    Omega: Float[Array, "3"],
    Omegadot: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Σ m a in body axes, with a the accelerations in space."""
    return cross(Omegadot, at.M * r * Gamma + at.p) + cross(Omega, cross(Omega, at.p) + 2 * at.pdot) + at.pddot
