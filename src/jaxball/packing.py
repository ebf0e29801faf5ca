"""States as the one vector that a solver advances."""

from collections.abc import Callable

import equinox as eqx
import jax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .body import System
from .momentum import inertia_scale, momentum_field, to_momentum, to_velocity
from .state import State


class Packing(eqx.Module):
    """How the state of a system becomes a vector, with momentum in the place of velocity, and back."""

    system: System
    unit: Float[Array, ""]
    unravel: Callable[[Float[Array, " size"]], State] = eqx.field(static=True)

    @classmethod
    def of(cls, system: System, state: State) -> "Packing":
        """The packing of states of the kind of ``state``; ``system`` is prepared."""
        _, unravel = ravel_pytree(state)
        return cls(system, jax.lax.stop_gradient(inertia_scale(system)), unravel)

    def pack(self, t: Float[Array, ""], state: State) -> Float[Array, " size"]:
        """The vector of a state."""
        return ravel_pytree(to_momentum(self.system, t, state, self.unit))[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> State:
        """The state of a vector."""
        return to_velocity(self.system, t, self.unravel(x), self.unit)

    def field(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " size"]:
        """The rate of the vector."""
        return ravel_pytree(momentum_field(self.system, t, self.unravel(x), self.unit))[0]
