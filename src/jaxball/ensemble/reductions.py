"""What can be found of a run while it is computed, so that no more than a number is kept of it."""

import abc
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..sampling import sampling
from .interpolation import Between
from .observers import AbstractObserver
from .runge_kutta import Step

# From a prepared system, a time and a state to a number.
Quantity = Callable[[Any, Float[Array, ""], Any], Float[Array, ""]]
ROUNDS = 3
NARROWER = 1 / 12


def _as_it_is(value: Array) -> Array:
    return value


class AbstractReduction(eqx.Module):
    """A number found of a quantity over a run, such as its largest value.

    ``quantity(system, t, state)`` is kept as it is, so pass the same function each time.
    """

    quantity: eqx.AbstractVar[Quantity]

    @property
    @abc.abstractmethod
    def signs(self) -> tuple[float, ...]:
        """By what the quantity is multiplied where its largest value is looked for."""

    @property
    def is_integral(self) -> bool:
        """Whether the quantity is integrated over time."""
        return False

    @abc.abstractmethod
    def result(self, found: "Found") -> dict[str, Array]:
        """What is reported, by the ends of names."""


class Found(NamedTuple):
    """What was found of a quantity: its value at the start, its extreme values and their times, its integral."""

    start: Float[Array, " rows"]
    extremes: tuple[Float[Array, " rows"], ...]
    times: tuple[Float[Array, " rows"], ...]
    integral: Float[Array, " rows"]


class Maximum(AbstractReduction):
    """The largest value within the steps of a run, not just at their ends, and when it occurs.

    ``then`` is a growing function that is applied to the value: the maximum of a smooth quantity is found more easily.
    """

    quantity: Quantity = eqx.field(static=True)
    then: Callable[[Array], Array] = eqx.field(static=True, default=_as_it_is)

    @property
    def signs(self) -> tuple[float, ...]:
        return (1.0,)

    def result(self, found: Found) -> dict[str, Array]:
        return {"": self.then(found.extremes[0]), "_time": found.times[0]}


class Minimum(AbstractReduction):
    """The smallest value within the steps of a run, not just at their ends, and when it occurs."""

    quantity: Quantity = eqx.field(static=True)

    @property
    def signs(self) -> tuple[float, ...]:
        return (-1.0,)

    def result(self, found: Found) -> dict[str, Array]:
        return {"": found.extremes[0], "_time": found.times[0]}


class Drift(AbstractReduction):
    """How far the quantity goes from its value at the start, as a number that is never negative."""

    quantity: Quantity = eqx.field(static=True)

    @property
    def signs(self) -> tuple[float, ...]:
        return (1.0, -1.0)

    def result(self, found: Found) -> dict[str, Array]:
        return {"": jnp.maximum(found.extremes[0] - found.start, found.start - found.extremes[1])}


class Integral(AbstractReduction):
    """The integral over time, by the Gauss–Lobatto rule of five nodes in each step."""

    quantity: Quantity = eqx.field(static=True)

    @property
    def signs(self) -> tuple[float, ...]:
        return ()

    @property
    def is_integral(self) -> bool:
        return True

    def result(self, found: Found) -> dict[str, Array]:
        return {"": found.integral}
