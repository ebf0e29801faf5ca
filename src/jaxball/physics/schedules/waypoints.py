"""Schedules through waypoints."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.piecewise import PiecewisePolynomial, clamped_cubic_spline
from .base import AbstractSchedule
from .piecewise import PiecewiseSchedule


class Waypoints(AbstractSchedule):
    """The smooth schedule that takes ``angles`` at ``times``: a cubic spline with θ̈ continuous.

    Before the first waypoint and after the last, the mass moves at the constant rate ``end_rates`` (by default at
    rest).

    **Arguments:**

    - ``times``: increasing, shape (n,).
    - ``angles``: θ at these times, rad on a closed rail and length in a tube, shape (n,).
    - ``end_rates``: θ̇ at the first and the last, shape (2,).

    **Raises:** ``ValueError`` unless ``times`` and ``angles`` have the same length, two or more.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Waypoints
    >>> schedule = Waypoints(times=[0.0, 1.0, 2.0], angles=[0.0, 0.5, 0.0])
    >>> round(float(schedule(jnp.array(1.0))), 6)
    0.5
    """

    times: Float[Array, "*group n"] = eqx.field(converter=numbers("times", ("n",)))
    angles: Float[Array, "*group n"] = eqx.field(converter=numbers("angles", ("n",)))
    end_rates: Float[Array, "*group 2"] = eqx.field(converter=numbers("end_rates", (2,)), default=(0.0, 0.0))

    def __check_init__(self):
        if self.times.shape != self.angles.shape or self.times.ndim < 1 or self.times.shape[-1] < 2:
            raise ValueError(
                "Arguments `times` and `angles` must have the same length, two or more, but their shapes "
                f"are {self.times.shape} and {self.angles.shape}."
            )

    def prepare(self) -> PiecewiseSchedule:
        inner = clamped_cubic_spline(self.times, self.angles, self.end_rates)
        still = jnp.zeros((2,), dtype=self.angles.dtype)
        first = jnp.concatenate([jnp.stack([self.angles[0], self.end_rates[0]]), still])
        last = jnp.concatenate([jnp.stack([self.angles[-1], self.end_rates[1]]), still])
        return PiecewiseSchedule(
            PiecewisePolynomial(
                breaks=self.times,
                origins=jnp.concatenate([self.times[:1], self.times]),
                coefficients=jnp.concatenate([first[None], inner, last[None]]),
            )
        )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def advanced(self, by: Float[Array, ""]) -> "Waypoints":
        return eqx.tree_at(lambda s: s.angles, self, self.angles + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.times
