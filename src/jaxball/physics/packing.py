"""States as the one vector that a solver advances."""

import abc
from collections.abc import Callable
from typing import Any, Generic

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..classical import AbstractClassicalState, AbstractClassicalSystem
from ..numerics.masks import differentiated_where
from .body import System
from .dae import algebraic_component, constrained, mass_diagonal, projected
from .locked import from_locked, locked_field, to_locked
from .simulable import AnySimulableState, AnySimulableSystem, SimulableState, SimulableSystem
from .state import State


class Packing(eqx.Module, Generic[AnySimulableSystem, AnySimulableState]):
    """How the state of a system becomes a vector, and back."""

    system: eqx.AbstractVar[AnySimulableSystem]
    unravel: eqx.AbstractVar[Callable[[Float[Array, " size"]], AnySimulableState]]

    @staticmethod
    def of(system: SimulableSystem, state: SimulableState) -> "Packing[Any, Any]":
        """The packing of states of the kind of ``state``; ``system`` is prepared."""
        _, unravel = ravel_pytree(state)
        if isinstance(system, AbstractClassicalSystem):
            return PlainPacking(system, unravel)
        return LockedPacking(system, unravel)

    @abc.abstractmethod
    def pack(self, t: Float[Array, ""], state: AnySimulableState) -> Float[Array, " size"]:
        """The vector of a state."""

    @abc.abstractmethod
    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnySimulableState:
        """The state of a vector."""

    def unpack_where(self, used: Bool[Array, ""], t: Float[Array, ""], x: Float[Array, " size"]) -> AnySimulableState:
        """The state of a vector; NaN, and nothing that has derivatives, where it is not ``used``."""
        packing, t, x = differentiated_where(used, (self, t, x))
        return jax.tree.map(lambda leaf: jnp.where(used, leaf, jnp.nan), packing.unpack(t, x))

    @abc.abstractmethod
    def rates(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AnySimulableState:
        """The rates of what the vector holds, not yet packed."""

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
        return ravel_pytree(projected(self.unravel(x)))[0]


class LockedPacking(Packing[System, State]):
    """The packing of a ball or a disk, with the locked angular velocity for Ω."""

    system: System
    unravel: Callable[[Float[Array, " size"]], State] = eqx.field(static=True)

    def pack(self, t: Float[Array, ""], state: State) -> Float[Array, " size"]:
        return ravel_pytree(to_locked(self.system, t, state))[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> State:
        return from_locked(self.system, t, self.unravel(x))

    def rates(self, t: Float[Array, ""], x: Float[Array, " size"]) -> State:
        return locked_field(self.system, t, self.unravel(x))


class PlainPacking(Packing[AbstractClassicalSystem, AbstractClassicalState]):
    """The packing of a classical system, whose vector holds the state as it is."""

    system: AbstractClassicalSystem
    unravel: Callable[[Float[Array, " size"]], AbstractClassicalState] = eqx.field(static=True)

    def pack(self, t: Float[Array, ""], state: AbstractClassicalState) -> Float[Array, " size"]:
        return ravel_pytree(state)[0]

    def unpack(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AbstractClassicalState:
        return self.unravel(x)

    def rates(self, t: Float[Array, ""], x: Float[Array, " size"]) -> AbstractClassicalState:
        return self.system.field(t, self.unravel(x))
