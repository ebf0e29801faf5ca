"""Objectives that a design minimises: at the end of a run, along its path, of its actuation, and users' own."""

import math
from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ... import programs
from ...interface.arguments import call_with, require_value
from ...numerics.declare import POSITIVE, TIME, number, number_or_none
from ...numerics.vectors import ROUNDING_SQUARED, norm
from ...simulation.equilibrium import imbalance
from .problem.requirements import (
    AbstractObjective,
    AbstractRunningObjective,
    OfCurve,
    OfDiscs,
    OfFunction,
    Requirement,
    along,
    off_e1,
    place,
)
from .problem.run import Run

# The least speed at which a piece of the path counts, in mean speeds along the curve: a ball at rest has no path.
SLOWEST_SPEED = 1e-3
POINTS_DRAWN = 400  # points of a curve


class ReachPlace(AbstractObjective):
    """|z − place|² / r² at the end, the square of the distance.

    **Arguments:**

    - ``place``: the target of the geometric centre, (z1, z2) for a ball and z for a disk, length.
    """

    place: Float[Array, "2"] = eqx.field(converter=place("place"))

    def __call__(self, run: Run):
        return jnp.sum((run.z[-1] - self.place) ** 2) / run.length**2

    def in_units(self, value, length, time):
        return f"distance {length * math.sqrt(value):.4g}"

    def unreachable_by_disk(self):
        return off_e1(self.place[None])

    def farthest(self, run: Run) -> Float[Array, ""]:
        """Computes the distance from ``place`` at the end, in radii."""
        return norm(run.z[-1] - self.place) / run.length


class ReachPose(AbstractObjective):
    """sin² of half the angle between the orientation at the end and ``versor``: 1 − (q·q*)² / (|q| |q*|)².

    **Arguments:**

    - ``versor``: the target orientation, the real part first, [q0, 0, q2, 0] for a disk, shape (4,).
    """

    versor: Float[Array, "4"] = eqx.field(converter=number())

    def __call__(self, run: Run):
        q = run.state.in_space().q[-1]
        # q and −q are the same orientation, hence the square; the division makes any length of either admissible.
        return 1 - jnp.sum(q * self.versor) ** 2 / (jnp.sum(q**2) * jnp.sum(self.versor**2))

    def in_units(self, value, length, time):
        # Rounding may take the value outside of the range in which its arcsine exists.
        return f"angle {2 * math.asin(math.sqrt(min(max(value, 0.0), 1.0))):.4g} rad"

    def unreachable_by_disk(self):
        return "a turn about another axis" if np.any(np.asarray(self.versor)[[1, 3]] != 0) else ""


class StopAtRest(AbstractObjective):
    """T / (M g r) at the end, the kinetic energy of shell and masses: zero where all are at rest."""

    def __call__(self, run: Run):
        return run.observables.kinetic_energy[-1] / (run.weight * run.length)


class Balanced(AbstractObjective):
    """The squared distance of the centre of mass at the end from where it could rest at the same height, over r².

    On a level plane this is its horizontal distance from the geometric centre, on a slope its distance along the plane
    from the vertical through the contact point.
    """

    def __call__(self, run: Run):
        end = jax.tree.map(lambda leaf: leaf[-1], run.state)
        away = imbalance(run.system.prepare(), run.times[-1], end).beside
        return jnp.sum(away**2) / run.length**2

    def in_units(self, value, length, time):
        return f"horizontal distance {length * math.sqrt(value):.4g}"


class GoFar(AbstractObjective):
    """−|z(end) − z(start)| / r: as far as possible."""

    def __call__(self, run: Run):
        return -norm(run.z[-1] - run.z[0]) / run.length

    def in_units(self, value, length, time):
        return f"distance {-value * length:.4g}"


class Duration(AbstractObjective):
    """The duration of the run, in units of √(r/g), if its end is a variable."""

    def __call__(self, run: Run):
        return (run.times[-1] - run.times[0]) / run.time_unit

    def in_units(self, value, length, time):
        return f"time {value * time:.4g}"


