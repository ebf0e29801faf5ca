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

# A determinant below this is that of parallel lines.
TINY = 1e-30


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
        """Only the part about masses: no motion changes the rails."""
        return room(run.masses.chi, run.length - self.clearance) / run.length


class RailsApart(AbstractConstraint):
    """No two closed rails closer to each other than ``distance``: the least distance from each chord of one to another.

    Shape (pairs, chords).
    """

    distance: Float[Array, ""] = eqx.field(converter=numbers("distance"))

    def __call__(self, run: Run):
        points = run.curves.points
        first, second = np.triu_indices(len(points), 1)
        nearest = jax.vmap(_between)(points[first], points[second])
        return (self.distance - nearest) / run.length


class RegularRails(AbstractConstraint):
    """|ζ′(θ)| ≥ least on every closed rail, so that the mass can move along it at a finite rate.

    **Arguments:**

    - ``least``: length/rad.
    """

    least: Float[Array, ""] = eqx.field(converter=numbers("least"))

    def __call__(self, run: Run):
        return (self.least - run.curves.speed) / run.length


def _between(p: Float[Array, "n 3"], q: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """The least distance of each chord of a closed line ``p`` from the closed line ``q``.

    It is the least of those from the chord of ``q`` whose middle is nearest, and from the two beside it.
    """
    to_p, to_q = jnp.roll(p, -1, axis=0), jnp.roll(q, -1, axis=0)
    middles = jax.lax.stop_gradient(((p + to_p) / 2, (q + to_q) / 2))
    nearest = jnp.argmin(jnp.sum((middles[0][:, None] - middles[1][None]) ** 2, axis=-1), axis=1)
    beside = (nearest[:, None] + jnp.arange(-1, 2)[None]) % len(q)
    one = jax.vmap(distance, in_axes=(None, None, 0, 0))
    return jnp.min(jax.vmap(one)(p, to_p, q[beside], to_q[beside]), axis=1)


def distance(
    a: Float[Array, "3"], to_a: Float[Array, "3"], b: Float[Array, "3"], to_b: Float[Array, "3"]
) -> Float[Array, ""]:
    """The least distance between points of the segments from ``a`` to ``to_a`` and from ``b`` to ``to_b``.

    Either the lines are nearest within both segments, or one end is nearest.
    """
    u, v, w = to_a - a, to_b - b, a - b
    uu, uv, vv, uw, vw = (jnp.sum(x * y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    determinant = uu * vv - uv**2
    crossing = determinant > TINY
    safe = jnp.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    within = crossing & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    ends = [
        _of_end(a, b, v, vv),
        _of_end(to_a, b, v, vv),
        _of_end(b, a, u, uu),
        _of_end(to_b, a, u, uu),
    ]
    nearest = jnp.min(jnp.stack(ends))
    return jnp.where(within, norm(w + s * u - t * v), nearest)


def _of_end(end, start, along, size) -> Float[Array, ""]:
    share = jnp.clip(jnp.sum((end - start) * along) / jnp.where(size > 0, size, 1.0), 0.0, 1.0)
    return norm(end - start - share * along)
