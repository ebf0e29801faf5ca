"""A body over a surface: where it is in flight, what a solve advances for that, and how far a step may go.

``body_on_plane`` and ``resting`` ask here where the ground is not a plane.

In flight a solve advances the place of the centre in space, along a parabola, in the fields ``z`` and ``height`` of a
packed state. The piece of the surface that is nearest, and the height over it, follow from the place.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.vectors import dot, root
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..dynamics.footing import locate_surface
from ..grounds import AbstractSurface
from .modes import ContactState, Mode
from .released import position

HEIGHTS = 4  # of a height over a surface, in units of rounding of the place of the body: what is smaller is none
NEARER = 0.5  # of the distance between the centre and a surface: as far may a step in flight go


def has_surface(system: AbstractBody) -> bool:
    """Returns whether the ground of a body is not a plane."""
    return isinstance(system.ground, AbstractSurface)


def near_to(system: AbstractBody, z: Array, height: Float[Array, "*batch"]) -> Float[Array, "*batch coordinates"]:
    """Returns ``near`` for states of a body that is next to its ground, at ``z``."""
    if not has_surface(system):
        return jnp.zeros((*height.shape, 0), height.dtype)
    return z[..., None] if system.planar else z


def with_place(system: AbstractBody, t: Float[Array, ""], state: ContactState, packed: ContactState) -> ContactState:
    """Returns the packed state with the place of the centre, in flight over a surface, instead of ``z`` and
    the height.
    """
    if not has_surface(system):
        return packed
    place = _of_body(system, position(system, t, state.released))
    where = jnp.where(state.is_in(Mode.FLIGHT), place, _fields(state))
    return _with_fields(packed, where, near_to(system, state.body.z, state.height))


def with_nearest_piece(system: AbstractBody, t: Float[Array, ""], packed: ContactState) -> ContactState:
    """Inverts :func:`with_place`: returns the packed state with the nearest piece of a surface, and the
    height over it.
    """
    surface, r = locate_surface(system, t, packed.body), system.radius
    if surface is None:
        return packed

    def piece_and_height(packed: ContactState) -> Float[Array, " fields"]:
        place = _fields(packed)
        c = jnp.stack([place[0], jnp.zeros_like(place[0]), place[1]]) if system.planar else place
        u = surface.foot(t, c, packed.near[0] if system.planar else packed.near)
        touch = surface.touch_at(t, u)
        return jnp.append(u, dot(touch.n, c - touch.p) - r)

    # The search for the nearest piece is the dearest part of a flight, and is left out on the ground.
    return _with_fields(packed, jax.lax.cond(packed.is_in(Mode.FLIGHT), piece_and_height, _fields, packed), packed.near)


def with_rates_of_place(system: AbstractBody, state: ContactState, rates: ContactState) -> ContactState:
    """Returns the rates of a packed state, from the rates of the ``state``: in flight over a surface, the place moves
    with V.
    """
    if not has_surface(system):
        return rates
    V = _of_body(system, state.V)
    return _with_fields(rates, jnp.where(state.is_in(Mode.FLIGHT), V, _fields(rates)), rates.near)


def with_piece_remembered(system: AbstractBody, t: Float[Array, ""], packed: ContactState) -> ContactState:
    """Returns the packed state, in flight with the nearest piece as the one from which the next ones are sought."""
    nearest = without_derivatives(with_nearest_piece(system, t, packed))
    u = near_to(system, nearest.body.z, nearest.height)
    # A search that failed must not spoil those of later steps: the last piece found stays where they begin.
    near = jnp.where(packed.is_in(Mode.FLIGHT) & jnp.all(jnp.isfinite(u)), u, packed.near)
    return eqx.tree_at(lambda x: x.near, packed, near)


def rounding_of_height(system: AbstractBody, t: Float[Array, ""], state: ContactState) -> Float[Array, ""]:
    """Estimates the rounding of the height over a surface, which is the rounding of a difference of places."""
    if not has_surface(system):
        return jnp.zeros_like(state.height)
    c, r = jax.lax.stop_gradient((position(system, t, state.released), system.radius))
    return HEIGHTS * float(jnp.finfo(c.dtype).eps) * (root(dot(c, c)) + r)


def clearance_for_landing(
    system: AbstractBody, t: Float[Array, ""], state: ContactState, above: Float[Array, ""]
) -> Float[Array, ""]:
    """Returns a height from which a body lands, ``above``, or a positive number where it cannot: beyond the edge of a
    surface.

    Nor does a body land that has passed below the ground, whose centre is on the other side.
    """
    surface = locate_surface(system, t, state.body)
    if surface is None or not surface.has_edge:
        return above
    r = system.radius
    return jnp.where(state.height < -r, r, jnp.maximum(above, r * surface.beyond_edge(t, state.body.z)))


def longest_flight(system: AbstractBody, t: Float[Array, ""], state: ContactState) -> Float[Array, ""] | Any:
    """Computes how long a step in flight over a surface may be, so that the body cannot come far nearer to any part of
    it.

    The flight itself is a parabola, which a step of any length has; but one that goes beyond a hill shows nothing of it
    at the few times at which its guards are evaluated. Infinite in other modes, and over a plane.
    """
    surface = locate_surface(system, t, state.body)
    if surface is None:
        return jnp.inf
    touch = surface.touch_at(t, state.body.z)
    v, g = state.V - touch.w, jnp.abs(system.gravity)
    far = NEARER * (system.radius + jnp.maximum(state.height, 0.0))
    # No longer than the body takes to go so far, however it falls.
    longest = far / (root(dot(v, v)) + root(2 * g * far))
    return jax.lax.stop_gradient(jnp.where(state.is_in(Mode.FLIGHT), longest, jnp.inf))


def _of_body(system: AbstractBody, v: Float[Array, "3"]) -> Float[Array, " fields"]:
    """Returns the components of a vector in space that a body's place has: for a disk, those in its plane."""
    return jnp.stack([v[0], v[2]]) if system.planar else v


def _fields(state: ContactState) -> Float[Array, " fields"]:
    return jnp.append(state.body.z, state.height)


def _with_fields(state: ContactState, where: Float[Array, " fields"], near: Float[Array, " coordinates"]) -> Any:
    z = jnp.reshape(where[:-1], state.body.z.shape)
    return eqx.tree_at(lambda x: (x.body.z, x.height, x.near), state, (z, where[-1], near))
