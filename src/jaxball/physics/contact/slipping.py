"""The state of a body that may slip or fly, in local coordinates of which those that its mode holds are exactly 0."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..body import AbstractBody
from ..state import PlacedState
from ..system import AbstractState
from .modes import ContactState, Mode
from .released import ReleasedState, rolling_contact, slip_velocity


class SlippingState(AbstractState):
    """Where a body is, how it turns, slips and flies; a :class:`~jaxball.physics.ReleasedState` in other coordinates.

    - ``body``: as for a body that rolls.
    - ``slip``: the velocity of the body's lowest point along the ground, relative to it, contact axes, length/time,
      shape (2,), of a disk (1,); 0 where it rolls.
    - ``rise``: the rate at which that point leaves the ground, length/time; 0 on the ground.
    - ``height``: above that of rolling, length.
    """

    body: PlacedState
    slip: Float[Array, "*batch tangents"]
    rise: Float[Array, "*batch"]
    height: Float[Array, "*batch"]

    @classmethod
    def rolling(cls, body: PlacedState) -> "SlippingState":
        """Returns the state of a body that rolls."""
        still = jnp.zeros_like(body.z)
        return cls(body, jnp.reshape(still, (still.size,)), jnp.zeros((), still.dtype), jnp.zeros((), still.dtype))

    @property
    def directions(self) -> tuple[str, ...]:
        slips = (f"slip[{k}]" for k in range(self.slip.shape[-1]))
        return (*self.body.directions, *slips, "rise", "height")

    def retract(self, xi: Any) -> "SlippingState":
        of_body, slip, (rise, height) = jnp.split(xi, (len(self.body.directions), len(xi) - 2))
        return SlippingState(self.body.retract(of_body), self.slip + slip, self.rise + rise, self.height + height)

    def difference(self, other: Any) -> Float[Array, " directions"]:
        slip, rise, height = other.slip - self.slip, other.rise - self.rise, other.height - self.height
        return jnp.concatenate([self.body.difference(other.body), slip, jnp.stack([rise, height])])

    def projected(self) -> "SlippingState":
        return SlippingState(self.body.projected(), self.slip, self.rise, self.height)

    def released(self, system: AbstractBody, t: Float[Array, ""]) -> ReleasedState:
        """Returns the state with the velocity of the centre; one below the ground is put on it."""
        rolling, under = rolling_contact(system, t, self.body)
        across = jnp.zeros_like(self.slip)[:1] if system.planar else self.slip[1:]
        V = rolling + under.to_space(jnp.concatenate([self.slip[:1], across, self.rise[None]]))
        return ReleasedState(self.body, V, jnp.where(self.height > 0, self.height, 0.0))

    @classmethod
    def of(cls, system: AbstractBody, t: Float[Array, ""], state: ReleasedState) -> "SlippingState":
        """Returns the state of a body whose mode is not known."""
        velocity = slip_velocity(system, t, state)
        return cls(state.body, velocity[: 1 if system.planar else 2], velocity[2], state.height)

    @classmethod
    def in_mode(cls, system: AbstractBody, t: Float[Array, ""], state: ContactState) -> "SlippingState":
        """Returns the state of a body whose mode is known; what that holds is 0, and so is its derivative."""
        moves, flies = cls.of(system, t, state.released), state.is_in(Mode.FLIGHT)
        slip = jnp.where(state.is_in(Mode.ROLLING), 0.0, moves.slip)
        return cls(state.body, slip, *(jnp.where(flies, x, 0.0) for x in (moves.rise, moves.height)))


Estimated = PlacedState | SlippingState  # the state that a filter has of a robot, the latter with a law of contact
