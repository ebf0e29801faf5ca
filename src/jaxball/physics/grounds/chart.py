"""How the coordinates of a surface move with the foot and the centre of a ball, and whether the ball fits there.

``surface`` computes the rates of the contact point by it.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.linear import product
from ...numerics.vectors import cross, root, unit_vector

# What must be left of a chart, and of a fit, so that the equations can be evaluated, and so that a solve goes on, in
# units of the square root of the rounding: a place is known that well where its coordinates have a turning point.
LEAST_MARGIN, END_MARGIN = 4.0, 40.0


class Touch(NamedTuple):
    """p, n and w, a unit vector e along ∂p/∂u1, and what of w is along the ground: the ``flow`` of matter that a
    turntable or a belt carries, None without them. Or the derivatives of all these.
    """

    p: Float[Array, "3"]
    n: Float[Array, "3"]
    w: Float[Array, "3"]
    e: Float[Array, "3"]
    flow: Float[Array, "3"] | None = None

    @property
    def axes(self) -> Float[Array, "3 3"]:
        """The contact axes: the tangents and the normal, as rows."""
        return jnp.stack([self.e, cross(self.n, self.e), self.n])


class Chart(NamedTuple):
    """How the foot and the centre move with the coordinates, in components along two unit tangents.

    ``inverse`` is that of ∂p/∂u; ``stretch`` takes steps of the foot to those of the centre: 1 + r ∂n/∂p.
    """

    tangents: Float[Array, "2 3"]
    inverse: Float[Array, "2 2"]
    stretch: Float[Array, "2 2"]

    @staticmethod
    def of(n: Float[Array, "3"], by_u1: Touch, by_u2: Touch, r: Float[Array, ""]) -> "Chart":
        first = unit_vector(by_u1.p)
        tangents = jnp.stack([first, cross(n, first)])
        inverse = _inverse(_components(tangents, by_u1.p, by_u2.p))
        bending = product(_components(tangents, by_u1.n, by_u2.n), inverse)
        return Chart(tangents, inverse, jnp.eye(2, dtype=n.dtype) + r * bending)

    @property
    def fit(self) -> Float[Array, ""]:
        """The lesser eigenvalue of ``stretch``, which is symmetric: 1 − r κ of a principal curvature."""
        S = self.stretch
        apart = (0.5 * (S[0, 0] - S[1, 1])) ** 2 + S[0, 1] * S[1, 0]
        return 0.5 * (S[0, 0] + S[1, 1]) - root(apart)

    def coordinates(self, v: Float[Array, "3"]) -> Float[Array, "2"]:
        """Computes the rates of the coordinates with which the centre moves at the tangent velocity ``v`` over the
        ground.

        NaN where the ball does not fit the ground.
        """
        S = self.stretch
        fits = self.fit > margin(LEAST_MARGIN, S)
        steps = product(_inverse(S), jnp.sum(self.tangents * v[None], axis=1, keepdims=True))
        rates = product(self.inverse, steps)[:, 0]
        return jnp.where(fits, rates, jnp.nan)


def margin(size: float, x: Float[Array, "..."]) -> float:
    """Returns a margin in the precision of ``x``."""
    return size * float(jnp.finfo(x.dtype).eps) ** 0.5


def _components(
    tangents: Float[Array, "2 3"], first: Float[Array, "3"], second: Float[Array, "3"]
) -> Float[Array, "2 2"]:
    """Returns the matrix whose columns are the components of two vectors along the tangents."""
    return jnp.stack([jnp.sum(tangents * v[None], axis=1) for v in (first, second)], axis=1)


def determinant(A: Float[Array, "2 2"]) -> Float[Array, ""]:
    return A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]


def _inverse(A: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    """Computes A⁻¹ by cofactors; not finite where A is singular."""
    cofactors = jnp.stack([jnp.stack([A[1, 1], -A[0, 1]]), jnp.stack([-A[1, 0], A[0, 0]])])
    return cofactors / determinant(A)
