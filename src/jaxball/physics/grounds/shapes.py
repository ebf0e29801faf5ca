"""The surfaces that jaxball has: height fields, spheres, cylinders and others, each of which may be moved."""

import dataclasses
import math
from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import call_with, require, require_flags, require_function
from ...numerics.arrays import a_number, join_arrays, namespace_of
from ...numerics.declare import ANGLE, DIRECTION, FINITE, FULL_TURN, LENGTH, PER_LENGTH, POSITIVE, number
from ...numerics.functions import OfKinkedFunctionOfState
from ...numerics.vectors import cross, dot, sine_cosine, unit_vector
from ..conditions import Condition
from ..mechanisms.joints import Accelerated
from ..prescribed.motion import AbstractPrescribedMotion
from ..prescribed.schedules import AbstractSchedule
from .carriers import MovingFrame, Turn
from .chart import coordinates_along, share_to_pole
from .surface import AbstractSurface, Coordinate, Coordinates, Time

AXIS_ACROSS = 0.5  # the component along e2 of an axis that is not along the plane of a disk
STAYS_IN_PLANE = "None or a schedule under a disk, which a law may only tilt about e2"


class HeightField(OfKinkedFunctionOfState, AbstractSurface):
    """The ground at the height h = function(t, x, y, parameters) over a plane, under the ball.

    ``function`` must be smooth in x and y, and is compiled into programs: one that is written anew compiles again
    unless it only uses equal numbers.

    **Arguments:**

    - ``function``: a function of (t, x, y, parameters), to a height, length. The ground's matter moves up and down with
      it.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which its second derivative by t jumps or has a kink, shape (kinks,).
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    The coordinates of the contact point are x and y.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, HeightField, observe
    >>> def valley(t, x, y, depth):
    ...     return depth * x**2
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=HeightField(valley, 0.1))
    >>> print(observe(ball, jnp.array(0.0), BallState(z=(0.0, 5.0))).geometric_centre)
    [0. 5. 1.]
    """

    motion: MovingFrame | None = None

    def __check_init__(self):
        number = a_number()
        require_function("function", self.function, (), t=number, x=number, y=number, parameters=self.parameters)

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return jnp.stack([u1, u2, self._height(t, u1, u2)])

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        """Computes the upward component of the normal, which is 0 where the ground is vertical."""
        _, along_x = jax.jvp(lambda x: self._height(t, x, u2), (u1,), (jnp.ones_like(u1),))
        _, along_y = jax.jvp(lambda y: self._height(t, u1, y), (u2,), (jnp.ones_like(u2),))
        return 1 / jnp.sqrt(1 + along_x**2 + along_y**2)

    def _height(self, t: Time, x: Coordinate, y: Coordinate) -> Float[Array, ""]:
        return jnp.asarray(call_with(self.function, t, x, y, parameters=self.parameters), x.dtype)

    def over(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return x[:2]

    def kinks(self) -> Float[Array, " kinks"]:
        return join_arrays([self.kink_times, AbstractSurface.kinks(self)])


class ParametricSurface(OfKinkedFunctionOfState, AbstractSurface):
    """The ground p = function(t, u1, u2, parameters); ∂p/∂u1 × ∂p/∂u2 points towards the ball.

    ``function`` must be smooth in u1 and u2, and is compiled into programs: one that is written anew compiles again
    unless it only uses equal numbers.

    **Arguments:**

    - ``function``: a function of (t, u1, u2, parameters), to a point, length, shape (3,). A piece of the ground's
      matter keeps its coordinates.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which its second derivative by t jumps or has a kink, shape (kinks,).
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import ParametricSurface
    >>> def torus(t, around, across, radii):
    ...     rho = radii[0] - radii[1] * jnp.cos(across)
    ...     return jnp.stack([rho * jnp.cos(around), rho * jnp.sin(around), radii[1] * jnp.sin(across)])
    >>> inside = ParametricSurface(torus, jnp.array([3.0, 2.0]))  # of a tube that is closed to a ring
    >>> print(inside.normal(jnp.array(0.0), jnp.array([0.0, 0.0])).round(6) + 0.0)
    [1. 0. 0.]
    """

    motion: MovingFrame | None = None

    def __check_init__(self):
        number = a_number()
        require_function("function", self.function, (3,), t=number, u1=number, u2=number, parameters=self.parameters)

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return call_with(self.function, t, u1, u2, parameters=self.parameters)

    def kinks(self) -> Float[Array, " kinks"]:
        return join_arrays([self.kink_times, AbstractSurface.kinks(self)])


class Bowl(AbstractSurface):
    """The inside of a sphere, whose lowest point is the origin.

    The coordinates of the contact point are those of its stereographic projection from the highest point, the only
    one that they do not reach: u = 2 R tan(φ/2) (cos β, sin β) at the angle φ from the lowest point, seen from the
    centre of the sphere, in the direction β from e1 to e2.

    **Arguments:**

    - ``radius``: R, the radius of the sphere, more than that of the ball, length.
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, Bowl, observe
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=Bowl(3.0))
    >>> print(observe(ball, jnp.array(0.0), BallState(z=(6.0, 0.0))).geometric_centre)  # at φ = π/2
    [2. 0. 3.]
    """

    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    motion: MovingFrame | None = None

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return _on_sphere(self.radius, u1, u2, 1.0)

    def fit(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, ""]:
        return 1 - r / self.radius

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        return share_to_pole(self.radius, u1, u2)

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return coordinates_along(self.radius, x.at[2].add(-self.radius), 1.0)


class SphereOutside(AbstractSurface):
    """The outside of a sphere, whose highest point is the origin.

    The coordinates of the contact point are as in a :class:`Bowl`, from the highest point instead of the lowest.

    **Arguments:**

    - ``radius``: R, the radius of the sphere, length.
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, observe
    >>> from jaxball.physics import SphereOutside
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=SphereOutside(3.0))
    >>> print(observe(ball, jnp.array(0.0), BallState(z=(6.0, 0.0))).geometric_centre)  # at φ = π/2
    [ 4.  0. -3.]
    """

    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    motion: MovingFrame | None = None

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return _on_sphere(self.radius, u1, u2, -1.0)

    def fit(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, ""]:
        return 1 + r / self.radius

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        return share_to_pole(self.radius, u1, u2)

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return coordinates_along(self.radius, x.at[2].add(self.radius), -1.0)


class Cylinder(AbstractSurface):
    """The inside or the outside of a circular cylinder in any direction.

    The coordinates of the contact point are its place along the axis and the length of the arc around it, which grow
    to the right and to the left of each other, as seen by the ball.

    **Arguments:**

    - ``radius``: R, the radius of the cylinder, length.
    - ``axis``: the direction of the axis, of any nonzero length, shape (3,).
    - ``start``: the direction, from the axis, of the line along which the arc is 0, of any length, and not along the
      axis, shape (3,). The lowest line of a horizontal cylinder by default, which fits the inside.
    - ``centre``: the point of the axis from which lengths along it are counted, length, shape (3,).
    - ``outside``: whether the ball is outside of it.
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import Cylinder
    >>> well = Cylinder(2.0, axis=(0.0, 0.0, 1.0), start=(1.0, 0.0, 0.0))
    >>> print(well.place_of_centre(jnp.array(0.0), jnp.array(0.5), jnp.array([3.0, jnp.pi])).round(6) + 0.0)
    [0.  1.5 3. ]
    """

    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    axis: Float[Array, "*group 3"] = eqx.field(converter=number(rule=DIRECTION), default=(1.0, 0.0, 0.0))
    start: Float[Array, "*group 3"] = eqx.field(converter=number(), default=(0.0, 0.0, -1.0))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    outside: bool = eqx.field(static=True, default=False)
    motion: MovingFrame | None = None

    def __check_init__(self):
        require_flags(outside=self.outside)

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        a, b, number = self.axis, self.start, namespace_of(self.start)
        across = number.cross(a, b)
        holds = (across**2).sum() > 1e-12 * (a**2).sum() * (b**2).sum()
        yield Condition(holds, "ground.start", b, "a direction that is not along the axis of the cylinder")
        yield from AbstractSurface.conditions(self, planar)

    def section(self, z: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Returns the coordinates along the axis, or around an axis along e2: from e1 upwards at the lowest line of the
        inside.
        """
        along, zero = unit_vector(self.axis)[1], jnp.zeros_like(z)
        across = jnp.abs(along) > AXIS_ACROSS
        return jnp.where(across, zero, z), jnp.where(across, -jnp.sign(along) * z, zero)

    def along_section(self, u: Float[Array, "2"]) -> Coordinate:
        along = unit_vector(self.axis)[1]
        return jnp.where(jnp.abs(along) > AXIS_ACROSS, -jnp.sign(along) * u[1], u[0])

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        axis, start, across = self._directions
        sine, cosine = sine_cosine((-u2 if self.outside else u2) / self.radius)
        return self.centre + u1 * axis + self.radius * (cosine * start + sine * across)

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        axis, start, across = self._directions
        along, ahead, aside = (dot(x - self.centre, direction) for direction in (axis, start, across))
        off = (ahead != 0) | (aside != 0)
        arc = self.radius * jnp.arctan2(jnp.where(off, aside, 0.0), jnp.where(off, ahead, 1.0))
        arc = -arc if self.outside else arc
        turn = 2 * math.pi * self.radius  # all around
        # Around the cylinder coordinates go on beyond a full turn: of those of the same place, the ones next to before.
        return jnp.stack([along, arc + turn * jnp.round(jax.lax.stop_gradient((near[1] - arc) / turn))])

    @property
    def _directions(self) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, "3"]]:
        """Unit vectors along the axis, from it to the line where the arc is 0, and around it from there."""
        axis = unit_vector(self.axis)
        start = unit_vector(self.start - dot(self.start, axis) * axis)
        return axis, start, cross(axis, start)


class Paraboloid(AbstractSurface):
    """The ground at the height h = ½ (k1 x² + k2 y²): a dish, a dome, a saddle or a trough.

    **Arguments:**

    - ``curvatures``: k1 and k2, positive where the ground rises from the origin, 1/length, shape (2,).
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    The coordinates of the contact point are x and y.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import Paraboloid
    >>> saddle = Paraboloid((0.1, -0.1))
    >>> print(saddle.place(jnp.array(0.0), jnp.array(2.0), jnp.array(1.0)))
    [2.   1.   0.15]
    """

    curvatures: Float[Array, "*group 2"] = eqx.field(converter=number(PER_LENGTH, FINITE, by_size=True))
    motion: MovingFrame | None = None

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return jnp.stack([u1, u2, 0.5 * (self.curvatures[0] * u1**2 + self.curvatures[1] * u2**2)])

    def over(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return x[:2]


class Washboard(AbstractSurface):
    """Straight waves: h = amplitude sin(2π s / wavelength + phase), with s = x cos heading + y sin heading.

    **Arguments:**

    - ``amplitude``: the amplitude of the height, length.
    - ``wavelength``: the wavelength, length.
    - ``phase``: the phase of the waves at the origin, rad; 0 if not given.
    - ``heading``: the direction across the waves, from e1 towards e2, rad; 0 if not given.
    - ``motion``: its motion as a rigid body; at rest if not given. A :class:`MovingFrame`.

    The coordinates of the contact point are x and y.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import Washboard
    >>> print(Washboard(0.1, wavelength=4.0).place(jnp.array(0.0), jnp.array(1.0), jnp.array(2.0)))
    [1.  2.  0.1]
    """

    amplitude: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, FINITE))
    wavelength: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    phase: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FULL_TURN), default=0.0)
    heading: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FULL_TURN), default=0.0)
    motion: MovingFrame | None = None

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        sine, cosine = sine_cosine(self.heading)
        wave, _ = sine_cosine(2 * math.pi * (u1 * cosine + u2 * sine) / self.wavelength + self.phase)
        return jnp.stack([u1, u2, self.amplitude * wave])

    def over(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return x[:2]


class TiltingPlane(AbstractSurface):
    """A plane that tilts by schedules about its axes e1 and then e2, through a pivot in it, and may be displaced.

    Its axes are those of space where both angles are 0; the second axis is carried by the first turn. The coordinates
    of the contact point are those in the plane, x and y.

    **Arguments:**

    - ``about_e1``: the angle about e1, a schedule, or the one that a law follows, rad; level if not given.
      ``Accelerated()`` where the body's feedback law gives its θ̈; it is in the state's ``theta`` after those of masses
      and joints.
    - ``about_e2``: the angle about the plane's own e2, likewise, rad; level if not given.
    - ``pivot``: the point about which it tilts, length, shape (3,); the origin if not given. It need not be in the
      plane.
    - ``displacement``: X(t), its displacement, length; none if not given. A motion such as an
      :class:`~jaxball.Oscillating` of sinusoids.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, ConstantRate, simulate
    >>> from jaxball.physics import TiltingPlane
    >>> slope = TiltingPlane(about_e2=ConstantRate(0.1))  # held there
    >>> run = simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=slope), jnp.array([0.0, 2.0]))
    >>> print(run.state.z[-1].round(6))  # ½ t² g sin a / (1 + 2/5), as on a Ground(angle=0.1)
    [0.142619 0.      ]
    """

    about_e1: AbstractSchedule | Accelerated | None = None
    about_e2: AbstractSchedule | Accelerated | None = None
    pivot: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    displacement: AbstractPrescribedMotion | None = None

    def __check_init__(self):
        for name in ("about_e1", "about_e2"):
            must = "a schedule of its angle, such as ConstantRate(0.0, rate=0.1), Accelerated() for a law, or None"
            require(name, getattr(self, name), (AbstractSchedule, Accelerated, type(None)), must)

    @property
    def driven(self) -> tuple[str, ...]:
        return tuple(name for name in ("about_e1", "about_e2") if isinstance(getattr(self, name), Accelerated))

    @property
    def schedules(self) -> tuple[AbstractSchedule, ...]:
        return tuple(angle for angle in (self.about_e1, self.about_e2) if isinstance(angle, AbstractSchedule))

    def follow_law(self) -> "TiltingPlane":
        return self._with_angles([Accelerated() for _ in self.schedules])

    def follow(self, schedules: Sequence[AbstractSchedule]) -> "TiltingPlane":
        return self._with_angles(schedules)

    def _with_angles(self, angles: Sequence[AbstractSchedule | Accelerated]) -> "TiltingPlane":
        """Returns the same plane with other angles in place of its schedules."""
        others = iter(angles)
        first, second = (
            next(others) if isinstance(angle, AbstractSchedule) else angle for angle in (self.about_e1, self.about_e2)
        )
        return dataclasses.replace(self, about_e1=first, about_e2=second)

    @property
    def motion(self) -> MovingFrame:
        """Its motion as a rigid body; angles that a law drives are those of ``following``, and 0 without it."""
        angles = (((1.0, 0.0, 0.0), self.about_e1), ((0.0, 1.0, 0.0), self.about_e2))
        turns = [Turn(axis, angle) for axis, angle in angles if isinstance(angle, AbstractSchedule)]
        return MovingFrame(turns, self.displacement, self.pivot)

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        if planar:
            level = namespace_of(self.pivot).asarray(not isinstance(self.about_e1, Accelerated))
            yield Condition(level, "ground.about_e1", self.about_e1, STAYS_IN_PLANE)
        yield from AbstractSurface.conditions(self, planar)

    def following(
        self,
        t: Time,
        theta: Float[Array, " driven"],
        thetadot: Float[Array, " driven"],
        thetaddot: Float[Array, " driven"],
    ) -> "TiltingPlane":
        near = (_Near(t, theta[k], thetadot[k], thetaddot[k]) for k in range(len(self.driven)))
        return dataclasses.replace(self, **dict(zip(self.driven, near, strict=True)))

    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        return jnp.stack([u1, u2, jnp.zeros_like(u1)])

    def fit(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, ""]:
        return jnp.ones_like(r)

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        return x[:2]

    def prepare(self) -> "TiltingPlane":
        names = ("about_e1", "about_e2", "displacement", "turntable", "belt")
        parts = {name: getattr(self, name) for name in names}
        still = (type(None), Accelerated)
        return dataclasses.replace(
            self, **{name: part if isinstance(part, still) else part.prepare() for name, part in parts.items()}
        )


class _Near(AbstractSchedule):
    """An angle near the time ``time``, at which it has this value and these rates."""

    time: Float[Array, ""]
    theta: Float[Array, ""]
    rate: Float[Array, ""]
    acceleration: Float[Array, ""]

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        # A law gives θ̈ at this time only; the two derivatives that equations take of the angle are right there.
        since = t - self.time
        return self.theta + since * (self.rate + 0.5 * since * self.acceleration)

    def shift(self, by: Float[Array, ""]) -> "_Near":
        return _Near(self.time, self.theta + by, self.rate, self.acceleration)


def _on_sphere(R: Float[Array, ""], u1: Coordinate, u2: Coordinate, up: float) -> Float[Array, "3"]:
    """Returns the point of a sphere that touches the plane of its two coordinates at the origin: stereographic
    projection.

    The sphere is above that plane for ``up`` = 1 and below it for −1.
    """
    square = (u1**2 + u2**2) / (4 * R**2)
    return jnp.stack([u1, u2, up * 2 * R * square]) / (1 + square)
