"""States as the one vector that a solver advances."""

from collections.abc import Callable
from typing import Any, Generic

import equinox as eqx
import jax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..numerics.masks import differentiated_where, known_or_nothing
from .dae import algebraic_component, constrained, mass_diagonal
from .system import AbstractState, AbstractSystem, AnyState, AnySystem


class Packing(eqx.Module, Generic[AnySystem, AnyState]):
    """How the state of a system becomes a vector, and back: its packed state, one array after the other."""

    system: AnySystem
    unravel: Callable[[Float[Array, " size"]], AnyState] = eqx.field(static=True)

    @staticmethod
    def of(system: AbstractSystem, state: AbstractState) -> "Packing[Any, Any]":
        """The packing of states of the kind of ``state``; ``system`` is prepared."""
        return Packing(system, ravel_pytree(state)[1])

    def pack(self, t: Float[Array, ""], state: AnyState) -> Float[Array, " size"]:
        """The vector of a state."""
        return ravel_pytree(self.system.to_packed(t, state))[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """The state of a vector."""
        return self.system.from_packed(t, self.unravel(x))

    def unpack_where(self, used: Bool[Array, ""], t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """The state of a vector; NaN, and nothing that has derivatives, where it is not ``used``."""
        packing, t, x = differentiated_where(used, (self, t, x))
        return jax.tree.map(lambda leaf: known_or_nothing(used, leaf), packing.unpack(t, x))

    def rates(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnyState:
        """The rates of what the vector holds, not yet packed."""
        return self.system.packed_field(t, self.unravel(x))

    def field(self, t: Float[Array, ""], x: Float[Array, " size"]) -> Float[Array, " size"]:
        """The rate of the vector."""
        return ravel_pytree(self.rates(t, x))[0]

    def dae_field(
        self, t: Float[Array, ""], x: Float[Array, " size"], component: Int[Array, ""]
    ) -> Float[Array, " size"]:
        """The right-hand side of the differential-algebraic form: M ẋ of the vector."""
        return ravel_pytree(constrained(self.rates(t, x), self.unravel(x), component))[0]

    def mass_diagonal(self, x: Float[Array, " size"], component: Int[Array, ""]) -> Float[Array, " size"]:
        """The diagonal of M."""
        return ravel_pytree(mass_diagonal(self.unravel(x), component))[0]

    def algebraic_component(self, x: Float[Array, " size"]) -> Int[Array, ""]:
        """The component that is algebraic in a step that starts at ``x``."""
        return algebraic_component(self.unravel(x))

    def projected(self, x: Float[Array, " size"]) -> Float[Array, " size"]:
        """The vector of the nearest state with |q| = 1."""
        return ravel_pytree(self.unravel(x).projected())[0]
