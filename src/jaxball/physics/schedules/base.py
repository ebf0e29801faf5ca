"""The contract of a schedule: an angle θ(t) prescribed in closed form."""

import abc

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.printing import Printed
from ...numerics.arrays import Numbers, default_dtype, to_array
from ...numerics.calculus import two_derivatives


class AbstractSchedule(Printed):
    """A prescribed parameter θ(t) of a mass on its rail.

    A family implements ``__call__`` and ``advanced``, and ``kinks`` where θ̈ has jumps or corners.
    """

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """θ(t), in radians on a closed rail and in units of length in a tube."""

    @abc.abstractmethod
    def advanced(self, by: Float[Array, ""]) -> "AbstractSchedule":
        """The schedule θ(t) + ``by``."""

    def kinks(self) -> Float[Array, " kinks"]:
        """The times at which θ̈ or one of its derivatives jumps; θ̇ must not. The integrator ends steps at them."""
        return jnp.zeros((0,), dtype=default_dtype())

    def prepare(self) -> "AbstractSchedule":
        """The same schedule, ready to be evaluated many times."""
        return self

    def derivatives(self, t: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """θ(t), θ̇(t) and θ̈(t), the rates by forward mode; at a kink, those of the later side."""
        return two_derivatives(self, t)

    def starting_at(self, theta: Numbers, t: Numbers) -> "AbstractSchedule":
        """The schedule shifted by a constant so that it takes the value ``theta`` at time ``t``."""
        return self.advanced(to_array(theta) - self.prepare()(to_array(t)))
