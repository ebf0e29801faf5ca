"""Schedules made of polynomials."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.piecewise import PiecewisePolynomial
from .base import AbstractSchedule


class PiecewiseSchedule(AbstractSchedule):
    """A schedule that is a piecewise polynomial already."""

    curve: PiecewisePolynomial

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.curve(t)

    def advanced(self, by: Float[Array, ""]) -> "PiecewiseSchedule":
        return eqx.tree_at(lambda s: s.curve.coefficients, self, self.curve.coefficients.at[..., 0].add(by))

    def kinks(self) -> Float[Array, " kinks"]:
        return self.curve.breaks


class PiecewiseAcceleration(AbstractSchedule):
    """θ̈(t) as a piecewise polynomial, integrated twice exactly.

    On times[j] ≤ t < times[j + 1], θ̈ = Σ_k accelerations[j, k] (t − times[j])ᵏ; before the first
    time and after the last, θ̈ = 0. The paper's pulse is times (0, .1, .2) and accelerations
    ((1, 0), (1, −10)).

    **Arguments:**

    - ``theta``, ``rate``: θ and θ̇ at ``times[0]``, rad and rad/time, or length and length/time in a tube.
    - ``times``: increasing, shape (n + 1,).
    - ``accelerations``: shape (n, k), in rad/time² times powers of 1/time.

    **Raises:** ``ValueError`` when ``accelerations`` does not have one row for each interval.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import PiecewiseAcceleration
    >>> schedule = PiecewiseAcceleration(0.0, times=[0.0, 1.0, 2.0], accelerations=[[1.0], [-1.0]])
    >>> float(schedule(jnp.array(2.0)))  # sped up for one unit of time, then slowed down
    1.0
    """

    theta: Float[Array, "*group"] = eqx.field(converter=numbers("theta"))
    times: Float[Array, "*group n_plus_one"] = eqx.field(converter=numbers("times", ("n_plus_one",)))
    accelerations: Float[Array, "*group n k"] = eqx.field(converter=numbers("accelerations", ("n", "k")))
    rate: Float[Array, "*group"] = eqx.field(converter=numbers("rate"), default=0.0)

    def __check_init__(self):
        times, rows = self.times.shape, self.accelerations.shape
        if len(rows) < 2 or len(times) < 1 or times[-1] != rows[-2] + 1:
            raise ValueError(
                "Argument `accelerations` must have the shape (n, k), a row for each of the n "
                f"intervals between the n + 1 `times`, but the shapes are {rows} and {times}."
            )

    def prepare(self) -> PiecewiseSchedule:
        k = self.accelerations.shape[1]
        power = jnp.arange(k, dtype=self.accelerations.dtype)
        bends = self.accelerations / ((power + 1) * (power + 2))[None]
        h = jnp.diff(self.times)[:, None]
        # Sums over the intervals, not a loop over them, which takes long to compile where there are many.
        changes = jnp.sum(bends * (power + 2)[None] * h ** (power + 1)[None], axis=1)
        rate = self.rate + jnp.concatenate([jnp.zeros_like(self.rate)[None], jnp.cumsum(changes)])
        changes = rate[:-1] * h[:, 0] + jnp.sum(bends * h ** (power + 2)[None], axis=1)
        theta = self.theta + jnp.concatenate([jnp.zeros_like(self.theta)[None], jnp.cumsum(changes)])
        line = jnp.stack([theta, rate], axis=1)
        bends = jnp.concatenate([bends, jnp.zeros((1, k), dtype=bends.dtype)])
        pieces = jnp.concatenate([line, bends], axis=1)
        first = jnp.concatenate([pieces[:1, :2], jnp.zeros((1, k), dtype=bends.dtype)], axis=1)
        return PiecewiseSchedule(
            PiecewisePolynomial(
                breaks=self.times,
                origins=jnp.concatenate([self.times[:1], self.times]),
                coefficients=jnp.concatenate([first, pieces]),
            )
        )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def advanced(self, by: Float[Array, ""]) -> "PiecewiseAcceleration":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.times
