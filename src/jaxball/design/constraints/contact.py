"""Constraints that keep the ball on the plane, from slipping, and away from obstacles."""

from collections.abc import Iterable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.norms import norm, room
from ..objectives.paths import AvoidObstacles, depths
from ..plane import Requirement, beside, corner, places
from ..run import Run
from .base import AbstractRunningConstraint


class NormalForce(AbstractRunningConstraint):
    """N ≥ least M g at all times, with ``least`` a fraction of the weight."""

    least: Float[Array, ""] = eqx.field(converter=numbers("least"))

    def __call__(self, run: Run):
        return self.least - run.observables.normal_force / run.weight


class Friction(AbstractRunningConstraint):
    """|f| ≤ mu N at all times; in this form the violation stays smooth where N is small.

    **Arguments:**

    - ``mu``: μ, dimensionless.
    """

    mu: Float[Array, ""] = eqx.field(converter=numbers("mu"))

    def __call__(self, run: Run):
        contact = run.observables
        return norm(contact.friction / run.weight) - self.mu * contact.normal_force / run.weight

    def margins(self, run: Run):
        """That of |f|² / N ≤ mu² N: with N > 0 it is the same."""
        contact = run.observables
        friction, normal = contact.friction / run.weight, contact.normal_force / run.weight
        return (self.mu * normal**2 - jnp.sum(friction**2, axis=-1) / self.mu) / 2


class ClearOfObstacles(AbstractRunningConstraint):
    """The geometric centre outside discs in the plane; shape (t, k).

    **Arguments:**

    - ``centres``: of the discs, length, shape (k, 2).
    - ``radii``: length, shape (k,).
    """

    centres: Float[Array, "k 2"] = eqx.field(converter=places("centres"))
    radii: Float[Array, " k"] = eqx.field(converter=numbers("radii", ("k",)))

    def __call__(self, run: Run):
        return depths(run, self.centres, self.radii)

    def margins(self, run: Run):
        return -room(run.z[:, None] - self.centres[None], self.radii[None]) / run.length

    def beyond_a_disk(self):
        return beside(self.centres)


def discs_to_avoid(requirements: Iterable[Requirement]) -> tuple[tuple[Float[np.ndarray, "2"], float], ...]:
    """Centre and radius of each disc in the plane that the geometric centre must stay out of."""
    avoiding = [item for item in requirements if isinstance(item, AvoidObstacles | ClearOfObstacles)]
    return tuple(
        disc for item in avoiding for disc in zip(np.asarray(item.centres), map(float, item.radii), strict=True)
    )


class Within(AbstractRunningConstraint):
    """The geometric centre within a rectangle of the plane, from ``low`` to ``high``; shape (t, 4).

    For a disk, the bounds are single numbers, and the shape is (t, 2).

    **Arguments:**

    - ``low``, ``high``: the corners, length, shape (2,); for a disk, single numbers.
    """

    low: Float[Array, " d"] = eqx.field(converter=corner("low"))
    high: Float[Array, " d"] = eqx.field(converter=corner("high"))

    def __call__(self, run: Run):
        z = run.z[:, : self.low.size]
        return jnp.concatenate([self.low[None] - z, z - self.high[None]], axis=1) / run.length

    def beyond_a_disk(self):
        """A range of e2: even one that contains 0 leaves an interior-point method no room."""
        return "a range of e2, in which it is always 0" if np.size(self.low) > 1 else ""
