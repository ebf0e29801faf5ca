"""The vector ξ(t), fixed or moving in the body, to which Ω is orthogonal in Suslov's problem."""

import abc

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import require_function
from ..interface.printing import Printed
from ..numerics.arrays import Numbers, a_number, default_dtype, require_shape, to_array
from ..numerics.functions import HarmonicSeries, OfKinkedFunction


class AbstractAxis(Printed):
    """ξ(t) in body axes. Its length does not affect the motion, but must not be 0."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """ξ(t)."""

    def derivatives(self, t: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """ξ(t) and ξ̇(t), the latter by forward mode; at a kink, that of the later side."""
        return jax.jvp(self, (t,), (jnp.ones_like(t),))

    def kinks(self) -> Float[Array, " kinks"]:
        """The times at which ξ̇ or one of its derivatives jumps; ξ must not."""
        return jnp.zeros((0,), dtype=default_dtype())


class HarmonicAxis(AbstractAxis):
    """A constant plus sinusoids: ξ(t) = constant + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: body axes, shape (3,).
    - ``amplitude``: of each sinusoid, in the same units, shape (terms, 3).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.

    **Raises:** ``ValueError`` when ``constant`` is not three numbers, and when ``amplitude``,
    ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import HarmonicAxis
    >>> axis = HarmonicAxis((0.0, 0.0, 1.0), amplitude=[(0.5, 0.0, 0.0)], frequency=[2.0])
    >>> xi, xidot = axis.derivatives(jnp.array(0.0))
    >>> xidot
    Array([1., 0., 0.], dtype=float64)
    """

    series: HarmonicSeries

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
    ):
        require_shape("constant", to_array(constant, "constant"), (3,))
        self.series = HarmonicSeries(constant, amplitude, frequency, phase)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.series(t)


class FunctionAxis(OfKinkedFunction, AbstractAxis):
    """ξ(t) = function(t, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs, so pass the same one each time: a new lambda compiles again. Give the times
    at which its derivative jumps in ``kink_times``.

    **Arguments:**

    - ``function``: of (t, parameters), to ξ, body axes, shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: times, shape (kinks,), at which its derivative jumps or has a kink.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.classical import FunctionAxis
    >>> def tilting(t, rate):
    ...     return jnp.stack([jnp.sin(rate * t), 0.0 * t, jnp.cos(rate * t)])
    >>> print(FunctionAxis(tilting, 0.5)(jnp.array(0.0)))
    [0. 0. 1.]
    """

    def __check_init__(self):
        require_function("function", self.function, (3,), t=a_number(), parameters=self.parameters)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.function(t, self.parameters)
