"""Rails ζ(θ): the curves, fixed in the ball, along which point masses move."""

import abc
import math
from typing import TYPE_CHECKING, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import call_with, require, require_function
from ...interface.printing import Printed
from ...numerics.arrays import a_number
from ...numerics.calculus import Furthest, furthest, two_derivatives
from ...numerics.declare import DIRECTION, LENGTH, POSITIVE, number
from ...numerics.functions import OfFunction, PiecewisePolynomial, periodic_cubic_spline
from ...numerics.vectors import dot, sine_cosine
from .frames import AbstractFrame, MatrixFrame


class AbstractRail(Printed):
    """A curve ζ(θ) fixed in the ball, relative to the geometric centre (section 3.3, ``eq_1d_param``).

    A family implements ``__call__`` and ``period``. A rail whose shape is costly to compute (a spline's coefficients, a
    frame's matrix) overrides ``prepare``, which is called once per solve; one whose wiggles are known overrides
    ``samples``, and one whose furthest point is known, ``furthest``.
    """

    @abc.abstractmethod
    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        """Returns the point ζ(θ), a body vector from the geometric centre."""

    @property
    @abc.abstractmethod
    def period(self) -> float | None:
        """The increase of θ after which a closed rail repeats itself; None for an open one."""

    @property
    def samples(self) -> int:
        """How many evenly spaced θ resolve every bend of the curve."""
        return 512

    def prepare(self) -> "AbstractRail":
        """Returns the same rail, ready to be evaluated many times."""
        return self

    def derivatives(self, theta: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, "3"]]:
        """Computes ζ(θ), ζ′(θ) and ζ″(θ), the derivatives by forward mode."""
        return two_derivatives(self, theta)

    def furthest(self) -> Furthest:
        """Finds the θ (as ``x``) at which a closed rail is furthest from the geometric centre, and its
        distance there.
        """
        assert self.period is not None
        theta = jnp.linspace(0.0, self.period, self.samples, endpoint=False)
        return furthest(self, theta, jax.vmap(self)(theta))

    def points(self, theta: Float[Array, " n"]) -> Float[Array, "n 3"]:
        """Computes ζ at many θ, for drawing."""
        return jax.vmap(self.prepare())(theta)


class FunctionRail(OfFunction, AbstractRail):
    """ζ(θ) = function(θ, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.
    ``parameters`` may be any PyTree of arrays; they can be swept and differentiated.
    ``closed_after`` is the period of a closed rail, or None.

    **Arguments:**

    - ``function``: of (theta, parameters), to the point ζ, body axes, length, shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``closed_after``: the period of a closed rail, or None for an open one.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionRail
    >>> def parabola(theta, height):
    ...     return jnp.stack([theta, 0.0 * theta, height * theta**2])
    >>> zeta, slope, bend = FunctionRail(parabola, 0.5).derivatives(jnp.array(0.2))
    >>> print(zeta, slope, bend)
    [0.2  0.   0.02] [1.  0.  0.2] [0. 0. 1.]
    """

    closed_after: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        require_function("function", self.function, (3,), theta=a_number(), parameters=self.parameters)

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return call_with(self.function, theta, parameters=self.parameters)

    @property
    def period(self) -> float | None:
        return self.closed_after


class Tube(AbstractRail):
    """A straight tube: ζ(θ) = centre + θ direction / |direction|; θ is the distance from ``centre``.

    **Arguments:**

    - ``direction``: the direction, a vector of any nonzero length, body axes, shape (3,).
    - ``centre``: the point where θ is 0, body axes, length, shape (3,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Tube
    >>> Tube((0.0, 0.0, 3.0), centre=(0.2, 0.0, 0.0))(jnp.array(0.5))  # half a unit along it
    Array([0.2, 0. , 0.5], dtype=float64)
    """

    direction: Float[Array, "*group 3"] = eqx.field(converter=number(rule=DIRECTION))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.centre + theta * self.direction / jnp.sqrt(jnp.sum(self.direction**2))

    @property
    def period(self) -> None:
        return None


ORIGIN = (0.0, 0.0, 0.0)


class AbstractClosedRail(AbstractRail):
    """A closed rail; θ runs over 2π."""

    @property
    def period(self) -> float:
        return 2 * math.pi


