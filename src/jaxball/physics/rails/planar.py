"""Closed curves in a plane, placed in the ball by a centre and a frame."""

import abc
import math
from typing import TYPE_CHECKING, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...numerics.arrays import numbers
from ...numerics.calculus import Furthest
from ...numerics.trigonometry import sine_cosine
from ...numerics.vectors import dot
from ..frames import AbstractFrame, MatrixFrame
from .base import AbstractRail

ORIGIN = (0.0, 0.0, 0.0)


class AbstractPlanarRail(AbstractRail):
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
        """The curve (x(θ), y(θ)) in its own plane."""

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        # A sum over an axis, because XLA's CPU compiler computes that once, and other sums wherever they are used.
        B = self.frame.matrix()
        return self.centre + jnp.sum(B[:, ::2] * jnp.stack(self.planar(theta))[None], axis=1)

    @property
    def period(self) -> float:
        return 2 * math.pi

    @property
    def samples(self) -> int:
        return 64

    def prepare(self) -> "AbstractPlanarRail":
        return eqx.tree_at(lambda rail: rail.frame, self, MatrixFrame(self.frame.matrix()))


class Circle(AbstractPlanarRail):
    """A circle of ``radius``: (x, y) = radius (cos θ, sin θ), as in sections 4 and 5.

    **Arguments:**

    - ``radius``: length.
    - ``centre``: of the rail, from the geometric centre, body axes, shape (3,), length; the geometric centre if not
      given.
    - ``frame``: the orientation, whose first and third columns span the rail's plane: a
      :class:`~jaxball.SphericalFrame`, :class:`~jaxball.VersorFrame` or :class:`~jaxball.MatrixFrame`; the plane of
      E1 and E3 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Circle
    >>> rail = Circle(0.9, centre=(0.0, 0.0, 0.1))
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.9 0.  0.1]
     [0.  0.  1. ]]
    """

    radius: Float[Array, "*group"] = eqx.field(converter=numbers("radius"))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.radius * cosine, self.radius * sine

    def furthest(self):
        """Straight beyond the centre of the circle, as seen from the geometric centre."""
        B = self.frame.matrix()
        theta = jnp.arctan2(self.radius * dot(self.centre, B[:, 2]), self.radius * dot(self.centre, B[:, 0]))
        return Furthest(theta, jnp.sqrt(jnp.sum(self(theta) ** 2)))


class Ellipse(AbstractPlanarRail):
    """An ellipse: (x, y) = (a cos θ, b sin θ) with ``semi_axes`` (a, b).

    **Arguments:**

    - ``semi_axes``: (a, b), length, shape (2,).
    - ``centre``: of the rail, from the geometric centre, body axes, shape (3,), length; the geometric centre if not
      given.
    - ``frame``: the orientation, whose first and third columns span the rail's plane: a
      :class:`~jaxball.SphericalFrame`, :class:`~jaxball.VersorFrame` or :class:`~jaxball.MatrixFrame`; the plane of
      E1 and E3 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ellipse
    >>> print(Ellipse((0.8, 0.5)).points(jnp.array([0.0, jnp.pi / 2])).round(3))
    [[0.8 0.  0. ]
     [0.  0.  0.5]]
    """

    semi_axes: Float[Array, "*group 2"] = eqx.field(converter=numbers("semi_axes", (2,)))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.semi_axes[0] * cosine, self.semi_axes[1] * sine


class GeronoEight(AbstractPlanarRail):
    """The figure eight of Gerono: (x, y) = (a cos θ, b sin 2θ) with ``half_extents`` (a, b).

    **Arguments:**

    - ``half_extents``: (a, b), length, shape (2,).
    - ``centre``: of the rail, from the geometric centre, body axes, shape (3,), length; the geometric centre if not
      given.
    - ``frame``: the orientation, whose first and third columns span the rail's plane: a
      :class:`~jaxball.SphericalFrame`, :class:`~jaxball.VersorFrame` or :class:`~jaxball.MatrixFrame`; the plane of
      E1 and E3 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import GeronoEight
    >>> print(GeronoEight((0.8, 0.4)).points(jnp.array([0.0, jnp.pi / 4])).round(3))
    [[0.8   0.    0.   ]
     [0.566 0.    0.4  ]]
    """

    half_extents: Float[Array, "*group 2"] = eqx.field(converter=numbers("half_extents", (2,)))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        return self.half_extents[0] * cosine, self.half_extents[1] * 2 * sine * cosine


class BernoulliEight(AbstractPlanarRail):
    """The lemniscate of Bernoulli of half width a: (x, y) = a (cos θ, sin θ cos θ) / (1 + sin² θ).

    **Arguments:**

    - ``half_width``: a, length.
    - ``centre``: of the rail, from the geometric centre, body axes, shape (3,), length; the geometric centre if not
      given.
    - ``frame``: the orientation, whose first and third columns span the rail's plane: a
      :class:`~jaxball.SphericalFrame`, :class:`~jaxball.VersorFrame` or :class:`~jaxball.MatrixFrame`; the plane of
      E1 and E3 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BernoulliEight
    >>> print(BernoulliEight(0.8).points(jnp.array([0.0, jnp.pi / 4])).round(3))
    [[0.8   0.    0.   ]
     [0.377 0.    0.267]]
    """

    half_width: Float[Array, "*group"] = eqx.field(converter=numbers("half_width"))
    centre: Float[Array, "*group 3"] = eqx.field(converter=numbers("centre", (3,)), default=ORIGIN)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    def planar(self, theta):
        sine, cosine = sine_cosine(theta)
        x = self.half_width * cosine / (1 + sine**2)
        return x, x * sine
