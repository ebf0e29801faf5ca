"""What keeps the ball on the plane and from slipping, and away from obstacles."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._arrays import to_array
from ..norms import norm
from ..objectives.obstacles import depths
from ..run import Run
from .base import AbstractConstraint


class NormalForce(AbstractConstraint):
    """N ≥ least M g at all times, ``least`` a share of the weight."""

    least: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        return self.least - run.observables.normal_force / run.weight


class Friction(AbstractConstraint):
    """|f| ≤ mu N at all times; in this form the violation stays smooth where N is small."""

    mu: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        seen = run.observables
        return norm(seen.friction / run.weight) - self.mu * seen.normal_force / run.weight


class ClearOfObstacles(AbstractConstraint):
    """The geometric centre outside of discs of the plane; shape (t, k)."""

    centres: Float[Array, "k 2"] = eqx.field(converter=to_array)
    radii: Float[Array, " k"] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        return depths(run, self.centres, self.radii)


class Within(AbstractConstraint):
    """The geometric centre within a rectangle of the plane, from ``low`` to ``high``; shape (t, 4)."""

    low: Float[Array, "2"] = eqx.field(converter=to_array)
    high: Float[Array, "2"] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        return jnp.concatenate([self.low[None] - run.z, run.z - self.high[None]], axis=1) / run.length
