"""A ground that is where a function of place is zero, in coordinates along lines or rays that meet it."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import call_with, require_function
from ...numerics.arrays import a_number, join_arrays
from ...numerics.declare import FINITE, LENGTH, number, number_or_none
from ...numerics.functions import OfKinkedFunctionOfState
from ...numerics.roots import find_rising_root, with_derivatives_of_root
from ...numerics.vectors import cross, dot
from ..conditions import Condition, ExplainedCondition, Problem, positive
from .carriers import MovingFrame
from .chart import coordinates_along, direction_at, share_to_pole
from .surface import AbstractSurface, Coordinate, Time

# The sine of the angle between the normal and the way to a point above which a piece is not the nearest to that, in
# units of the square root of the rounding.
OFF_NORMAL = 100.0
NOT_MET = Problem(
    "ground.function",
    "rise through zero along e3 above the coordinates at which the body starts or, with a centre, have opposite signs "
    "at the centre and behind the ground on the ray through them",
    "no such place was found; it must be positive on the side of the body and negative behind the ground",
)


class SignedDistance(OfKinkedFunctionOfState, AbstractSurface):
    """The ground where function(t, x, y, z, parameters) is zero; it is positive on the side of the ball.

    The function need not be a distance: any that is smooth near the ground and has a gradient there will do, such as
    1 − (x/a)² − (y/b)² − (z/c)² for the inside of an ellipsoid. It is compiled into programs: one that is written anew
    compiles again unless it only uses equal numbers.

    Without a ``centre`` the ground is met from above along e3, and the coordinates of the contact point are x and y.
    With one it is met along rays from there, so that it may be all of a body, from the inside, where the function is
    positive at the centre, or from the outside. The coordinates are then those of a :class:`Bowl` or a
    :class:`SphereOutside`, u = 2 R tan(φ/2) (cos β, sin β) at the angle φ of the ray from straight down, or from
    straight up outside, with ``guess`` for R. Each ray should meet the ground once; of more places the one next to the
    guess is sought. A run ends with the status ``LEFT_SURFACE`` where the ground is along the ray, and in flight with
    ``NOT_FINITE`` where the nearest piece is not on one.

    A piece of the ground's matter keeps its coordinates: where the function depends on the time, it moves along e3 or
    along its ray. ``motion`` moves it otherwise.

    **Arguments:**

    - ``function``: a function of (t, x, y, z, parameters), zero on the ground and positive on the side of the ball.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which its second derivative by t jumps or has a kink, shape (kinks,).
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.
    - ``centre``: the point from which rays meet the ground, in the plane of e1 and e3 under a disk, length, shape (3,);
      if not given, lines along e3 meet it.
    - ``guess``: the height, or the distance from ``centre``, then positive, at which the ground is sought first,
      length. With a centre it is also the scale of the coordinates.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import SignedDistance
    >>> def inside(t, x, y, z, axes):
    ...     return 1 - (x / axes[0])**2 - (y / axes[1])**2 - (z / axes[2])**2
    >>> egg = SignedDistance(inside, jnp.array([1.0, 1.0, 2.0]), centre=(0.0, 0.0, 0.0), guess=1.0)
    >>> print(egg.place(jnp.array(0.0), jnp.array(2.0), jnp.array(0.0)).round(6) + 0.0)  # the ray at φ = π/2
    [1. 0. 0.]
    """

    motion: MovingFrame | None = None
    centre: Float[Array, "*group 3"] | None = eqx.field(converter=number_or_none(LENGTH, FINITE), default=None)
    guess: Float[Array, "*group"] = eqx.field(converter=number(LENGTH), default=0.0)

    def __check_init__(self):
        number = a_number()
        place = dict.fromkeys(("t", "x", "y", "z"), number)
        require_function("function", self.function, (), **place, parameters=self.parameters)

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        if self.centre is None:
            yield Condition(FINITE.holds(self.guess), "ground.guess", self.guess, "a finite number")
        else:
            must = "a positive number, the distance from the centre at which the ground is sought first"
            yield Condition(positive(self.guess), "ground.guess", self.guess, must)
        yield from AbstractSurface.conditions(self, planar)

    def start_conditions(self, t: Time, r: Float[Array, ""], state: Any) -> Iterator[Condition | ExplainedCondition]:
        """Yields the conditions, also that the ground is found at the coordinates of the start."""
        u = self.coordinates(state.z)
        yield ExplainedCondition(jnp.all(jnp.isfinite(self.point(t, u[0], u[1]))), lambda: NOT_MET)
        yield from AbstractSurface.start_conditions(self, t, r, state)

    def at(self, t: Time, u1: Coordinate, u2: Coordinate) -> "_Met":
        """Returns the ground where the line or ray with these coordinates meets it, which is sought once."""
        # Heights may have either sign, and grow with the coordinates; distances along a ray are positive.
        side = self.side(t)
        if self.centre is None:
            lowest, scale = -jnp.inf, jnp.maximum(jnp.abs(u1), jnp.abs(u2))
        else:
            lowest, scale = 0.0, self.guess
        met = find_rising_root(_value_along, self.guess, lowest, scale, self, t, u1, u2, side)
        return _Met(self, side, met, turntable=self.turntable, belt=self.belt)

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return self.at(t, u1, u2).point(t, u1, u2)

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        """Computes the component of the normal along e3 or the ray, with a centre times the height below the unreached
        pole.
        """
        return self.at(t, u1, u2).reach(t, u1, u2)

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        """Finds the piece that is nearest to ``x``; NaN where no line or ray meets it, because it is behind others."""
        u = AbstractSurface.nearest(self, t, x, near)
        p = self.point(t, u[0], u[1])
        slope = self.gradient_at(t, p)
        beside, rounding = cross(x - p, slope), float(jnp.finfo(x.dtype).eps)
        square = dot(x - p, x - p) + rounding * dot(p, p)  # a point of the ground itself is not off its normal
        most = OFF_NORMAL**2 * rounding * square * dot(slope, slope)
        return jnp.where(jax.lax.stop_gradient(dot(beside, beside) <= most), u, jnp.nan)

    def over(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        """Computes the coordinates of the foot as far as the function is linear, which for a distance is the nearest
        piece.
        """
        slope = self.gradient_at(t, x)
        square = dot(slope, slope)
        x = x - jnp.where(square > 0, self.value_at(t, x) / jnp.where(square > 0, square, 1.0), 0.0) * slope
        if self.centre is None:
            return x[:2]
        return coordinates_along(self.guess, x - self.centre, -self.side(t))

    def kinks(self) -> Float[Array, " kinks"]:
        return join_arrays([self.kink_times, AbstractSurface.kinks(self)])

    def value_at(self, t: Time, x: Float[Array, "3"]) -> Float[Array, ""]:
        """Evaluates the function at a point, before ``motion`` moves both."""
        return jnp.asarray(call_with(self.function, t, x[0], x[1], x[2], parameters=self.parameters), x.dtype)

    def gradient_at(self, t: Time, x: Float[Array, "3"]) -> Float[Array, "3"]:
        """Computes the gradient of the function at a point, before ``motion`` moves both."""
        axes = jnp.eye(3, dtype=x.dtype)
        return jnp.stack([jax.jvp(lambda x: self.value_at(t, x), (x,), (axes[k],))[1] for k in range(3)])

    def side(self, t: Time) -> Float[Array, ""]:
        """Returns 1 outside and above, and −1 inside, where the function is positive at the centre."""
        if self.centre is None:
            return jnp.ones_like(self.guess)
        inside = jax.lax.stop_gradient(self.value_at(t, self.centre)) > 0
        return jnp.where(inside, -1.0, 1.0).astype(self.guess.dtype)

    def along(self, s: Float[Array, ""], u1: Coordinate, u2: Coordinate, side: Float[Array, ""]) -> Float[Array, "3"]:
        """Returns the point at the height or the distance ``s`` on the line or ray with these coordinates."""
        if self.centre is None:
            return jnp.stack([u1, u2, s])
        return self.centre + s * direction_at(self.guess, u1, u2, -side)


class _Met(AbstractSurface):
    """A ground, with its ``side``, near the place where a line or ray meets it at the height or distance ``met``."""

    ground: SignedDistance
    side: Float[Array, ""]
    met: Float[Array, ""]

    @property
    def motion(self) -> MovingFrame | None:
        return self.ground.motion

    def section(self, z: Coordinate) -> tuple[Coordinate, Coordinate]:
        return self.ground.section(z)

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        met = with_derivatives_of_root(self.met, _value_along, self.ground, t, u1, u2, self.side)
        return self.ground.along(met, u1, u2, self.side)

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        ground = self.ground
        slope = ground.gradient_at(t, self.point(t, u1, u2))
        length = jnp.sqrt(dot(slope, slope))
        if ground.centre is None:
            return slope[2] / length
        along = self.side * dot(slope, direction_at(ground.guess, u1, u2, -self.side))
        return along / length * share_to_pole(ground.guess, u1, u2)


def _value_along(
    s: Float[Array, ""], ground: SignedDistance, t: Time, u1: Coordinate, u2: Coordinate, side: Float[Array, ""]
) -> Float[Array, ""]:
    """Evaluates the function of a ground on a line or ray, with the sign that makes it rise with ``s`` where that meets
    it.
    """
    return side * ground.value_at(t, ground.along(s, u1, u2, side))
