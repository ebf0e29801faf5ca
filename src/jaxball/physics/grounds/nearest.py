"""The piece of a surface that is nearest to a point, by Newton's method on its two coordinates.

A ``surface`` without a closed form finds by it what is under a body in flight.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.arrays import select_tree
from ...numerics.calculus import with_derivatives
from ...numerics.vectors import dot, root
from ...programs.derivatives.differentiation import without_derivatives
from .chart import determinant

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
