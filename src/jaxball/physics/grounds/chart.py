"""The coordinates of surfaces: how they move with the foot and the centre of a ball, and which are nearest to a point.

``surface`` computes the rates of the contact point by it, and whether the ball fits there; without a closed form, it
finds by Newton's method what is under a body in flight. ``Bowl`` and ``SphereOutside`` have stereographic coordinates
of directions from a centre, and ``SignedDistance`` with a centre has them for its rays.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.arrays import select_tree
from ...numerics.calculus import with_derivatives
from ...numerics.linear import product
from ...numerics.vectors import cross, dot, root, unit_vector
from ...programs.derivatives.differentiation import without_derivatives

Number = Float[Array, ""]


def direction_at(R: Number, u1: Number, u2: Number, up: Number | float) -> Float[Array, "3"]:
    """Computes the unit vector from the centre of a sphere of radius ``R`` to its point with these coordinates.

    They are those of the projection onto the plane that touches the sphere where the coordinates are 0: at its lowest
    point for ``up`` = 1 and at its highest for −1.
    """
    square = (u1**2 + u2**2) / (4 * R**2)
    return jnp.stack([u1 / R, u2 / R, up * (square - 1)]) / (1 + square)


def share_to_pole(R: Number, u1: Number, u2: Number) -> Number:
    """Computes how far the height is from that of the point without coordinates, divided by the sphere's diameter.

    It is small already where rounding spoils the normal, 1e-3 radians from there.
    """
    return 1 / (1 + (u1**2 + u2**2) / (4 * R**2))


def coordinates_along(R: Number, arm: Float[Array, "3"], up: Number | float) -> Float[Array, "2"]:
    """Computes the coordinates of the point of such a sphere that is in the direction ``arm`` from its centre."""
    down = -up * arm[2]
    length = root(dot(arm, arm))
    # The square of tan(φ/2) is (|arm| − down)/(|arm| + down); the pole that no coordinates reach is infinitely far.
    reach = jnp.maximum(length + down, float(jnp.finfo(R.dtype).eps) * length)
    return 2 * R * arm[:2] / jnp.where(length > 0, reach, 1.0)


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


MOST_TRIALS = 40  # of steps to the nearest piece
STRONGEST_DAMPING = 1e-2  # the first, relative to the metric, after a step that led away
DAMPED_LESS, DAMPED_MORE = 0.1, 10.0  # the damping after a step that led nearer, and after one that led away
UNDAMPED = 1e-6  # a damping below this is none
ARRIVED = 1e-8  # of the distance: after a step of Newton's method that is shorter, the next one would be rounding
ROUNDING_OF_DISTANCE = 8  # of half the square of the distance, in units of rounding: what may be added by it


def nearest(surface: Any, t: Float[Array, ""], x: Float[Array, "3"], start: Float[Array, "2"]) -> Float[Array, "2"]:
    """Finds the coordinates of the ``point`` of a surface that is nearest to ``x``, as far as a search from ``start``
    on finds it.

    The square of the distance is made less in each step, by Newton's method, with damping where that leads away or
    towards a saddle. Derivatives are those of the solution.
    """
    search = _Search(surface, t, x)
    still = without_derivatives(search)
    first = _Trial.begin(still, jax.lax.stop_gradient(start))
    u = jax.lax.while_loop(lambda trial: trial.goes_on, lambda trial: trial.next(still), first).u
    return with_derivatives(u, _refine, search, u)


class Section(NamedTuple):
    """The section of a surface along which a disk rolls, drawn out along e2: its coordinates are z, and y."""

    surface: Any

    def at(self, t: Float[Array, ""], z: Float[Array, ""], y: Float[Array, ""]) -> "Section":
        """Returns the section near the point at ``z``."""
        return Section(self.surface.at(t, *self.surface.section(z)))

    def point(self, t: Float[Array, ""], z: Float[Array, ""], y: Float[Array, ""]) -> Float[Array, "3"]:
        """Returns the point ``y`` beside the one at ``z`` of the section."""
        return self.surface.point(t, *self.surface.section(z)).at[1].add(y)


class _Search(NamedTuple):
    """A surface at a time, and what its point is to be the nearest to."""

    surface: Any
    t: Float[Array, ""]
    x: Float[Array, "3"]

    def away(self, u: Float[Array, "2"]) -> Float[Array, "3"]:
        """Returns the vector from x to the point of the surface."""
        return self.surface.point(self.t, u[0], u[1]) - self.x

    def slopes(
        self, u: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Float[Array, "2"], Float[Array, "2 2"], Float[Array, "2 2"]]:
        """Computes half the square of the distance, its gradient and its Hessian, and the metric of the surface."""
        axes = jnp.eye(2, dtype=u.dtype)
        away = _Search(self.surface.at(self.t, u[0], u[1]), self.t, self.x).away

        def along(u: Float[Array, "2"], k: int) -> Float[Array, "3"]:
            return jax.jvp(away, (u,), (axes[k],))[1]

        d = away(u)
        first, bend_1 = jax.jvp(lambda u: along(u, 0), (u,), (axes[0],))
        _, bend_12 = jax.jvp(lambda u: along(u, 0), (u,), (axes[1],))
        second, bend_2 = jax.jvp(lambda u: along(u, 1), (u,), (axes[1],))
        metric = _symmetric(dot(first, first), dot(first, second), dot(second, second))
        bending = _symmetric(dot(d, bend_1), dot(d, bend_12), dot(d, bend_2))
        return 0.5 * dot(d, d), jnp.stack([dot(first, d), dot(second, d)]), metric + bending, metric


class _Trial(NamedTuple):
    """The coordinates so far, half the square of the distance there, and the damping of the next step."""

    u: Float[Array, "2"]
    value: Float[Array, ""]
    damping: Float[Array, ""]
    trials: Array
    done: Bool[Array, ""]

    @classmethod
    def begin(cls, search: _Search, u: Float[Array, "2"]) -> "_Trial":
        d = search.away(u)
        value = 0.5 * dot(d, d)
        return cls(u, value, jnp.zeros_like(value), jnp.asarray(0), jnp.asarray(False))

    @property
    def goes_on(self) -> Bool[Array, ""]:
        return ~self.done & (self.trials < MOST_TRIALS)

    def next(self, search: _Search) -> "_Trial":
        """Returns the trial after one more step, unless that leads away."""
        value, gradient, hessian, metric = search.slopes(self.u)
        convex = (hessian[0, 0] > 0) & (determinant(hessian) > 0)
        # Where the distance is not convex, Newton's step may lead to a saddle; with the metric it leads down from
        # anywhere.
        matrix = jnp.where(convex, hessian, metric) + self.damping * metric
        step = -_solve(matrix, gradient)
        u = self.u + step
        d = search.away(u)
        there = 0.5 * dot(d, d)
        length = root(jnp.sum(step[:, None] * metric * step[None]))
        arrives = convex & (self.damping == 0) & (length <= ARRIVED * root(2 * value))
        # At the nearest piece no step leads nearer, and by rounding one may seem to lead away.
        nearer = (there <= value * (1 + ROUNDING_OF_DISTANCE * float(jnp.finfo(value.dtype).eps))) | arrives
        less = jnp.where(self.damping > UNDAMPED, DAMPED_LESS * self.damping, 0.0)
        more = jnp.maximum(DAMPED_MORE * self.damping, STRONGEST_DAMPING)
        after = _Trial(u, there, less, self.trials + 1, arrives)
        return select_tree(nearer, after, self._replace(damping=more, trials=self.trials + 1))


def _refine(search: _Search, u: Float[Array, "2"]) -> Float[Array, "2"]:
    """Applies two steps of Newton's method, which change nothing but have the derivatives of the solution."""
    # Each step doubles the order to which the result follows a change: the first has first derivatives, the second
    # those up to the third.
    for _ in range(2):
        _, gradient, hessian, _ = search.slopes(u)
        u = u - _solve(hessian, gradient)
    return u


def _symmetric(a: Float[Array, ""], b: Float[Array, ""], c: Float[Array, ""]) -> Float[Array, "2 2"]:
    return jnp.stack([jnp.stack([a, b]), jnp.stack([b, c])])


def _solve(A: Float[Array, "2 2"], b: Float[Array, "2"]) -> Float[Array, "2"]:
    """Returns the solution x of A x = b."""
    return jnp.stack([A[1, 1] * b[0] - A[0, 1] * b[1], A[0, 0] * b[1] - A[1, 0] * b[0]]) / determinant(A)
