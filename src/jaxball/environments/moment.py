"""A moment of an episode, as goals, observations and rewards see it."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..control.sampled import PlacedState
from ..numerics.vectors import dot, root
from ..physics.body import System
from ..physics.state import DiskState, centre_velocity

UPRIGHT = 1e-12  # the square of the horizontal part of a body axis that has no direction on the plane


class Moment(NamedTuple):
    """A moment of an episode.

    - ``t``: the time since the reset.
    - ``system``: the body with the inputs that act, and the parameters that were drawn.
    - ``state``: its state.
    - ``u``: the inputs that act, shape (m,).
    """

    t: Float[Array, ""]
    system: System
    state: PlacedState
    u: Float[Array, " m"]

    @property
    def place(self) -> Float[Array, " d"]:
        """The position of the centre on the plane, d = 2, or of a disk on its line, d = 1."""
        return self._in_plane(self.state.in_space().z)

    @property
    def velocity(self) -> Float[Array, " d"]:
        """The velocity of the centre, space axes."""
        system, state = self.system, self.state
        drift = system.drift(self.t, state.in_space())
        return self._in_plane(centre_velocity(state.Lambda, state.Omega, system.radius, drift))

    @property
    def spin(self) -> Float[Array, ""]:
        """Ω·Γ, the angular velocity about the vertical."""
        return dot(self.state.Omega, self.state.Gamma)

    @property
    def heading(self) -> Float[Array, "2"]:
        """The direction in which the body rolls about its axis E2: horizontal, of length 1; 0 where E2 is vertical."""
        axis = self.state.Lambda[:2, 1]
        size = root(jnp.sum(axis**2), UPRIGHT)
        ahead = jnp.stack([axis[1], -axis[0]])
        return jnp.where(size > 0, ahead / jnp.where(size > 0, size, 1.0), 0.0)

    def ahead(self, vector: Float[Array, "*rows d"]) -> Float[Array, "*rows d"]:
        """Horizontal vectors by their components ahead and to the left, for a disk as they are."""
        if vector.shape[-1] == 1:
            return vector
        c, s = self.heading
        x, y = vector[..., 0], vector[..., 1]
        return jnp.stack([c * x + s * y, c * y - s * x], axis=-1)

    def _in_plane(self, vector: Float[Array, "2"]) -> Float[Array, " d"]:
        return vector[:1] if isinstance(self.state, DiskState) else vector
