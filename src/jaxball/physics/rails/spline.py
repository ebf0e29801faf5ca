"""Closed rails through given points."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.piecewise import PiecewisePolynomial, periodic_cubic_spline
from .base import AbstractRail

SAMPLES_PER_PIECE = 16


class SplineRail(AbstractRail):
    """The closed cubic spline that passes ``points`` at θ = 0, 2π/n, 4π/n, …

    ζ and ζ′ are smooth and ζ″ is continuous, so the motion of a mass has no jump of acceleration.

    **Arguments:**

    - ``points_on_rail``: the points, body axes, length, shape (n, 3).

    **Raises:** ``ValueError`` when ``points`` does not have the shape (n, 3) with n ≥ 3.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import SplineRail
    >>> rail = SplineRail([(0.5, 0.0, 0.0), (0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, 0.0, -0.5)])
    >>> print(rail.points(jnp.array([0.0, jnp.pi / 2])).round(3))  # the first two of the points
    [[0.5 0.  0. ]
     [0.  0.  0.5]]
    """

    points_on_rail: Float[Array, "*group n 3"] = eqx.field(converter=numbers("points_on_rail", ("n", 3)))

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
    def period(self) -> float:
        return 2 * math.pi

    @property
    def samples(self) -> int:
        return SAMPLES_PER_PIECE * self.points_on_rail.shape[-2]


class PreparedSplineRail(AbstractRail):
    """A :class:`SplineRail` whose coefficients are known."""

    curve: PiecewisePolynomial

    def __call__(self, theta: Float[Array, ""]) -> Float[Array, "3"]:
        return self.curve(jnp.mod(theta, self.period))

    @property
    def period(self) -> float:
        return 2 * math.pi

    @property
    def samples(self) -> int:
        return SAMPLES_PER_PIECE * self.curve.coefficients.shape[-3]
