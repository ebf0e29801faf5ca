"""Rails given by a user's function."""

from collections.abc import Callable

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ...interface.arguments import require_function
from ...numerics.arrays import a_number
from .base import AbstractRail


class FunctionRail(AbstractRail):
    """ζ(θ) = function(θ, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs, so pass the same one each time: a new lambda compiles again.
    ``parameters`` may be any PyTree of arrays; they can be swept and differentiated.
    ``closed_after`` is the period of a closed rail, or None.

    **Arguments:**

    - ``function``: of (theta, parameters), to the point ζ, body axes, length, shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``closed_after``: the period of a closed rail, or None for an open one.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionRail
    >>> def parabola(theta, height):
    ...     return jnp.stack([theta, 0.0 * theta, height * theta**2])
    >>> zeta, slope, bend = FunctionRail(parabola, 0.5).derivatives(jnp.array(0.2))
    >>> print(zeta, slope, bend)
    [0.2  0.   0.02] [1.  0.  0.2] [0. 0. 1.]
    """

    function: Callable[[Float[Array, ""], PyTree], Float[Array, "3"]] = eqx.field(static=True)
    parameters: PyTree = None
    closed_after: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        require_function("function", self.function, (3,), theta=a_number(), parameters=self.parameters)

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.function(theta, self.parameters)

    @property
    def period(self) -> float | None:
        return self.closed_after
