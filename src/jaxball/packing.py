"""States as the one vector that a solver advances."""

from collections.abc import Callable

import equinox as eqx
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .body import System
from .dae import algebraic_component, constrained, mass_diagonal, projected
from .locked import from_locked, locked_field, to_locked
from .state import State


class Packing(eqx.Module):
    """How the state of a system becomes a vector, with the locked angular velocity for Ω, and back."""

    system: System
    unravel: Callable[[Float[Array, " size"]], State] = eqx.field(static=True)

    @classmethod
    def of(cls, system: System, state: State) -> "Packing":
        """The packing of states of the kind of ``state``; ``system`` is prepared."""
        _, unravel = ravel_pytree(state)
        return cls(system, unravel)

    def pack(self, t: Float[Array, ""], state: State) -> Float[Array, " size"]:
        """The vector of a state."""
        return ravel_pytree(to_locked(self.system, t, state))[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> State:
        """The state of a vector."""
        return from_locked(self.system, t, self.unravel(x))

    def field(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " size"]:
        """The rate of the vector."""
        return ravel_pytree(locked_field(self.system, t, self.unravel(x)))[0]

    def dae_field(
        self, t: Float[Array, ""], x: Float[Array, " size"], component: Int[Array, ""]
    ) -> Float[Array, " size"]:
        """The right-hand side of the differential-algebraic form: M ẋ of the vector."""
        state = self.unravel(x)
        return ravel_pytree(constrained(locked_field(self.system, t, state), state, component))[0]

    def mass_diagonal(self, x: Float[Array, " size"], component: Int[Array, ""]) -> Float[Array, " size"]:
        """The diagonal of M."""
        return ravel_pytree(mass_diagonal(self.unravel(x), component))[0]

    def algebraic_component(self, x: Float[Array, " size"]) -> Int[Array, ""]:
        """The component that is algebraic in a step that starts at ``x``."""
        return algebraic_component(self.unravel(x))

    def projected(self, x: Float[Array, " size"]) -> Float[Array, " size"]:
        """The vector of the nearest state with |q| = 1."""
        return ravel_pytree(projected(self.unravel(x)))[0]
