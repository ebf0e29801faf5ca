"""Schedules given by a user's function."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_function
from ...numerics.arrays import a_number, numbers
from .base import AbstractSchedule


class FunctionSchedule(AbstractSchedule):
    """θ(t) = theta + function(t, parameters), for any function that JAX can differentiate twice.

    ``function`` is compiled into programs, so pass the same one each time: a new lambda compiles again. Give the times
    at which its second derivative jumps in ``kink_times``.

    **Arguments:**

    - ``function``: of (t, parameters), to an angle in rad, or a length in a tube.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``theta``: a constant added to it, in the same unit.
    - ``kink_times``: times, shape (kinks,), at which its second derivative jumps or has a kink.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionSchedule
    >>> def settling(t, rate):
    ...     return 1.0 - jnp.exp(-rate * t)
    >>> theta, rate, acceleration = FunctionSchedule(settling, 2.0).derivatives(jnp.array(0.0))
    >>> float(theta), float(rate), float(acceleration)
    (0.0, 2.0, -4.0)
    """

    function: Callable[[Float[Array, ""], PyTree], Float[Array, ""]] = eqx.field(static=True)
    parameters: PyTree = None
    theta: Float[Array, "*group"] = eqx.field(converter=numbers("theta"), default=0.0)
    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=numbers("kink_times", ("kinks",)), default=())

    def __check_init__(self):
        require_function("function", self.function, (), t=a_number(), parameters=self.parameters)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.theta + self.function(t, self.parameters)

    def advanced(self, by: Float[Array, ""]) -> "FunctionSchedule":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times
