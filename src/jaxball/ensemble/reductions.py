"""Results found in a run while it is computed, so that only a few numbers of it are kept."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed

# From a system, a time and a state to a number.
Quantity = Callable[[Any, Float[Array, ""], Any], Float[Array, ""]]


class Observed(NamedTuple):
    """Observations of a quantity: its value at the start, its extreme values and their times, its integral."""

    start: Float[Array, "*runs"]
    extremes: tuple[Float[Array, "*runs"], ...]
    times: tuple[Float[Array, "*runs"], ...]
    integral: Float[Array, "*runs"]


class AbstractReduction(Printed):
    """A number derived from a quantity over a run.

    ``quantity(system, t, state)`` is compiled into programs, so pass the same function each time: a new lambda compiles
    again. An implementer supplies ``quantity``, a static field or a method, ``result``, and what ``result`` needs:

    - ``signs``: the factors of the quantity in the searches for its largest value, one per search: 1 for a maximum, −1
      for a minimum.
    - ``is_integral``: whether it needs the integral.
    - ``ends``: the suffixes of the names of its results.
    """

    quantity: eqx.AbstractVar[Quantity]
    signs: ClassVar[tuple[float, ...]] = ()
    is_integral: ClassVar[bool] = False
    ends: ClassVar[tuple[str, ...]] = ("",)

    @abc.abstractmethod
    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        """The results, by the suffixes of their names, each with the shape of what was observed.

        **Arguments:**

        - ``observed``: the values at the start, the extreme values and their times, one for each of ``signs``, and the
          integral, NaN if it is not asked for.
        """


def _as_it_is(value: Array) -> Array:
    return value


class Maximum(AbstractReduction):
    """The largest value within the steps of a run, not just at their ends, and when it occurs, ``…_time``.

    ``then`` is an increasing function that is applied to the value: the maximum of a smooth quantity is easier to find.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    then: Callable[[Array], Array] = eqx.field(static=True, default=_as_it_is)
    signs: ClassVar[tuple[float, ...]] = (1.0,)
    ends: ClassVar[tuple[str, ...]] = ("", "_time")

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": self.then(observed.extremes[0]), "_time": observed.times[0]}


class Minimum(AbstractReduction):
    """The smallest value within the steps of a run, not just at their ends, and when it occurs, ``…_time``.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    signs: ClassVar[tuple[float, ...]] = (-1.0,)
    ends: ClassVar[tuple[str, ...]] = ("", "_time")

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": observed.extremes[0], "_time": observed.times[0]}


class Drift(AbstractReduction):
    """The largest distance of the quantity from its value at the start.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    signs: ClassVar[tuple[float, ...]] = (1.0, -1.0)

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        most, least = observed.extremes
        return {"": jnp.maximum(most - observed.start, observed.start - least)}


class Integral(AbstractReduction):
    """The integral over time, by the rule of Gauss and Lobatto with five nodes in each step.

    **Arguments:**

    - ``quantity``: of (system, t, state), to one number.
    """

    quantity: Quantity = eqx.field(static=True)
    is_integral: ClassVar[bool] = True

    def result(self, observed: Observed) -> dict[str, Float[Array, "*runs"]]:
        return {"": observed.integral}
