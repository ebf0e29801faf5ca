"""Objectives about paths to follow in the plane, and obstacles to avoid."""

import math
from collections.abc import Callable, Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics.arrays import Numbers, numbers
from ...numerics.norms import ROUNDING, norm
from ..curves import AbstractCurve
from ..plane import Requirement, beside, places
from ..run import Run
from .base import AbstractObjective, AbstractRunningObjective

# The least speed at which a piece of the path counts, in mean speeds along the curve: a ball at rest has no path.
SLOWEST = 1e-3
DRAWN = 400  # points of a curve


def _or_none(name: str) -> Callable[[Numbers | None], Float[Array, ""] | None]:
    convert = numbers(name)
    return lambda x: None if x is None else convert(x)


class FollowTrajectory(AbstractRunningObjective):
    """The mean of |z(t) − c(s(t))|² / r²: the curve followed in time.

    s goes from 0 at ``start`` to 1 at ``end``, by default the start and end of the run, at a constant rate, or with
    ``rest_to_rest`` by 10 u³ − 15 u⁴ + 6 u⁵.

    **Arguments:**

    - ``curve``: an :class:`AbstractCurve`.
    - ``weight``: its factor in the sum of objectives.
    """

    curve: AbstractCurve
    rest_to_rest: Bool[Array, ""] = eqx.field(converter=jnp.asarray, default=False)
    start: Float[Array, ""] | None = eqx.field(converter=_or_none("start"), default=None)
    end: Float[Array, ""] | None = eqx.field(converter=_or_none("end"), default=None)

    def targets(self, times: Float[Array, " t"]) -> Float[Array, "t 2"]:
        """The desired positions of the geometric centre."""
        start = times[0] if self.start is None else self.start
        end = times[-1] if self.end is None else self.end
        u = jnp.clip((times - start) / (end - start), 0.0, 1.0)
        s = jnp.where(self.rest_to_rest, u**3 * (10 - 15 * u + 6 * u**2), u)
        return eqx.filter_vmap(self.curve)(s)

    def integrand(self, run: Run):
        # Not the square of errors(), whose second derivative is undefined at 0.
        return jnp.sum((run.z - self.targets(run.times)) ** 2, axis=-1) / run.length**2

    def errors(self, run: Run) -> Float[Array, " t"]:
        """|z(t) − c(s(t))| / r."""
        return norm(run.z - self.targets(run.times)) / run.length

    def farthest(self, run: Run) -> Float[Array, ""]:
        """The largest distance of the geometric centre from its desired position, in radii."""
        return jnp.max(self.errors(run))

    def in_units(self, value, length, time):
        return f"root mean square distance {length * math.sqrt(value):.4g}"

    def beyond_a_disk(self):
        return beside(self.curve.spanned_by())


class FollowCurve(AbstractObjective):
    """The curve followed at any speed: mean squared distances, over r², of the path from the curve and back.

    The first mean is over the length of the path, so that it does not matter how long the ball stays anywhere; the
    second, over the curve, accounts for parts of it that the path misses. Distances are from the chords between
    samples.

    **Arguments:**

    - ``curve``: an :class:`AbstractCurve`.
    - ``samples``: the number of points of the curve.
    - ``weight``: its factor in the sum of objectives.
    """

    curve: AbstractCurve
    samples: int = eqx.field(static=True, default=200)

    def __call__(self, run: Run):
        path, curve = run.z, self.curve.points(self.samples)
        lengths = jnp.sqrt(jnp.sum(jnp.diff(path, axis=0) ** 2, axis=-1) + _floor(run, curve))
        ends = nearest(path, curve)
        there = jnp.sum(lengths * (ends[1:] + ends[:-1]) / 2) / jnp.sum(lengths)
        return (there + jnp.mean(nearest(curve, path))) / run.length**2

    def farthest(self, run: Run) -> Float[Array, ""]:
        """The largest distance of a point of the path from the curve, or of the curve from the path, in radii."""
        path, curve = run.z, self.curve.points(self.samples)
        square = jnp.max(jnp.concatenate([nearest(path, curve), nearest(curve, path)]))
        return jnp.sqrt(jnp.maximum(square, ROUNDING)) / run.length

    def in_units(self, value, length, time):
        # Two mean squares: there and back.
        return f"root mean square distance {length * math.sqrt(value / 2):.4g}"

    def beyond_a_disk(self):
        return beside(self.curve.spanned_by())


class LargestDistance(FollowCurve):
    """The largest distance between path and curve, in radii, which evens out the error along the curve.

    It has a kink wherever another point becomes the farthest.

    **Arguments:**

    - ``curve``: an :class:`AbstractCurve`.
    - ``samples``: the number of points of the curve.
    - ``weight``: its factor in the sum of objectives.
    """

    def __call__(self, run: Run):
        return self.farthest(run)

    def in_units(self, value, length, time):
        return f"largest distance {value * length:.4g}"


def wanted_path(requirements: Iterable[Requirement]) -> Float[np.ndarray, "k 2"] | None:
    """Points of the curve to follow, the last one if there are several, and None if there is none."""
    followed = [item for item in requirements if isinstance(item, FollowTrajectory | FollowCurve)]
    return np.asarray(followed[-1].curve.points(DRAWN)) if followed else None


class AvoidObstacles(AbstractRunningObjective):
    """The mean of Σ softplus(depth / softness)² over discs in the plane that the geometric centre should avoid.

    It is smooth: it extends outside a disc by a few times ``softness``, which is in radii of the shell. For an upright
    post, add the ball's radius to the post's.

    **Arguments:**

    - ``centres``: of the discs, length, shape (k, 2).
    - ``radii``: length, shape (k,).
    - ``weight``: its factor in the sum of objectives.
    """

    centres: Float[Array, "k 2"] = eqx.field(converter=places("centres"))
    radii: Float[Array, " k"] = eqx.field(converter=numbers("radii", ("k",)))
    softness: Float[Array, ""] = eqx.field(converter=numbers("softness"), default=0.1)

    def integrand(self, run: Run):
        inside = jax.nn.softplus(depths(run, self.centres, self.radii) / self.softness)
        return jnp.sum(inside**2, axis=-1)

    def beyond_a_disk(self):
        return beside(self.centres)


def depths(run: Run, centres: Float[Array, "k 2"], radii: Float[Array, " k"]) -> Float[Array, "t k"]:
    """How deep the geometric centre is inside discs in the plane, over r; negative outside."""
    return (radii[None] - norm(run.z[:, None] - centres[None])) / run.length


def nearest(points: Float[Array, "p 2"], line: Float[Array, "q 2"]) -> Float[Array, " p"]:
    """The squared distance of each point from a polygonal line."""
    a, along = line[:-1], jnp.diff(line, axis=0)
    size = jnp.sum(along**2, axis=-1)
    size = jnp.where(size > 0, size, 1.0)
    away = points[:, None] - a[None]
    share = jnp.clip(jnp.sum(away * along[None], axis=-1) / size[None], 0.0, 1.0)
    return jnp.min(jnp.sum((away - share[..., None] * along[None]) ** 2, axis=-1), axis=1)


def _floor(run: Run, curve: Float[Array, "q 2"]) -> Float[Array, " steps"]:
    """The square of the least length at which a step of the path counts."""
    whole = jnp.sum(jnp.sqrt(jnp.sum(jnp.diff(curve, axis=0) ** 2, axis=-1)))
    return (SLOWEST * whole * jnp.diff(run.times) / (run.times[-1] - run.times[0])) ** 2
