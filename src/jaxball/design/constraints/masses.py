"""What masses and their actuators can do."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.norms import norm, room
from ..objectives.base import unit_of_time
from ..run import Run
from .base import AbstractRunningConstraint


class MassesApart(AbstractRunningConstraint):
    """No two masses nearer to each other than ``distance``; shape (t, pairs)."""

    distance: Float[Array, ""] = eqx.field(converter=numbers("distance"))

    def __call__(self, run: Run):
        return (self.distance - norm(_between(run))) / run.length

    def margins(self, run: Run):
        return -room(_between(run), self.distance) / run.length


class SpeedLimit(AbstractRunningConstraint):
    """|χ̇| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: length/time.
    """

    most: Float[Array, ""] = eqx.field(converter=numbers("most"))

    def __call__(self, run: Run):
        return (norm(run.masses.chidot) - self.most) * unit_of_time(run) / run.length

    def margins(self, run: Run):
        return room(run.masses.chidot, self.most) * unit_of_time(run) / run.length


class AccelerationLimit(AbstractRunningConstraint):
    """|χ̈| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: length/time².
    """

    most: Float[Array, ""] = eqx.field(converter=numbers("most"))

    def __call__(self, run: Run):
        return (norm(run.masses.chiddot) - self.most) / jnp.abs(run.system.gravity)

    def margins(self, run: Run):
        return room(run.masses.chiddot, self.most) / jnp.abs(run.system.gravity)


class ForceLimit(AbstractRunningConstraint):
    """|F·τ| ≤ most, the force on each mass along its rail; shape (t, n).

    **Arguments:**

    - ``most``: mass length/time².
    """

    most: Float[Array, ""] = eqx.field(converter=numbers("most"))

    def __call__(self, run: Run):
        return (jnp.abs(_along(run)) - self.most) / run.weight

    def margins(self, run: Run):
        return room(_along(run)[..., None], self.most) / run.weight


def _between(run: Run) -> Float[Array, "t pairs 3"]:
    """From the second mass of each pair to the first."""
    chi = run.masses.chi
    first, second = np.triu_indices(chi.shape[1], 1)
    return chi[:, first] - chi[:, second]


def _along(run: Run) -> Float[Array, "t n"]:
    """F·τ."""
    return jnp.sum(run.forces * run.on_rails.tangent, axis=-1)
