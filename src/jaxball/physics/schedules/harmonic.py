"""Constant rates and sums of sinusoids."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import Numbers, numbers, to_array
from ...numerics.harmonics import HarmonicSeries
from .base import AbstractSchedule


class ConstantRate(AbstractSchedule):
    """θ(t) = theta + rate t; with ``rate`` zero, the mass is held in place.

    **Arguments:**

    - ``theta``: θ at time 0, rad on a closed rail and length in a tube.
    - ``rate``: θ̇, the same per time; 0 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import ConstantRate
    >>> float(ConstantRate(0.5, rate=2.0)(jnp.array(3.0)))
    6.5
    """

    theta: Float[Array, "*group"] = eqx.field(converter=numbers("theta"))
    rate: Float[Array, "*group"] = eqx.field(converter=numbers("rate"), default=0.0)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.theta + self.rate * t

    def advanced(self, by: Float[Array, ""]) -> "ConstantRate":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)


class Sinusoids(AbstractSchedule):
    """θ(t) = theta + rate t + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``theta``: the constant, rad on a closed rail and length in a tube.
    - ``amplitude``: in the same unit, shape (terms,).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.
    - ``rate``: the constant part of θ̇, the same per time.

    **Raises:** ``ValueError`` when ``amplitude``, ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Sinusoids
    >>> theta, rate, _ = Sinusoids(1.0, amplitude=[0.5], frequency=[2.0]).derivatives(jnp.array(0.0))
    >>> float(theta), float(rate)
    (1.0, 1.0)
    """

    series: HarmonicSeries
    rate: Float[Array, "*group"]

    def __init__(
        self,
        theta: Numbers,
        amplitude: Numbers,
        frequency: Numbers,
        phase: Numbers | None = None,
        rate: Numbers = 0.0,
    ):
        self.series = HarmonicSeries(theta, amplitude, frequency, phase)
        self.rate = to_array(rate)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.series(t) + self.rate * t

    def advanced(self, by: Float[Array, ""]) -> "Sinusoids":
        return eqx.tree_at(lambda s: s.series.constant, self, self.series.constant + jnp.asarray(by))
