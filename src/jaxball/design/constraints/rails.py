"""Rails that can be built: inside the shell, apart from each other, and without corners."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.norms import norm, room
from ..run import Run
from .base import AbstractConstraint, AbstractRunningConstraint
from .segments import distance


class RailsInside(AbstractRunningConstraint):
    """|ζ| ≤ r − clearance on every closed rail, and |χ| ≤ r − clearance for every mass along the motion.

    **Arguments:**

    - ``clearance``: length.
    """

    clearance: Float[Array, ""] = eqx.field(converter=numbers("clearance"), default=0.0)

    def __call__(self, run: Run):
        reach = jnp.concatenate([jnp.ravel(norm(run.curves.points)), jnp.ravel(norm(run.masses.chi))])
        return (reach + self.clearance) / run.length - 1

    def margins(self, run: Run):
        """Those of the masses: no motion changes the rails."""
        return room(run.masses.chi, run.length - self.clearance) / run.length


class RailsApart(AbstractConstraint):
    """No two closed rails nearer to each other than ``distance``: the least distance from each chord of one to another.

    Shape (pairs, chords).
    """

    distance: Float[Array, ""] = eqx.field(converter=numbers("distance"))

    def __call__(self, run: Run):
        points = run.curves.points
        first, second = np.triu_indices(len(points), 1)
        nearest = jax.vmap(_between)(points[first], points[second])
        return (self.distance - nearest) / run.length


class RegularRails(AbstractConstraint):
    """|ζ′(θ)| ≥ least on every closed rail, so that the mass can go along it at a finite rate.

    **Arguments:**

    - ``least``: length/rad.
    """

    least: Float[Array, ""] = eqx.field(converter=numbers("least"))

    def __call__(self, run: Run):
        return (self.least - run.curves.speed) / run.length


def _between(p: Float[Array, "n 3"], q: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """The least distance of each chord of a closed line ``p`` from the closed line ``q``.

    It is looked for in the chord of ``q`` whose middle is nearest, and in the two beside it.
    """
    to_p, to_q = jnp.roll(p, -1, axis=0), jnp.roll(q, -1, axis=0)
    middles = jax.lax.stop_gradient(((p + to_p) / 2, (q + to_q) / 2))
    nearest = jnp.argmin(jnp.sum((middles[0][:, None] - middles[1][None]) ** 2, axis=-1), axis=1)
    beside = (nearest[:, None] + jnp.arange(-1, 2)[None]) % len(q)
    one = jax.vmap(distance, in_axes=(None, None, 0, 0))
    return jnp.min(jax.vmap(one)(p, to_p, q[beside], to_q[beside]), axis=1)