class FollowTrajectory(OfCurve, AbstractRunningObjective):
    """The mean of |z(t) − c(s(t))|² / r²: the curve followed in time.

    s goes from 0 at ``start`` to 1 at ``end`` at a constant rate, or with ``rest_to_rest`` by 10 u³ − 15 u⁴ + 6 u⁵.

    **Arguments:**

    - ``curve``: the curve. An :class:`AbstractCurve`.
    - ``rest_to_rest``: whether it starts and ends at rest, instead of having a constant rate.
    - ``start``: when it starts, a time; if not given, with the run.
    - ``end``: when it ends, a time; if not given, with the run.
    """

    rest_to_rest: Bool[Array, ""] = eqx.field(converter=jnp.asarray, default=False)
    start: Float[Array, ""] | None = eqx.field(converter=number_or_none(TIME), default=None)
    end: Float[Array, ""] | None = eqx.field(converter=number_or_none(TIME), default=None)

    def targets(self, times: Float[Array, " t"]) -> Float[Array, "t 2"]:
        """Returns the desired positions of the geometric centre."""
        return _targets(self, times)

    def integrand(self, run: Run):
        # Not the square of errors(), whose second derivative is undefined at 0.
        return jnp.sum((run.z - self.targets(run.times)) ** 2, axis=-1) / run.length**2

    def errors(self, run: Run) -> Float[Array, " t"]:
        """Computes |z(t) − c(s(t))| / r."""
        return norm(run.z - self.targets(run.times)) / run.length

    def farthest(self, run: Run) -> Float[Array, ""]:
        """Computes the largest distance of the geometric centre from its desired position, in radii."""
        return jnp.max(self.errors(run))

    def in_units(self, value, length, time):
        return f"root mean square distance {length * math.sqrt(value):.4g}"


@programs.filter_jit
def _targets(objective: FollowTrajectory, times: Float[Array, " t"]) -> Float[Array, "t 2"]:
    start = times[0] if objective.start is None else objective.start
    end = times[-1] if objective.end is None else objective.end
    u = jnp.clip((times - start) / (end - start), 0.0, 1.0)
    return along(objective.curve, jnp.where(objective.rest_to_rest, u**3 * (10 - 15 * u + 6 * u**2), u))


class FollowCurve(OfCurve, AbstractObjective):
    """The curve followed at any speed: mean squared distances, over r², of the path from the curve and back.

    The first mean is over the length of the path, so that it does not matter how long the ball stays anywhere; the
    second, over the curve, accounts for parts of it that the path misses. Distances are from the chords between
    samples.

    **Arguments:**

    - ``curve``: the curve. An :class:`AbstractCurve`.
    - ``samples``: the number of points of the curve.
    """

    samples: int = eqx.field(static=True, default=200)

    def __call__(self, run: Run):
        path, curve = run.z, self.curve.points(self.samples)
        # The root of a sum with the floor has a finite derivative also where the ball rests.
        lengths = jnp.sqrt(jnp.sum(jnp.diff(path, axis=0) ** 2, axis=-1) + _floor(run, curve))
        ends = squared_distances(path, curve)
        # One way alone would be least for a path that stays at one point of the curve, or one that also goes
        # elsewhere.
        there = jnp.sum(lengths * (ends[1:] + ends[:-1]) / 2) / jnp.sum(lengths)
        return (there + jnp.mean(squared_distances(curve, path))) / run.length**2

    def farthest(self, run: Run) -> Float[Array, ""]:
        """Computes the largest distance of a point of the path from the curve, or of the curve from the path,
        in radii.
        """
        path, curve = run.z, self.curve.points(self.samples)
        square = jnp.max(jnp.concatenate([squared_distances(path, curve), squared_distances(curve, path)]))
        # The derivative of the root is infinite at 0, where path and curve coincide.
        return jnp.sqrt(jnp.maximum(square, ROUNDING_SQUARED)) / run.length

    def in_units(self, value, length, time):
        # Two mean squares: there and back.
        return f"root mean square distance {length * math.sqrt(value / 2):.4g}"


class LargestDistance(FollowCurve):
    """The largest distance between path and curve, in radii, which evens out the error along the curve.

    It has a kink wherever another point becomes the farthest.

    **Arguments:**

    - ``curve``: the curve. An :class:`AbstractCurve`.
    - ``samples``: the number of points of the curve.
    """

    def __call__(self, run: Run):
        return self.farthest(run)

    def in_units(self, value, length, time):
        return f"largest distance {value * length:.4g}"


def target_path(requirements: Iterable[Requirement]) -> Float[np.ndarray, "k 2"] | None:
    """Returns points of the curve to follow, the last one if there are several, and None if there is none."""
    followed = [item for item in requirements if isinstance(item, OfCurve)]
    return np.asarray(followed[-1].curve.points(POINTS_DRAWN)) if followed else None


class AvoidObstacles(OfDiscs, AbstractRunningObjective):
    """The mean of Σ softplus(depth / softness)² over discs in the plane that the geometric centre should avoid.

    It is smooth: it extends outside a disc by a few times ``softness``, which is in radii of the shell. For an upright
    post, add the ball's radius to the post's.

    **Arguments:**

    - ``centres``: the centres of the discs, single numbers for a disk, length, shape (k, 2).
    - ``radii``: the radius of each, length, shape (k,).
    - ``softness``: the distance from a disc within which it is penalised, in radii of the shell.
    """

    softness: Float[Array, ""] = eqx.field(converter=number(rule=POSITIVE), default=0.1)

    def integrand(self, run: Run):
        inside = jax.nn.softplus(depths(run, self.centres, self.radii) / self.softness)
        return jnp.sum(inside**2, axis=-1)


