"""Places to stay away from."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.norms import norm
from ..line import beside, places
from ..run import Run
from .base import AbstractRunningObjective


def depths(run: Run, centres: Float[Array, "k 2"], radii: Float[Array, " k"]) -> Float[Array, "t k"]:
    """By how much the geometric centre is inside discs of the plane, over r; negative outside."""
    return (radii[None] - norm(run.z[:, None] - centres[None])) / run.length


class AvoidObstacles(AbstractRunningObjective):
    """The mean of Σ softplus(depth / softness)² over discs of the plane that the geometric centre is to stay out of.

    Smooth: it is felt outside a disc within some ``softness``, which is in radii of the shell. To keep clear of an
    upright post, add the ball's radius to the post's.

    **Arguments:**

    - ``centres``: of the discs, length, shape (k, 2).
    - ``radii``: length, shape (k,).
    - ``weight``: by what it is multiplied in the sum of objectives.
    """

    centres: Float[Array, "k 2"] = eqx.field(converter=places("centres"))
    radii: Float[Array, " k"] = eqx.field(converter=numbers("radii", ("k",)))
    softness: Float[Array, ""] = eqx.field(converter=numbers("softness"), default=0.1)

    def integrand(self, run: Run):
        inside = jax.nn.softplus(depths(run, self.centres, self.radii) / self.softness)
        return jnp.sum(inside**2, axis=-1)

    def beyond_a_disk(self):
        return beside(self.centres)
