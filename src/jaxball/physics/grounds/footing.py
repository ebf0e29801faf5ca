"""How a ground holds a body at one moment: what the equations of motion and the laws of contact know of it."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.vectors import apply


class Footing(NamedTuple):
    """How a ground holds a body at one moment, in space axes.

    What is None is as on a level plane at rest: the contact axes are those of space, the vectors are 0, and places and
    their rates are those that the state of the body has.

    - ``axes``: the contact axes as rows: unit vectors along ∂p/∂u1 and across, and the normal n towards the body.
    - ``centre``, ``foot``: the positions c of the ball's centre and p of the contact point.
    - ``coordinate_rates``: u̇.
    - ``velocity``: w of the ground's matter at the contact; ``spin`` is the angular velocity of that matter.
    - ``normal_rate``: ṅ along the motion of the contact point; ``acceleration`` is ẇ, likewise.
    - ``turning``: the angular velocity of the contact axes, likewise.
    """

    axes: Float[Array, "3 3"] | None = None
    centre: Float[Array, "3"] | None = None
    foot: Float[Array, "3"] | None = None
    coordinate_rates: Float[Array, "*two"] | None = None
    velocity: Float[Array, "3"] | None = None
    spin: Float[Array, "3"] | None = None
    normal_rate: Float[Array, "3"] | None = None
    acceleration: Float[Array, "3"] | None = None
    turning: Float[Array, "3"] | None = None

    @property
    def normal(self) -> Float[Array, "3"] | None:
        """n; None for e3."""
        return None if self.axes is None else self.axes[2]

    def to_axes(self, v: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the components of a vector in the contact axes."""
        return v if self.axes is None else apply(self.axes, v)

    def to_space(self, v: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the vector whose components in the contact axes are ``v``."""
        return v if self.axes is None else apply(self.axes.T, v)

    def rows(self, Lambda: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
        """Returns the contact axes in body axes, as rows: what takes vectors of the body to the contact axes."""
        return Lambda if self.axes is None else jnp.sum(self.axes[:, :, None] * Lambda[None], axis=1)


AT_REST = Footing()  # on a level plane at rest
