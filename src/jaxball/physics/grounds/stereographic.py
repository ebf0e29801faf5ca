"""Stereographic coordinates of directions from a centre, about the one straight down or straight up.

``Bowl`` and ``SphereOutside`` use them for their points, and ``SignedDistance`` with a centre for its rays.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.vectors import dot, root

Number = Float[Array, ""]


def direction_at(R: Number, u1: Number, u2: Number, up: Number | float) -> Float[Array, "3"]:
    """Computes the unit vector from the centre of a sphere of radius ``R`` to its point with these coordinates.

    They are those of the projection onto the plane that touches the sphere where the coordinates are 0: at its lowest
    point for ``up`` = 1 and at its highest for −1.
    """
    square = (u1**2 + u2**2) / (4 * R**2)
    return jnp.stack([u1 / R, u2 / R, up * (square - 1)]) / (1 + square)


def share_to_pole(R: Number, u1: Number, u2: Number) -> Number:
    """Computes how far the height is from that of the point without coordinates, divided by the sphere's diameter.

    It is small already where rounding spoils the normal, 1e-3 radians from there.
    """
    return 1 / (1 + (u1**2 + u2**2) / (4 * R**2))


def coordinates_along(R: Number, arm: Float[Array, "3"], up: Number | float) -> Float[Array, "2"]:
    """Computes the coordinates of the point of such a sphere that is in the direction ``arm`` from its centre."""
    down = -up * arm[2]
    length = root(dot(arm, arm))
    # The square of tan(φ/2) is (|arm| − down)/(|arm| + down); the pole that no coordinates reach is infinitely far.
    reach = jnp.maximum(length + down, float(jnp.finfo(R.dtype).eps) * length)
    return 2 * R * arm[:2] / jnp.where(length > 0, reach, 1.0)
