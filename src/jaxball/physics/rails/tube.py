"""Straight tubes."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from .base import AbstractRail


class Tube(AbstractRail):
    """A straight tube: ζ(θ) = centre + θ direction / |direction|; θ is the distance from ``centre``.

    **Arguments:**

    - ``direction``: of any nonzero length, body axes, shape (3,).
    - ``centre``: where θ is 0, body axes, length, shape (3,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Tube
    >>> Tube((0.0, 0.0, 3.0), centre=(0.2, 0.0, 0.0))(jnp.array(0.5))  # half a unit along it
    Array([0.2, 0. , 0.5], dtype=float64)
    """

    direction: Float[Array, "*group 3"] = eqx.field(converter=numbers("direction", (3,)))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=(0.0, 0.0, 0.0))

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.centre + theta * self.direction / jnp.sqrt(jnp.sum(self.direction**2))

    @property
    def period(self) -> None:
        return None
