"""Limits of masses and their actuators."""

import abc

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
    """No two masses closer to each other than ``distance``; shape (t, pairs)."""

    distance: Float[Array, ""] = eqx.field(converter=numbers("distance"))

    def __call__(self, run: Run):
        return (self.distance - norm(_between(run))) / run.length

    def margins(self, run: Run):
        return -room(_between(run), self.distance) / run.length


class _Limit(AbstractRunningConstraint):
    """|v| ≤ most, for a vector v of each mass."""

    most: Float[Array, ""] = eqx.field(converter=numbers("most"))

    @abc.abstractmethod
    def vectors(self, run: Run) -> Float[Array, "t n d"]:
        """v."""

    @abc.abstractmethod
    def unit(self, run: Run) -> Float[Array, "..."]:
        """The unit of violations; one for all vectors, or one for each, shape (1, n)."""

    def __call__(self, run: Run):
        return (norm(self.vectors(run)) - self.most) / self.unit(run)

    def margins(self, run: Run):
        return room(self.vectors(run), self.most) / self.unit(run)


class SpeedLimit(_Limit):
    """|χ̇| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: length/time.
    """

    def vectors(self, run: Run):
        return run.masses.chidot

    def unit(self, run: Run):
        return run.length / unit_of_time(run)


class AccelerationLimit(_Limit):
    """|χ̈| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: length/time².
    """

    def vectors(self, run: Run):
        return run.masses.chiddot

    def unit(self, run: Run):
        return jnp.abs(run.system.gravity)


class JointEffortLimit(_Limit):
    """|Q| ≤ most for every joint of the mechanisms, a torque or the force along a slider; shape (t, joints).

    **Arguments:**

    - ``most``: mass length²/time² for a torque, mass length/time² for a force.
    """

    def vectors(self, run: Run):
        return run.joint_efforts[..., None]

    def unit(self, run: Run):
        return run.effort_units[None]


class ForceLimit(_Limit):
    """|F·τ| ≤ most, the force on each mass along its rail; shape (t, n).

    **Arguments:**

    - ``most``: mass length/time².
    """

    def vectors(self, run: Run):
        return run.forces_along[..., None]

    def unit(self, run: Run):
        return run.weight


def _between(run: Run) -> Float[Array, "t pairs 3"]:
    """From the second mass of each pair to the first."""
    chi = run.masses.chi
    first, second = np.triu_indices(chi.shape[1], 1)
    return chi[:, first] - chi[:, second]
