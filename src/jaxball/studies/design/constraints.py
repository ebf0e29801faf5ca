"""Constraints that a design must fulfil: on the contact, the masses, their rails, and users' own."""

import abc
from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import call_with
from ...numerics.declare import LENGTH, POSITIVE, number
from ...numerics.vectors import norm, room
from .objectives import depths
from .problem.requirements import (
    AbstractConstraint,
    AbstractRunningConstraint,
    OfDiscs,
    OfFunction,
    Requirement,
    corner,
)
from .problem.run import Run

# A determinant below this is that of parallel lines.
PARALLEL = 1e-30


class NormalForce(AbstractRunningConstraint):
    """N ≥ least M g at all times.

    **Arguments:**

    - ``least``: the smallest normal force, in weights M g.
    """

    least: Float[Array, ""] = eqx.field(converter=number())

    def __call__(self, run: Run):
        return self.least - run.observables.normal_force / run.weight


class Friction(AbstractRunningConstraint):
    """|f| ≤ μ N at all times; in this form the violation stays smooth where N is small.

    **Arguments:**

    - ``friction``: the coefficient of friction μ, dimensionless.
    """

    friction: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE))

    def __call__(self, run: Run):
        contact = run.observables
        return norm(contact.friction / run.weight) - self.friction * contact.normal_force / run.weight

    def margins(self, run: Run):
        """Returns the margins of |f|² / N ≤ μ² N: with N > 0 it is the same constraint."""
        contact = run.observables
        # Both in weights. Divided by μ and halved, the difference of squares is minus the violation times N, to first
        # order.
        friction, normal = contact.friction / run.weight, contact.normal_force / run.weight
        return (self.friction * normal**2 - jnp.sum(friction**2, axis=-1) / self.friction) / 2


class OnGround(AbstractRunningConstraint):
    """1 − r κ ≥ ``fit``, for the ground's largest curvature κ towards the body, and ``reach`` of it left; shape (t, 2).

    A run ends where either is 0: the body touches a curved ground in two points, or is at its edge. On a plane both
    are 1.

    **Arguments:**

    - ``fit``: how much of 1 − r κ must be left, dimensionless.
    - ``reach``: how much of the ground ahead must be left, dimensionless. As ``reach`` of an
      :class:`~jaxball.physics.AbstractSurface` counts it, which is 0 at its edge.
    """

    fit: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE), default=0.05)
    reach: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE), default=0.05)

    def __call__(self, run: Run):
        return jnp.stack([self.fit, self.reach])[None] - run.ground_left

    def margins(self, run: Run):
        return run.ground_to_spare(self.fit, self.reach)


class ClearOfObstacles(OfDiscs, AbstractRunningConstraint):
    """The geometric centre outside discs in the plane; shape (t, k).

    **Arguments:**

    - ``centres``: the centres of the discs, single numbers for a disk, length, shape (k, 2).
    - ``radii``: the radius of each, length, shape (k,).
    """

    def __call__(self, run: Run):
        return depths(run, self.centres, self.radii)

    def margins(self, run: Run):
        return -room(run.z[:, None] - self.centres[None], self.radii[None]) / run.length


def discs_to_avoid(requirements: Iterable[Requirement]) -> tuple[tuple[Float[np.ndarray, "2"], float], ...]:
    """Lists the centre and radius of each disc in the plane that the geometric centre must stay out of."""
    avoiding = [item for item in requirements if isinstance(item, OfDiscs)]
    return tuple(
        disc for item in avoiding for disc in zip(np.asarray(item.centres), map(float, item.radii), strict=True)
    )


