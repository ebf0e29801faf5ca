"""What is rewarded."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed
from ..numerics.arrays import Numbers, to_array
from .moment import Moment


class AbstractReward(Printed):
    """The reward of a step.

    A kind of reward implements ``__call__``, which is traced, for one robot.
    """

    @abc.abstractmethod
    def __call__(self, misses: Float[Array, " misses"], moment: Moment) -> Float[Array, ""]:
        """The reward per time, at the end of a step, by what the goal is missed by there."""


class QuadraticReward(AbstractReward):
    """−(Σ w m² + Σ v u²): less, the more the goal is missed and the larger the inputs are.

    **Arguments:**

    - ``misses``: the weights w, a number for all, or shape (misses,).
    - ``inputs``: the weights v, a number for all, or shape (m,).

    **Example:**

    >>> from jaxball.environments import QuadraticReward
    >>> QuadraticReward(misses=(1.0, 1.0, 0.1, 0.1), inputs=0.01)
    QuadraticReward(misses=(1.0, 1.0, 0.1, 0.1), inputs=0.01)
    """

    misses: Float[Array, "..."] = eqx.field(converter=lambda x: _weights("misses", x), default=1.0)
    inputs: Float[Array, "..."] = eqx.field(converter=lambda x: _weights("inputs", x), default=0.0)

    def __call__(self, misses, moment):
        return -jnp.sum(_for(self.misses, misses) * misses**2) - jnp.sum(_for(self.inputs, moment.u) * moment.u**2)


def _weights(name: str, given: Numbers) -> Float[Array, "..."]:
    array = to_array(given, name)
    if array.ndim > 1:
        raise ValueError(f"Argument `{name}` must be a number or a row of numbers, but its shape is {array.shape}.")
    return array


def _for(weights: Float[Array, "..."], values: Float[Array, " k"]) -> Float[Array, " k"]:
    return jnp.broadcast_to(weights, values.shape)
