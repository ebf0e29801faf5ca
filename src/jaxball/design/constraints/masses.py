"""What masses and their actuators can do."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._arrays import to_array
from ..norms import norm
from ..objectives.base import unit_of_time
from ..run import Run
from .base import AbstractConstraint


class MassesApart(AbstractConstraint):
    """No two masses nearer to each other than ``distance``; shape (t, pairs)."""

    distance: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        chi = run.masses.chi
        first, second = np.triu_indices(chi.shape[1], 1)
        return (self.distance - norm(chi[:, first] - chi[:, second])) / run.length


class SpeedLimit(AbstractConstraint):
    """|χ̇| ≤ most for every mass; shape (t, n)."""

    most: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        return (norm(run.masses.chidot) - self.most) * unit_of_time(run) / run.length


class AccelerationLimit(AbstractConstraint):
    """|χ̈| ≤ most for every mass; shape (t, n)."""

    most: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        return (norm(run.masses.chiddot) - self.most) / jnp.abs(run.system.gravity)


class ForceLimit(AbstractConstraint):
    """|F·τ| ≤ most, the force on each mass along its rail; shape (t, n)."""

    most: Float[Array, ""] = eqx.field(converter=to_array)

    def __call__(self, run: Run):
        along = jnp.abs(jnp.sum(run.forces * run.on_rails.tangent, axis=-1))
        return (along - self.most) / run.weight
