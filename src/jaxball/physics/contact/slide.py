"""The slide s of a body on its ground, against which sliding friction acts, with its coefficient and direction.

It is the slip velocity v_s along the ground, and where friction has a limit surface with the radius ρ, ρ ω₃ besides, of
the spin over the ground: then friction has the components f and m₃/ρ against these. A slide begins, ends and is held as
a slip is, so that all that is said of a slip and of its direction holds for it.
"""

import dataclasses
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.vectors import apply
from ..body import AbstractBody
from ..dynamics.sticking import has_stops
from ..forces.resistance import Levels
from .law import Contact
from .modes import ContactState
from .released import rolling_contact, slip_velocity

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane


def find_rival(body: AbstractBody, contact: Contact) -> str | None:
    """Returns why a body cannot have the limit surface of a law, as the end of a sentence; None if it can."""
    if contact.limit_radius is None or body.planar:
        return None
    resistance = body.resistance
    if resistance is not None and Levels.at_rest(resistance).spinning is not None:
        return (
            "dry resistance against spinning (`dry_spinning`), because both are friction against the spin; leave one "
            "of them out"
        )
    if resistance is not None and resistance.is_dry and not resistance.holds:
        return "dry resistance that is smoothed, which is not solved together with it; make that `exact`"
    if has_stops(body):
        return "`HardStops` of joints, whose strikes have no friction against the spin; leave one of them out"
    return None


def slide_size(plane: "BodyOnPlane") -> int:
    """Returns the number of components of a slide."""
    return 2 if plane.pivot is None else 3


def slide(plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState) -> Float[Array, " n"]:
    """Computes the slide."""
    return slide_of(plane, slip_velocity(plane.body, t, state.released), t, state)


def slide_of(
    plane: "BodyOnPlane", slip: Float[Array, "3"], t: Float[Array, ""], state: ContactState
) -> Float[Array, " n"]:
    """Computes the slide with a slip velocity that is known."""
    if plane.pivot is None:
        return slip[:2]
    # A body that lands, and one that starts, still have the mode of flight, but it is the ground's spin that counts.
    return jnp.append(slip[:2], plane.pivot * plane.over_ground(t, plane.on_ground(state))[2])


def with_slide(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, wanted: Float[Array, " n"]
) -> ContactState:
    """Returns the state with another slide, and the same rise."""
    slip = slip_velocity(plane.body, t, state.released).at[:2].set(wanted[:2])
    if plane.pivot is not None:
        axes = plane.contact_axes(t, plane.on_ground(state))
        omega = axes.over_ground(state.body.Omega).at[2].set(wanted[2] / plane.pivot)
        state = dataclasses.replace(state, body=state.body.with_Omega(axes.in_body(omega)))
    rolling, under = rolling_contact(plane.body, t, state.body)
    return dataclasses.replace(state, V=rolling + under.to_space(slip))


def spinning_loss(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, torque: Float[Array, "3"] | None
) -> Float[Array, ""]:
    """Computes −m₃ ω₃, the power that a limit surface dissipates against the spin; 0 without one.

    ``torque`` is that of dry friction, body axes, of which a limit surface has all that is about the normal.
    """
    if plane.pivot is None or torque is None:
        return jnp.zeros_like(t)
    axes = plane.contact_axes(t, state)
    return -apply(axes.rows, torque)[2] * axes.over_ground(state.body.Omega)[2]


def coefficient_and_direction(
    plane: "BodyOnPlane", t: Float[Array, ""], state: ContactState, sliding: Float[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, " n"]]:
    """Returns μ and σ; where friction has faded with the slip, μ′(0) and v_s, for the derivative of their product."""
    mu, sigma = plane.coefficient(sliding), state.direction(t, sliding)
    if plane.law.friction_law is None or plane.pivot is not None:
        return mu, sigma
    # Without slip σ is not defined, and μ = 0. Friction is −N μ(v) v_s/v, which near v = 0 is −N μ′(0) v_s: a product
    # of two factors that has the right value, 0, and the right derivative.
    has_faded = ~plane.slips_end & (jnp.sum(sliding**2) == 0)
    slope = jax.jvp(plane.law.coefficient, (jnp.zeros_like(mu),), (jnp.ones_like(mu),))[1]
    return jnp.where(has_faded, slope, mu), jnp.where(has_faded, sliding, sigma)