class Within(AbstractRunningConstraint):
    """The geometric centre within a rectangle of the plane, from ``lower`` to ``upper``; shape (t, 4).

    For a disk, the bounds are single numbers, and the shape is (t, 2).

    **Arguments:**

    - ``lower``: the lower corner, a single number for a disk, length, shape (2,).
    - ``upper``: the upper corner, a single number for a disk, length, shape (2,).
    """

    lower: Float[Array, " d"] = eqx.field(converter=corner("lower"))
    upper: Float[Array, " d"] = eqx.field(converter=corner("upper"))

    def __call__(self, run: Run):
        z = run.z[:, : self.lower.size]
        return jnp.concatenate([self.lower[None] - z, z - self.upper[None]], axis=1) / run.length

    def unreachable_by_disk(self):
        """Names a range of e2, if there is one: even one that contains 0 leaves an interior-point method no room."""
        return "a range of e2, in which it is always 0" if np.size(self.lower) > 1 else ""


class MassesApart(AbstractRunningConstraint):
    """No two masses closer to each other than ``distance``; shape (t, pairs).

    **Arguments:**

    - ``distance``: the least distance between two masses, length.
    """

    distance: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE))

    def __call__(self, run: Run):
        return (self.distance - norm(_differences(run))) / run.length

    def margins(self, run: Run):
        return -room(_differences(run), self.distance) / run.length


class _Limit(AbstractRunningConstraint):
    """|v| ≤ most, for a vector v of each mass."""

    most: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE))

    @abc.abstractmethod
    def limited(self, run: Run) -> tuple[Float[Array, "t n d"], Float[Array, "..."]]:
        """Returns v, and the unit of violations: one for all vectors, or one for each, shape (1, n)."""

    def __call__(self, run: Run):
        vectors, unit = self.limited(run)
        return (norm(vectors) - self.most) / unit

    def margins(self, run: Run):
        vectors, unit = self.limited(run)
        return room(vectors, self.most) / unit


class SpeedLimit(_Limit):
    """|χ̇| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: the largest speed of each mass relative to the body, length/time.
    """

    def limited(self, run: Run):
        return run.masses.chidot, run.length / run.time_unit


class AccelerationLimit(_Limit):
    """|χ̈| ≤ most for every mass; shape (t, n).

    **Arguments:**

    - ``most``: the largest acceleration of each mass relative to the body, length/time².
    """

    def limited(self, run: Run):
        return run.masses.chiddot, jnp.abs(run.system.gravity)


class JointEffortLimit(_Limit):
    """|Q| ≤ most for every joint of the mechanisms, a torque or the force along a slider; shape (t, joints).

    **Arguments:**

    - ``most``: the largest effort, mass length²/time² for a torque, mass length/time² for a force.
    """

    def limited(self, run: Run):
        return run.joint_efforts[..., None], run.effort_units[None]


class ForceLimit(_Limit):
    """|F·τ| ≤ most, the force on each mass along its rail; shape (t, n).

    **Arguments:**

    - ``most``: the largest force, mass length/time².
    """

    def limited(self, run: Run):
        return run.forces_along[..., None], run.weight


def _differences(run: Run) -> Float[Array, "t pairs 3"]:
    """Returns the vectors from the second mass of each pair to the first."""
    chi = run.masses.chi
    first, second = np.triu_indices(chi.shape[1], 1)
    return chi[:, first] - chi[:, second]


class RailsInside(AbstractRunningConstraint):
    """|ζ| ≤ r − clearance on every closed rail, and |χ| ≤ r − clearance for every mass along the motion.

    **Arguments:**

    - ``clearance``: the least distance from the shell, less than the radius, length.
    """

    clearance: Float[Array, ""] = eqx.field(converter=number(LENGTH), default=0.0)

    def __call__(self, run: Run):
        # On the rails, wherever a mass may go; along the motion, because a mass need not be on a closed rail.
        reach = jnp.concatenate([jnp.ravel(norm(run.curves.points)), jnp.ravel(norm(run.masses.chi))])
        return (reach + self.clearance) / run.length - 1

    def impossible_in(self, radius: float):
        clearance = float(self.clearance)
        return f"its `clearance` is {clearance:g}, which leaves no room for a rail" if clearance >= radius else ""

    def margins(self, run: Run):
        """Returns only the margins of the masses: no motion changes the rails."""
        return room(run.masses.chi, run.length - self.clearance) / run.length