def depths(run: Run, centres: Float[Array, "k 2"], radii: Float[Array, " k"]) -> Float[Array, "t k"]:
    """Computes how deep the geometric centre is inside discs in the plane, over r; negative outside."""
    return (radii[None] - norm(run.z[:, None] - centres[None])) / run.length


def squared_distances(points: Float[Array, "p 2"], line: Float[Array, "q 2"]) -> Float[Array, " p"]:
    """Computes the squared distance of each point from a polygonal line."""
    a, along = line[:-1], jnp.diff(line, axis=0)
    size = jnp.sum(along**2, axis=-1)
    # A ball at rest makes chords of length 0; the guard keeps 0 / 0 out of the gradient.
    size = jnp.where(size > 0, size, 1.0)
    away = points[:, None] - a[None]
    share = jnp.clip(jnp.sum(away * along[None], axis=-1) / size[None], 0.0, 1.0)
    return jnp.min(jnp.sum((away - share[..., None] * along[None]) ** 2, axis=-1), axis=1)


def _floor(run: Run, curve: Float[Array, "q 2"]) -> Float[Array, " steps"]:
    """Computes the square of the least length at which a step of the path counts."""
    whole = jnp.sum(jnp.sqrt(jnp.sum(jnp.diff(curve, axis=0) ** 2, axis=-1)))
    # Squared, as it is added under a root; in proportion to the step of time, since it stands for a speed.
    return (SLOWEST_SPEED * whole * jnp.diff(run.times) / (run.times[-1] - run.times[0])) ** 2


class AccelerationEffort(AbstractRunningObjective):
    """The mean of Σ θ̈² over the masses on rails and the angles of a plate, in units of g²/r².

    It is that of the authors' papers on control.
    """

    def integrand(self, run: Run):
        # θ̈ has the unit 1 / time², and is squared.
        squares = jnp.sum(run.on_rails.thetaddot**2, axis=-1) + jnp.sum(run.plate_accelerations**2, axis=-1)
        return squares * run.time_unit**4


class PowerEffort(AbstractRunningObjective):
    """The mean of Σ P² over the masses, P = F·χ̇ the power of a mass's actuator, in units of M g √(g r)."""

    def integrand(self, run: Run):
        power = jnp.sum(run.forces * run.masses.chidot, axis=-1)
        unit = run.weight * run.length / run.time_unit
        return jnp.sum(power**2, axis=-1) / unit**2


class ForceEffort(AbstractRunningObjective):
    """The mean of Σ (F·τ)² over the masses, F·τ the force on a mass along its rail, in units of M g."""

    def integrand(self, run: Run):
        return jnp.sum(run.forces_along**2, axis=-1) / run.weight**2


class JointEffort(AbstractRunningObjective):
    """The mean of Σ Q² over the joints of mechanisms, a torque in units of M g r and a force in units of M g."""

    def integrand(self, run: Run):
        return jnp.sum((run.joint_efforts / run.effort_units[None]) ** 2, axis=-1)


class MassesNearCentre(AbstractRunningObjective):
    """The mean of Σ |χ|² / r² over the point masses: it keeps them from the ends of straight tubes."""

    def integrand(self, run: Run):
        return jnp.sum(run.masses.chi**2, axis=(-2, -1)) / run.length**2


class FunctionObjective(OfFunction, AbstractObjective):
    """function(run, parameters), one number for the whole run.

    **Arguments:**

    - ``function``: a function of (run, parameters), to one number. ``run`` has ``times``, ``state``, ``observables``,
      ``system``, and the units ``length`` and ``weight``.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    def __call__(self, run: Run):
        value = call_with(self.function, run, parameters=self.parameters)
        require_value("function", value, ())
        return value


class FunctionRunningObjective(OfFunction, AbstractRunningObjective):
    """The mean over the run of function(run, parameters), where each value depends only on its own time.

    **Arguments:**

    - ``function``: a function of (run, parameters), to a number for each of the times of the run, shape (t,). In
      optimal control it is called for one time after the other, and t is 1.
    - ``parameters``: arrays, in any PyTree, passed to it.
    """

    def integrand(self, run: Run):
        values = call_with(self.function, run, parameters=self.parameters)
        require_value("function", values, run.times.shape)
        return values
