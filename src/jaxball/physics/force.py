"""External forces Fe(t) at the geometric centre, in space axes."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..interface.arguments import require_function
from ..interface.printing import Printed
from ..numerics.arrays import Numbers, a_number, default_dtype, numbers, require_shape, to_array
from ..numerics.harmonics import HarmonicSeries


class AbstractForce(Printed):
    """A force Fe(t) that acts at the geometric centre (section 3.2, ``eq_dS1``)."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Fe(t) in space axes."""

    def kinks(self) -> Float[Array, " kinks"]:
        """The times at which the force or one of its derivatives jumps."""
        return jnp.zeros((0,), dtype=default_dtype())


class HarmonicForce(AbstractForce):
    """Fe(t) = constant + Σ powers_j t^(j + 1) + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: space axes, mass length/time², shape (3,).
    - ``amplitude``: the same of each sinusoid, shape (terms, 3).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.
    - ``powers``: the coefficients of t, t², …, shape (degree, 3); none if not given.

    **Raises:** ``ValueError`` when ``amplitude``, ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import HarmonicForce
    >>> force = HarmonicForce((0.0, 0.0, 0.0), amplitude=[(2.0, 0.0, 0.0)], frequency=[jnp.pi])
    >>> force(jnp.array(0.5))
    Array([2., 0., 0.], dtype=float64)
    """

    series: HarmonicSeries

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
        powers: Numbers | None = None,
    ):
        require_shape("constant", to_array(constant, "constant"), (3,))
        self.series = HarmonicSeries(constant, amplitude, frequency, phase, powers)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.series(t)


class FunctionForce(AbstractForce):
    """Fe(t) = function(t, parameters), for any function that JAX can trace.

    ``function`` is kept as it is, so pass the same one each time: a new lambda compiles anew.

    **Arguments:**

    - ``function``: of (t, parameters), to Fe, space axes, mass length/time², shape (3,).
    - ``parameters``: arrays, in any PyTree, that it is given; they can be swept and differentiated.
    - ``kink_times``: times, shape (kinks,), at which it jumps or bends.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionForce
    >>> def wind(t, strength):
    ...     return strength * jnp.array([1.0, 0.0, 0.0]) * jnp.exp(-t)
    >>> FunctionForce(wind, 0.3)(jnp.array(0.0))
    Array([0.3, 0. , 0. ], dtype=float64)
    """

    function: Callable[[Float[Array, ""], PyTree], Float[Array, "3"]] = eqx.field(static=True)
    parameters: PyTree = None
    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=numbers("kink_times", ("kinks",)), default=())

    def __check_init__(self):
        require_function("function", self.function, (3,), t=a_number(), parameters=self.parameters)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.function(t, self.parameters)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times
