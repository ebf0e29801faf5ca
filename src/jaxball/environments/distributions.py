"""Distributions from which starts, goals and parameters are drawn."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..interface.printing import Printed
from ..numerics.arrays import is_traced, numbers


class AbstractDistribution(Printed):
    """What random numbers in place of others are drawn from.

    A kind of distribution implements ``draw``, which is traced.
    """

    @abc.abstractmethod
    def draw(self, key: Any, nominal: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Random numbers in place of ``nominal``, of its shape, by a random key."""


class Uniform(AbstractDistribution):
    """Numbers between two bounds, independent of each other, all equally likely.

    **Arguments:**

    - ``low``, ``high``: the bounds, in the units of what is drawn.

    **Raises:** ``ValueError`` where ``low`` is above ``high``.

    **Example:**

    >>> import jax, jax.numpy as jnp
    >>> from jaxball.environments import Uniform
    >>> drawn = Uniform(0.9, 1.1).draw(jax.random.key(0), jnp.zeros(1000))
    >>> bool(drawn.min() >= 0.9), bool(drawn.max() <= 1.1), round(float(drawn.mean()), 2)
    (True, True, 1.0)
    """

    low: Float[Array, ""] = eqx.field(converter=numbers("low"))
    high: Float[Array, ""] = eqx.field(converter=numbers("high"))

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

    - ``mean``, ``deviation``: the mean and the standard deviation, in the units of what is drawn.

    **Raises:** ``ValueError`` for a negative deviation.
    """

    mean: Float[Array, ""] = eqx.field(converter=numbers("mean"))
    deviation: Float[Array, ""] = eqx.field(converter=numbers("deviation"))

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
        return nominal * self.factor.draw(key, jnp.ones((), nominal.dtype))
