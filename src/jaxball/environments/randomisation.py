"""Domain randomisation: distributions from which an environment draws numbers of its robot and its start, by name."""

import abc
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..compat import is_traced
from ..control.weights import places_by_name
from ..interface.arguments import require
from ..interface.printing import Printed
from ..interface.wording import did_you_mean
from ..numerics.arrays import to_array
from ..numerics.declare import number
from ..physics.body import System


class AbstractDistribution(Printed):
    """A distribution from which random numbers are drawn in place of given ones.

    A kind of distribution implements ``draw``, which is traced.
    """

    @abc.abstractmethod
    def draw(self, key: Any, nominal: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Draws random numbers in place of ``nominal``, of its shape, by a random key."""


class Uniform(AbstractDistribution):
    """Numbers between two bounds, independent of each other, all equally likely.

    **Arguments:**

    - ``low``, ``high``: the bounds, in the units of the parameter that is drawn.

    **Raises:** ``ValueError`` where ``low`` is above ``high``.

    **Example:**

    >>> import jax, jax.numpy as jnp
    >>> from jaxball.environments import Uniform
    >>> drawn = Uniform(0.9, 1.1).draw(jax.random.key(0), jnp.zeros(1000))
    >>> bool(drawn.min() >= 0.9), bool(drawn.max() <= 1.1), round(float(drawn.mean()), 2)
    (True, True, 1.0)
    """

    low: Float[Array, ""] = eqx.field(converter=number())
    high: Float[Array, ""] = eqx.field(converter=number())

    def __check_init__(self):
        if not (is_traced(self.low) or is_traced(self.high)) and not np.asarray(self.low) <= np.asarray(self.high):
            raise ValueError(
                f"Argument `high` must be {self.low:g} or more, which is `low`, but it is {self.high:g}; exchange them."
            )

    def draw(self, key, nominal):
        return self.low + (self.high - self.low) * jax.random.uniform(key, nominal.shape, nominal.dtype)


class Normal(AbstractDistribution):
    """Gaussian numbers, independent of each other.

    **Arguments:**

    - ``mean``, ``deviation``: the mean and the standard deviation, in the units of the parameter that is drawn.

    **Raises:** ``ValueError`` for a negative deviation.
    """

    mean: Float[Array, ""] = eqx.field(converter=number())
    deviation: Float[Array, ""] = eqx.field(converter=number())

    def __check_init__(self):
        if not is_traced(self.deviation) and not np.asarray(self.deviation) >= 0:
            raise ValueError(f"Argument `deviation` must be 0 or positive, but it is {self.deviation:g}.")

    def draw(self, key, nominal):
        return self.mean + self.deviation * jax.random.normal(key, nominal.shape, nominal.dtype)


class Factor(AbstractDistribution):
    """One random factor for all nominal numbers: moments of inertia that grow together stay possible.

    **Arguments:**

    - ``factor``: its distribution.
    """

    factor: AbstractDistribution

    def __check_init__(self):
        require("factor", self.factor, AbstractDistribution, "a distribution, such as Uniform(0.9, 1.1)")

    def draw(self, key, nominal):
        # One number for all: moments drawn one by one could be those of no body.
        return nominal * self.factor.draw(key, jnp.ones((), nominal.dtype))


def numbers_of(system: System) -> dict[str, Float[Array, "..."]]:
    """Returns the arrays among the arguments that make a body, by their paths, such as ``mechanisms[0].mass``."""
    return {_name(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(system.arguments)}


def with_numbers(system: System, values: Mapping[str, Float[Array, "..."]]) -> System:
    """Returns the body with other arrays, by their paths; traceable."""
    leaves, structure = jax.tree_util.tree_flatten_with_path(system.arguments)
    changed = [values.get(_name(path), leaf) for path, leaf in leaves]
    # Made again by its constructor, which computes and checks what follows from the arguments.
    return type(system)(**jax.tree.unflatten(structure, changed))


def require_numbers_of(system: System, names: Iterable[str]) -> dict[str, Float[Array, "..."]]:
    """Returns the arrays of a body with these paths.

    **Raises:** ``ValueError`` for one that it does not have.
    """
    arrays = numbers_of(system)
    for name in names:
        if name not in arrays:
            there = f"its numbers are {', '.join(arrays)}"
            raise ValueError(
                f"Argument `parameters` must have paths of numbers of this {system.title} as keys, but one is {name!r}"
                f"{did_you_mean(name, arrays, there)}"
            )
    # A parameter of a user's function may be a number of Python.
    return {name: to_array(arrays[name], name) for name in names}


def directions_by_name(names: Iterable[str], directions: tuple[str, ...]) -> dict[str, list[int]]:
    """Finds the places of local coordinates, by their names or by those of their groups.

    **Raises:** ``ValueError`` for an unknown name, and for a coordinate that two names give.
    """
    indices = places_by_name("starts", names, directions)
    places = [place for places in indices.values() for place in places]
    for place in places:
        if places.count(place) > 1:
            raise ValueError(f"Argument `starts` must give {directions[place]} once, but two of its keys do.")
    return indices


def _name(path: Any) -> str:
    return f"{path[0].key}{jax.tree_util.keystr(path[1:])}"