class RailsApart(AbstractConstraint):
    """No two closed rails closer to each other than ``distance``: the least distance from each chord of one to another.

    Shape (pairs, chords).

    **Arguments:**

    - ``distance``: the least distance between two closed rails, length.
    """

    distance: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE))

    def __call__(self, run: Run):
        points = run.curves.points
        first, second = np.triu_indices(len(points), 1)
        nearest = jax.vmap(_chord_distances)(points[first], points[second])
        return (self.distance - nearest) / run.length


class RegularRails(AbstractConstraint):
    """|ζ′(θ)| ≥ least on every closed rail, so that the mass can move along it at a finite rate.

    **Arguments:**

    - ``least``: the smallest |ζ′(θ)|, per rad, length.
    """

    least: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE))

    def __call__(self, run: Run):
        return (self.least - run.curves.speed) / run.length


def _chord_distances(p: Float[Array, "n 3"], q: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Computes the least distance of each chord of a closed line ``p`` from the closed line ``q``.

    It is the least of those from the chord of ``q`` whose middle is nearest, and from the two beside it.
    """
    to_p, to_q = jnp.roll(p, -1, axis=0), jnp.roll(q, -1, axis=0)
    # Which chord is nearest is a choice and has no derivative; only the distance from it has one.
    middles = jax.lax.stop_gradient(((p + to_p) / 2, (q + to_q) / 2))
    nearest = jnp.argmin(jnp.sum((middles[0][:, None] - middles[1][None]) ** 2, axis=-1), axis=1)
    # The nearest middle may not belong to the nearest chord, which is then one of its neighbours. The indices wrap
    # around, since rails are closed.
    beside = (nearest[:, None] + jnp.arange(-1, 2)[None]) % len(q)
    distances = jax.vmap(distance, in_axes=(None, None, 0, 0))
    return jnp.min(jax.vmap(distances)(p, to_p, q[beside], to_q[beside]), axis=1)


def distance(
    a: Float[Array, "3"], to_a: Float[Array, "3"], b: Float[Array, "3"], to_b: Float[Array, "3"]
) -> Float[Array, ""]:
    """Computes the least distance between points of the segments from ``a`` to ``to_a`` and from ``b`` to ``to_b``.

    Either the lines are nearest within both segments, or one end is nearest.
    """
    u, v, w = to_a - a, to_b - b, a - b
    uu, uv, vv, uw, vw = (jnp.sum(x * y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    # Along parallel lines the nearest points are not unique, so that one of the ends is as near as any.
    determinant = uu * vv - uv**2
    crossing = determinant > PARALLEL
    # Divided by 1 there, because a division by 0 would make the gradient NaN although the value is not used.
    safe = jnp.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    within = crossing & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    ends = [*(_of_end(end, b, v, vv) for end in (a, to_a)), *(_of_end(end, a, u, uu) for end in (b, to_b))]
    nearest = jnp.min(jnp.stack(ends))
    return jnp.where(within, norm(w + s * u - t * v), nearest)


def _of_end(end, start, along, size) -> Float[Array, ""]:
    # A chord of length 0 has only one point; the guard keeps 0 / 0 out of the gradient.
    share = jnp.clip(jnp.sum((end - start) * along) / jnp.where(size > 0, size, 1.0), 0.0, 1.0)
    return norm(end - start - share * along)


class FunctionConstraint(OfFunction, AbstractConstraint):
    """function(run, parameters) ≤ 0, of any shape.

    **Arguments:**

    - ``function``: a function of (run, parameters), to an array that is positive where the constraint is violated.
      ``run`` is as for a :class:`FunctionObjective`.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    def __call__(self, run: Run):
        return call_with(self.function, run, parameters=self.parameters)


class FunctionRunningConstraint(OfFunction, AbstractRunningConstraint):
    """function(run, parameters) ≤ 0 at each time, where the value depends only on that time.

    **Arguments:**

    - ``function``: as for a :class:`FunctionConstraint`, with the times of the run as the first axis. Optimal control
      needs its second derivatives.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    def __call__(self, run: Run):
        return call_with(self.function, run, parameters=self.parameters)
