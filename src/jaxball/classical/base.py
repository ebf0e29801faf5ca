"""What a classical system is: the contract between its equations and a solve."""

import abc
import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, Generic, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed
from ..numerics.arrays import default_dtype
from ..physics.conditions import Condition


class AbstractClassicalState(Printed):
    """What a solve of a classical system advances: arrays, at rest by default."""

    def conditions(self) -> Iterator[Condition]:
        """Every condition that an initial state must meet; traceable. What is not finite meets none."""
        for field, leaf in zip(dataclasses.fields(self), jax.tree.leaves(self), strict=True):
            yield Condition(jnp.all(jnp.isfinite(leaf)), f"state.{field.name}", leaf, "finite")


AnyClassicalState = TypeVar("AnyClassicalState", bound=AbstractClassicalState)


class AbstractClassicalSystem(Printed, Generic[AnyClassicalState]):
    """Parameters of a classical system, with its equations of motion and the laws that these imply.

    A system implements ``field`` and ``laws``; ``conditions`` where not every number will do,
    ``start_conditions`` where an initial state must suit the parameters, and ``driving_kinks`` where
    ``field`` is not smooth in time.
    ``title`` names it in sentences, and ``state_type`` is the class of its states.
    """

    title: ClassVar[str]
    state_type: ClassVar[Any]

    @abc.abstractmethod
    def field(self, t: Float[Array, ""], state: AnyClassicalState) -> AnyClassicalState:
        """ẋ = f(t, x), in the form of a state."""

    @abc.abstractmethod
    def laws(self, t: Float[Array, ""], state: AnyClassicalState) -> Any:
        """A named tuple of quantities that are constant along every motion, or are where its entries say so."""

    def conditions(self) -> Iterator[Condition]:
        """Every condition that the parameters must meet; traceable."""
        yield from ()

    def start_conditions(self, t: Float[Array, ""], state: AnyClassicalState) -> Iterator[Condition]:
        """Every condition that an initial state must meet beside those of its own; traceable."""
        yield from ()

    def prepare(self) -> "AbstractClassicalSystem[AnyClassicalState]":
        """The same system, ready to be evaluated many times."""
        return self

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """No times: kinks at which ``field`` is continuous are not told apart from others."""
        return jnp.zeros((0,), dtype=default_dtype())

    def driving_kinks(self) -> Float[Array, " kinks"]:
        """The times, in no order, at which ``field`` jumps or bends. An integrator steps to them."""
        return jnp.zeros((0,), dtype=default_dtype())
