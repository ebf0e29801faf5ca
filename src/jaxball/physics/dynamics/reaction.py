"""The force of the plane on the ball at the contact point."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.terms import add, convert
from ...numerics.vectors import cross
from ..rolling import Reaction, friction_ratio
from ..state import State
from .equations import accelerations
from .load import Load, load
from .moments import Moments
from .parameters import BodyParameters
from .rest import TurningMode


class ContactForce(NamedTuple):
    """The reaction of the plane: ``normal`` N (> 0 while the ball is held down) and ``friction`` f."""

    normal: Float[Array, ""]
    friction: Float[Array, "2"]

    @property
    def ratio(self) -> Float[Array, ""]:
        """|f| / N, the coefficient of friction that this instant needs; infinite where N ≤ 0."""
        return friction_ratio(jnp.sqrt(jnp.sum(self.friction**2, axis=-1)), self.normal)


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
    return (
        cross(Omegadot, body_moments.M * r * arm + body_moments.p)
        + cross(Omega, cross(Omega, body_moments.p) + 2 * body_moments.pdot)
        + body_moments.pddot
    )