class AbstractPlanarRail(AbstractClosedRail):
    """ζ(θ) = centre + B (x(θ), 0, y(θ)), with B the matrix of ``frame``; θ runs over 2π."""

    if TYPE_CHECKING:  # to a type checker, fields declared here would come before `radius` among the arguments
        centre, frame = cast(Array, None), cast(AbstractFrame, None)
    else:
        centre: eqx.AbstractVar[Float[Array, "*group 3"]]
        frame: eqx.AbstractVar[AbstractFrame]

    def __check_init__(self):
        require("frame", self.frame, AbstractFrame, "a frame, such as SphericalFrame(...)")

    @abc.abstractmethod
    def planar(self, theta: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Returns the point (x(θ), y(θ)) of the curve in its own plane."""

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        # A sum over an axis, because XLA's CPU compiler computes that once, and other sums wherever they are used.
        B = self.frame.matrix()
        return self.centre + jnp.sum(B[:, ::2] * jnp.stack(self.planar(theta))[None], axis=1)

    @property
    def samples(self) -> int:
        return 64

    def prepare(self) -> "AbstractPlanarRail":
        return eqx.tree_at(lambda rail: rail.frame, self, MatrixFrame(self.frame.matrix()))


class Circle(AbstractPlanarRail):
    """A circle of ``radius``: (x, y) = radius (cos θ, sin θ), as in sections 4 and 5.

    **Arguments:**

    - ``radius``: the radius, length.
    - ``centre``: the centre of the rail, from the geometric centre, body axes, length, shape (3,).
    - ``frame``: the orientation, whose first and third columns span the rail's plane; the plane of E1 and E3 if not
      given. A :class:`~jaxball.SphericalFrame`, :class:`~jaxball.physics.VersorFrame` or :class:`~jaxball.MatrixFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Circle
    >>> rail = Circle(0.9, centre=(0.0, 0.0, 0.1))
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.9 0.  0.1]
     [0.  0.  1. ]]
    """

    radius: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.radius * cosine, self.radius * sine

    def furthest(self):
        """Returns the furthest point: straight beyond the centre of the circle, as seen from the geometric centre."""
        B = self.frame.matrix()
        theta = jnp.arctan2(self.radius * dot(self.centre, B[:, 2]), self.radius * dot(self.centre, B[:, 0]))
        return Furthest(theta, jnp.sqrt(jnp.sum(self(theta) ** 2)))


class Ellipse(AbstractPlanarRail):
    """An ellipse: (x, y) = (a cos θ, b sin θ) with ``semi_axes`` (a, b).

    **Arguments:**

    - ``semi_axes``: the semi-axes (a, b), length, shape (2,).
    - ``centre``: the centre of the rail, from the geometric centre, body axes, length, shape (3,).
    - ``frame``: the orientation, whose first and third columns span the rail's plane; the plane of E1 and E3 if not
      given. A :class:`~jaxball.SphericalFrame`, :class:`~jaxball.physics.VersorFrame` or :class:`~jaxball.MatrixFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ellipse
    >>> print(Ellipse((0.8, 0.5)).points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.8 0.  0. ]
     [0.  0.  0.5]]
    """

    semi_axes: Float[Array, "*group 2"] = eqx.field(converter=number(LENGTH, POSITIVE))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.semi_axes[0] * cosine, self.semi_axes[1] * sine


class GeronoEight(AbstractPlanarRail):
    """The figure eight of Gerono: (x, y) = (a cos θ, b sin 2θ) with ``half_extents`` (a, b).

    **Arguments:**

    - ``half_extents``: half of the extents (a, b), length, shape (2,).
    - ``centre``: the centre of the rail, from the geometric centre, body axes, length, shape (3,).
    - ``frame``: the orientation, whose first and third columns span the rail's plane; the plane of E1 and E3 if not
      given. A :class:`~jaxball.SphericalFrame`, :class:`~jaxball.physics.VersorFrame` or :class:`~jaxball.MatrixFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import GeronoEight
    >>> print(GeronoEight((0.8, 0.4)).points(jnp.array([0.0, jnp.pi / 4])).round(3))
    [[0.8   0.    0.   ]
     [0.566 0.    0.4  ]]
    """

    half_extents: Float[Array, "*group 2"] = eqx.field(converter=number(LENGTH, POSITIVE))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.half_extents[0] * cosine, self.half_extents[1] * 2 * sine * cosine


class BernoulliEight(AbstractPlanarRail):
    """The lemniscate of Bernoulli of half width a: (x, y) = a (cos θ, sin θ cos θ) / (1 + sin² θ).

    **Arguments:**

    - ``half_width``: a, half of the width, length.
    - ``centre``: the centre of the rail, from the geometric centre, body axes, length, shape (3,).
    - ``frame``: the orientation, whose first and third columns span the rail's plane; the plane of E1 and E3 if not
      given. A :class:`~jaxball.SphericalFrame`, :class:`~jaxball.physics.VersorFrame` or :class:`~jaxball.MatrixFrame`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import BernoulliEight
    >>> print(BernoulliEight(0.8).points(jnp.array([0.0, jnp.pi / 4])).round(3))
    [[0.8   0.    0.   ]
     [0.377 0.    0.267]]
    """

    half_width: Float[Array, "*group"] = eqx.field(converter=number(LENGTH, POSITIVE))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        x = self.half_width * cosine / (1 + sine**2)
        return x, x * sine


class FourierRail(AbstractClosedRail):
    """ζ(θ) = centre + Σ_k ( cosine_k cos kθ + sine_k sin kθ ), k = 1 … K.

    **Arguments:**

    - ``cosine``, ``sine``: a row for each harmonic, as many of either, length, shape (K, 3).
    - ``centre``: the constant, from the geometric centre, body axes, length, shape (3,).

    **Raises:** ``ValueError`` when ``cosine`` and ``sine`` do not have one shape (K, 3).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FourierRail
    >>> rail = FourierRail(cosine=[(0.5, 0.0, 0.0)], sine=[(0.0, 0.3, 0.0)])  # an ellipse
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.5 0.  0. ]
     [0.  0.3 0. ]]
    """

    cosine: Float[Array, "*group K 3"] = eqx.field(converter=number(LENGTH))
    sine: Float[Array, "*group K 3"] = eqx.field(converter=number(LENGTH))
    centre: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))

    def __check_init__(self):
        if self.cosine.shape != self.sine.shape or self.cosine.shape[-1:] != (3,) or self.cosine.ndim < 2:
            raise ValueError(
                "Arguments `cosine` and `sine` must have one shape (K, 3), a row for each harmonic, "
                f"but their shapes are {self.cosine.shape} and {self.sine.shape}."
            )

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        k = jnp.arange(1, self.cosine.shape[0] + 1, dtype=self.cosine.dtype)
        sine, cosine = sine_cosine(k * theta)
        return self.centre + jnp.sum(self.cosine * cosine[:, None] + self.sine * sine[:, None], axis=0)

    @property
    def samples(self) -> int:
        return 32 * self.cosine.shape[-2]


SAMPLES_PER_PIECE = 16


class SplineRail(AbstractClosedRail):
    """The closed cubic spline that passes its points at θ = 0, 2π/n, 4π/n, …

    ζ and ζ′ are smooth and ζ″ is continuous, so the motion of a mass has no jump of acceleration.

    **Arguments:**

    - ``points_on_rail``: the points, three or more, body axes, length, shape (n, 3).

    **Raises:** ``ValueError`` when ``points_on_rail`` does not have the shape (n, 3) with n ≥ 3.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import SplineRail
    >>> rail = SplineRail([(0.5, 0.0, 0.0), (0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, 0.0, -0.5)])
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))  # the first two of the points
    [[0.5 0.  0. ]
     [0.  0.  0.5]]
    """

    points_on_rail: Float[Array, "*group n 3"] = eqx.field(converter=number(LENGTH))

    def __check_init__(self):
        shape = self.points_on_rail.shape
        if len(shape) < 2 or shape[-1] != 3 or shape[-2] < 3:
            raise ValueError(
                "Argument `points_on_rail` must have the shape (n, 3) with at least three points, "
                f"but its shape is {shape}."
            )

    def prepare(self) -> "PreparedSplineRail":
        n = self.points_on_rail.shape[0]
        knots = jnp.linspace(0, 2 * math.pi, n + 1, dtype=self.points_on_rail.dtype)
        pieces = periodic_cubic_spline(knots, self.points_on_rail)
        return PreparedSplineRail(PiecewisePolynomial(knots[1:-1], knots[:-1], pieces))

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.prepare()(theta)

    @property
    def samples(self) -> int:
        return SAMPLES_PER_PIECE * self.points_on_rail.shape[-2]


class PreparedSplineRail(AbstractClosedRail):
    """A :class:`SplineRail` whose coefficients are known."""

    curve: PiecewisePolynomial

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.curve(jnp.mod(theta, self.period))

    @property
    def samples(self) -> int:
        return SAMPLES_PER_PIECE * self.curve.coefficients.shape[-3]
