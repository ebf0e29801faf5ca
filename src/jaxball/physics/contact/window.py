"""The window of time from its beginning in which the direction σ of a slip is known beforehand, and those that follow.

``slip`` says why the direction cannot be computed from v_s there.

**A slip begins** along the direction in which it grows. The solution with v_s = 0 at the start is smooth; others
approach it as a power of the time, or faster. So it is found by collocation, on a short window of time: the motion of
the rest and v_s at the nodes of Lobatto's quadrature follow from the accelerations there, and σ at each node is the
direction of v_s. Within the window a solve takes σ from the polynomial through these, and v_s from its acceleration as
usual, so that the end of the window is not a kink.

**A slip that stays slow** follows in further windows. Where friction all but holds a body, σ returns to the direction
in which the slip grows at a rate like g/|v_s|, to which the steps of an explicit solve would have to be fitted. There
the slip has forgotten how it began and the nodes are those of Radau IIA, which do not contain the start of the window:
σ there is that of the polynomial, and what the velocity lacks in it matters the less, the slower the slip is
(E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer 1996, sections IV.5 and VII.4).
Each may be twice as long as the one before, if the polynomial in that would still resolve σ then, and if nothing
depends on time: what comes late and soon passes would not be seen at the nodes.
"""

import math
from functools import cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ...numerics import linear
from ...numerics.arrays import select_tree
from ...numerics.calculus import with_derivatives
from ...numerics.directions import across, perpendicular, turn_left, unit
from ...numerics.time_inputs import depends_on_time
from ...numerics.vectors import cross, root
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from .released import ReleasedState, Response, response

DEGREE = 6  # of the polynomial through the directions of a slip that begins
SHORTER_WINDOW = 0.4  # a window that is too long, when it is tried again
RESOLVED = 2e-11  # the last coefficient of the polynomial in a window that is short enough
SETTLED = 1e-3  # by which the tangents may still change in the last sweep, as they do where they run away
SWEEPS = 10  # of collocation, each of which gains two digits, with one window
MOST_SWEEPS = 4 * SWEEPS  # with four windows
STIFF = 30  # times, in a window, that σ may return to its direction before steps are slower than another window
ERRORS_ASIDE = 10  # errors of the velocity, by which it may differ from the direction of the window that ends
LONGEST_WINDOW = 0.1  # of √(r/g): the longest time for which the direction of a slip that begins is known beforehand
LAST_OF_LEGENDRE = math.comb(2 * DEGREE - 2, DEGREE - 1), math.comb(2 * DEGREE, DEGREE)  # coefficients
BEFORE_KINK = 0.999  # of the time until the next kink: no window is longer than that


class Beginning(NamedTuple):
    """The direction of a slip in a window of time from its beginning, ``span`` long, which ends at ``until``.

    It is ``sigma`` at first, and turns from there by the angle whose tangent is the polynomial Σ bends[k] uᵏ⁺¹ in the
    share u of the window. Where it has three components, the coefficients are vectors, perpendicular to ``sigma``, and
    σ has the direction of that plus the polynomial.
    """

    until: Float[Array, "*batch"]
    span: Float[Array, "*batch"]
    sigma: Float[Array, "*batch n"]
    bends: Float[Array, "*batch degree"] | Float[Array, "*batch degree 3"]

    @classmethod
    def none(cls, like: Float[Array, ""], size: int = 2) -> "Beginning":
        """Returns the direction of a slip that began long ago, with ``size`` components."""
        # Not −∞, nor the largest number: differences from it, and their squares, are to be finite.
        never = jnp.full_like(like, -(float(jnp.finfo(like.dtype).max) ** 0.5))
        return cls.along(never, jnp.zeros((size,), like.dtype))

    @classmethod
    def along(cls, until: Float[Array, "*batch"], sigma: Float[Array, "*batch n"]) -> "Beginning":
        """Returns the direction of a slip that does not turn."""
        of_each = (DEGREE,) if sigma.shape[-1] == 2 else (DEGREE, 3)
        return cls(until, jnp.ones_like(until), sigma, jnp.zeros((*until.shape, *of_each), sigma.dtype))

    def direction(self, t: Float[Array, ""]) -> Float[Array, " n"]:
        """Computes σ at a time in the window."""
        # Limited, because this is evaluated outside the window, too, where it is not used: powers of a long time would
        # overflow, and their derivatives be NaN.
        u, tangent = jnp.clip(1 + (t - self.until) / self.span, 0.0, 1.0), jnp.zeros_like(self.bends[0])
        for k in reversed(range(DEGREE)):
            tangent = u * (self.bends[k] + tangent)
        return _turn(self.sigma, tangent) if tangent.ndim == 0 else unit(self.sigma + tangent)

    def next_span(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Computes how long the next window may be, at the end of this one; 0 where it has ended long before."""
        ends = jnp.abs(self.bends[-2:]) if self.bends.ndim == 1 else root(jnp.sum(self.bends[-2:] ** 2, axis=1))
        last = ends / jnp.asarray(LAST_OF_LEGENDRE, self.bends.dtype)
        # In a window twice as long the coefficient of a degree is 2 to that degree times as large.
        span = jnp.where(jnp.sum(last) * 2.0**DEGREE <= RESOLVED, 2 * self.span, self.span)
        return jax.lax.stop_gradient(jnp.where(t - self.until < self.span, span, 0.0))


@runtime_checkable
class Pulled(Protocol):
    """What slips, a PyTree: how it is pulled in a direction σ.

    ``prepare`` is whatever does not depend on σ, and ``pull`` gives a and the rates of the state of the ``body``.
    """

    @property
    def body(self) -> AbstractBody: ...

    def prepare(self, t: Float[Array, ""], state: Any) -> Any: ...

    def pull(
        self, t: Float[Array, ""], state: Any, prepare: Any, sigma: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Any]: ...


def longest_window(
    t: Float[Array, ""], kinks: Float[Array, " kinks"], unit_of_time: Float[Array, ""]
) -> Float[Array, ""]:
    """Computes the longest time from ``t`` on for which the direction of a slip that begins is computed beforehand."""
    # A polynomial cannot follow a slip through a kink. Where the window ends is a choice, and has no derivatives.
    kink = jnp.min(jnp.where(kinks > t, kinks, jnp.inf), initial=jnp.inf)
    return jax.lax.stop_gradient(jnp.minimum(LONGEST_WINDOW * unit_of_time, BEFORE_KINK * (kink - t)))


class Course(NamedTuple):
    """How a slip moves as a window is to begin: its direction σ, and its ``speed`` along it, 0 where it begins.

    ``span`` is how long the window may be after the one before, if nothing depends on time.
    """

    sigma: Float[Array, " n"]
    speed: Float[Array, ""]
    span: Float[Array, ""]

    @classmethod
    def of(cls, sigma: Float[Array, " n"]) -> "Course":
        """Returns that of a slip that begins in the direction σ."""
        return cls(sigma, jnp.zeros_like(sigma[0]), jnp.zeros_like(sigma[0]))

    @property
    def slip(self) -> Float[Array, " n"]:
        """The slip velocity v_s."""
        return self.speed * self.sigma

    def is_that_of(self, slip: Float[Array, " n"], size: Float[Array, ""], tolerance: Float[Array, ""]) -> Array:
        """Returns whether v_s differs from it by no more than errors of a solve; ``size`` is the size of velocities."""
        two = slip.size == 2
        off = jnp.abs(across(self.sigma, slip)) if two else root(jnp.sum(perpendicular(self.sigma, slip) ** 2))
        return (self.speed > 0) & (off <= ERRORS_ASIDE * tolerance * size)


def beginning(what: Pulled, t: Float[Array, ""], state: Any, course: Course, longest: Float[Array, ""]) -> Beginning:
    """Computes how a slip begins, or stays slow, from ``t`` on: in the ``longest`` window, or a shorter one in which a
    polynomial can follow it. A slip that goes on has no window if none can follow it, or if steps can.
    """
    start = _Start(what, t, state, course, _scheme(course))
    # The search has no derivatives, for which ``settle`` makes some more sweeps, only where they are asked for.
    still, highest = without_derivatives(start), start.scheme.highest
    longest, goes_on = jax.lax.stop_gradient(longest), course.speed > 0
    longest = longest if still.depends_on_time() else jnp.maximum(longest, course.span)
    begun = still.window(longest)

    def sweep(window: _Window) -> _Window:
        # One sweep: accelerations at the nodes with the directions so far, their integrals, and better directions from
        # these.
        a, rate, change = still.accelerations(window, turned=True)
        sigmas, aside, along, x = still.integrate(window, a, rate)
        window = window._replace(x=x, inverse=still.newton(window, sigmas, along, change))
        # s φ̇ = a·n, of which this is less the derivative by φ. A slip that is fast enough for steps has no window.
        base = sigmas[0] if course.sigma.size == 2 else course.sigma
        returns = jnp.sum(a[0] * sigmas[0]) - _least_turning(base, change[0])
        too_fast = returns * longest < STIFF * course.speed
        tangents, sweeps = window.turn(aside), window.sweeps + 1
        # The polynomial is judged after a full number of sweeps: before, all its coefficients still change. Where v_s
        # goes against σ, the sweeps have come to a direction in which no slip grows.
        done, converges = (
            sweeps % SWEEPS == 0,
            (_size(_sum_weighted(highest, tangents)) <= RESOLVED)
            & jnp.all(along[1:] > 0)
            & jnp.all(jnp.abs(tangents - window.tangents) <= SETTLED),
        )
        # If the shortest window fails as well, its last polynomial is used all the same.
        again = done & ~converges & (sweeps < MOST_SWEEPS)
        shorter = begun._replace(span=SHORTER_WINDOW * window.span, sweeps=sweeps)
        last = jnp.where(goes_on & too_fast, MOST_SWEEPS, sweeps)
        window = window._replace(tangents=tangents, sweeps=last, found=done & converges)
        return select_tree(again, shorter, window)

    window = jax.lax.while_loop(lambda window: ~window.found & (window.sweeps < MOST_SWEEPS), sweep, begun)

    def finish() -> Beginning:
        tangents = with_derivatives(window.tangents, _Start.settle, start, window)
        # The first node has the direction of the polynomial there, from which the others are then reckoned.
        first = _sum_weighted(start.scheme.first, tangents)
        sigma = _turn(course.sigma, first)
        if first.ndim == 0:
            tangents = (tangents - first) / (1 + first * tangents)
        else:
            turned = course.sigma[None] + linear.product(tangents, _beside(course.sigma))
            tangents = turned / jnp.sum(turned * sigma[None], axis=1)[:, None] - sigma[None]
        tangents = tangents.at[0].set(0.0)
        bends = jax.vmap(lambda row: _sum_weighted(row, tangents))(start.scheme.powers)[1:]
        return Beginning(t + window.span, window.span, sigma, bends)

    # A polynomial that was not found has no derivatives worth the sweeps, nor finite ones.
    return jax.lax.cond(window.found | ~goes_on, finish, lambda: Beginning.none(t, course.sigma.size))


class _Window(NamedTuple):
    """A window of time in which a slip begins or stays slow: at nodes, tangents of the angles by which σ turns, and the
    states.

    ``inverse`` is that of the matrix of Newton's method for the directions. Where σ has three components, it turns by
    two tangents at each node.
    """

    span: Float[Array, ""]
    tangents: Float[Array, " nodes"] | Float[Array, "nodes 2"]
    x: Float[Array, "nodes size"]
    inverse: Float[Array, "rows rows"]
    sweeps: Array
    found: Bool[Array, ""]

    def turn(self, aside: Float[Array, " nodes"] | Float[Array, "nodes 2"]) -> Array:
        """Computes the tangents after a step of Newton's method: at each node but the first, σ is to be the direction
        of v_s.
        """
        # At the first node σ is the given one, or plays no part. Far from the solution a step of Newton's method
        # may lead anywhere, so it is limited.
        turns = jnp.reshape(linear.solutions(self.inverse[None], jnp.reshape(aside[1:], (1, -1)))[0], aside[1:].shape)
        return self.tangents.at[1:].add(-jnp.clip(turns, -1.0, 1.0))


class _Start(NamedTuple):
    """Where a slip begins or goes on, in which direction, and the nodes of its window."""

    what: Pulled
    t: Float[Array, ""]
    state: Any
    course: Course
    scheme: "_Scheme"

    def window(self, span: Float[Array, ""]) -> _Window:
        """Returns the window in which nothing changes."""
        x0 = ravel_pytree(self.state)[0]
        of_each = () if self.course.sigma.size == 2 else (2,)
        tangents, rows = jnp.zeros((DEGREE + 1, *of_each), x0.dtype), DEGREE * math.prod(of_each)
        inverse = jnp.zeros((rows, rows), x0.dtype)
        x = jnp.tile(x0, (DEGREE + 1, 1))
        return _Window(span, tangents, x, inverse, jnp.asarray(0), jnp.asarray(False))

    def depends_on_time(self) -> bool:
        """Returns whether what acts on the body depends on time otherwise than through the state."""
        x0, unravel = ravel_pytree(self.state)

        def act(t: Float[Array, ""], x: Float[Array, " size"], speed: Float[Array, ""]) -> Response:
            state = unravel(x)
            released = state if isinstance(state, ReleasedState) else ReleasedState(state, jnp.zeros(3, x.dtype), speed)
            return response(self.what.body, t, released, touching=jnp.asarray(True))

        return depends_on_time(jax.make_jaxpr(act)(self.t, x0, self.course.speed))

    def accelerations(self, window: _Window, turned: bool = False) -> tuple[Array, Array, Array]:
        """Computes, at the nodes, the slip accelerations and the rates of the states.

        If σ is ``turned``, also how the accelerations change with the tangents, otherwise zeros.
        """
        unravel = ravel_pytree(self.state)[1]

        def at_node(t: Float[Array, ""], x: Float[Array, " size"], tangent: Array) -> tuple:
            state = unravel(x)
            prepare = self.what.prepare(t, state)

            def pull(tangent: Array) -> tuple[Array, Array]:
                a, moved = self.what.pull(t, state, prepare, _turn(self.course.sigma, tangent))
                return a, ravel_pytree(moved)[0]

            if not turned:
                return *pull(tangent), jnp.zeros_like(self.course.sigma)
            if tangent.ndim:
                along = [jax.jvp(pull, (tangent,), (axis,), has_aux=True) for axis in jnp.eye(2, dtype=tangent.dtype)]
                return along[0][0], along[0][2], jnp.stack([change for _, change, _ in along])
            a, change, rate = jax.jvp(pull, (tangent,), (jnp.ones_like(tangent),), has_aux=True)
            return a, rate, change

        times = self.t + window.span * self.scheme.nodes
        # A loop over the nodes compiles in half the time of all nodes side by side, and runs as fast.
        return jax.lax.map(lambda node: at_node(*node), (times, window.x, window.tangents))

    def integrate(self, window: _Window, a: Array, rate: Array) -> tuple[Array, Array, Array, Array]:
        """Computes, at the nodes, σ, the components of v_s across and along it, and the states.

        Where σ has three components, the one along it is along the direction from which it turns, and those across
        it are what v_s lacks in the tangents times that.
        """
        integrals, x0 = window.span * self.scheme.integrals, ravel_pytree(self.state)[0]
        slips, x = (linear.product(integrals, y) for y in (a, rate))
        sigmas = jax.vmap(lambda tangent: _turn(self.course.sigma, tangent))(window.tangents)
        slips = self.course.slip[None] + slips
        if window.tangents.ndim == 2:
            along = jnp.sum(slips * self.course.sigma[None], axis=1)
            beside = linear.product(slips, _beside(self.course.sigma).T)
            return sigmas, beside - window.tangents * along[:, None], along, x0[None] + x
        return sigmas, jax.vmap(across)(sigmas, slips), jnp.sum(sigmas * slips, axis=1), x0[None] + x

    def newton(self, window: _Window, sigmas: Array, along: Array, change: Array) -> Float[Array, "rows rows"]:
        """Computes the inverse of the matrix of Newton's method."""
        integrals = window.span * self.scheme.integrals
        if window.tangents.ndim == 2:
            # Derivatives of a by each tangent: their parts beside the direction from which σ turns, and along it.
            beside = jnp.sum(change[:, :, None, :] * _beside(self.course.sigma)[None, None], axis=-1)
            forward = jnp.sum(change * self.course.sigma[None, None], axis=-1)
            turned = jnp.swapaxes(beside, 1, 2)[None] - window.tangents[:, None, :, None] * forward[None, :, None, :]
            slopes = integrals[:, :, None, None] * turned  # nodes, nodes, components, tangents
            eye, diagonal = jnp.eye(2, dtype=along.dtype), jnp.diag(along)[:, :, None, None]
            rows = jnp.swapaxes((slopes - diagonal * eye[None, None])[1:, 1:], 1, 2)
            return linear.inverses(jnp.reshape(rows, (1, 2 * DEGREE, 2 * DEGREE)))[0]
        # The component of v_s across σ changes with all tangents, as v_s does, and with its own because σ turns away.
        slopes = integrals * jax.vmap(lambda sigma: jax.vmap(lambda two: across(sigma, two))(change))(sigmas)
        return linear.inverses((slopes - jnp.diag(along / (1 + window.tangents**2)))[None, 1:, 1:])[0]

    def settle(self, window: _Window) -> Array:
        """Computes the tangents of a window that has been found, after as many more sweeps as give their
        derivatives.
        """

        def sweep(window: _Window, _: None) -> tuple[_Window, None]:
            aside, x = self.integrate(window, *self.accelerations(window)[:2])[1::2]
            return window._replace(x=x, tangents=window.turn(aside)), None

        # With the matrix at the end of the search. The values have converged, and the error of the derivatives shrinks
        # with each sweep as that of the values did.
        return jax.lax.scan(sweep, window, None, length=SWEEPS)[0].tangents


class _Scheme(NamedTuple):
    """Nodes from 0 to 1, and what takes the values at the nodes to other numbers.

    ``integrals`` are those from 0 to each node, ``powers`` the coefficients of the polynomial through all of them,
    ``highest`` the last coefficient, by Legendre, and ``first`` the value at 0, of the polynomial that is integrated.
    """

    nodes: Array
    integrals: Array
    powers: Array
    highest: Array
    first: Array


def _scheme(course: Course) -> _Scheme:
    """Returns the nodes of Lobatto where a slip begins, and of Radau where it goes on."""
    begins, goes_on = (_Scheme(*map(jnp.asarray, parts)) for parts in _schemes(course.sigma.dtype))
    return select_tree(course.speed == 0, begins, goes_on)


@cache
def _schemes(dtype: np.dtype) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Returns the numbers of both schemes."""
    legendre = np.polynomial.legendre
    inner = np.sort(np.real(legendre.Legendre.basis(DEGREE).deriv().roots()))
    # The polynomial P_n − P_{n−1} has the nodes of Radau, with 1 at the end.
    radau = np.sort(np.real(legendre.legroots(np.eye(DEGREE + 1)[DEGREE] - np.eye(DEGREE + 1)[DEGREE - 1])))

    def scheme(x: np.ndarray, solved: int) -> tuple[np.ndarray, ...]:
        """Builds that of the nodes, from −1 to 1, of which those from ``solved`` on carry the polynomial."""
        nodes, used = (x + 1) / 2, x[solved:]
        coefficients = np.linalg.inv(legendre.legvander(used, used.size - 1))

        def of_all(rows: np.ndarray) -> np.ndarray:
            return np.concatenate([np.zeros((*rows.shape[:-1], solved)), rows], axis=-1)

        integrals = of_all(legendre.legval(x, legendre.legint(coefficients, lbnd=-1)).T / 2)
        # No time has passed at the first node; rounding would set off the slip there.
        integrals[0] = 0.0
        powers = np.linalg.inv(np.vander(nodes, increasing=True))
        first = legendre.legval(x[0], coefficients) if solved else np.eye(x.size)[0]
        parts = nodes, integrals, powers, of_all(coefficients[-1]), of_all(first)
        return tuple(part.astype(dtype) for part in parts)

    return scheme(np.concatenate([[-1.0], inner, [1.0]]), 0), scheme(np.concatenate([[-1.0], radau[:-1], [1.0]]), 1)


def _turn(sigma: Float[Array, " n"], tangent: Array) -> Float[Array, " n"]:
    """Returns σ turned by the angle with this tangent; with three components, by two tangents."""
    if tangent.ndim:
        return unit(sigma + jnp.sum(tangent[:, None] * _beside(sigma), axis=0))
    return (sigma + tangent * turn_left(sigma)) / jnp.sqrt(1 + tangent**2)


def _beside(sigma: Float[Array, "3"]) -> Float[Array, "2 3"]:
    """Returns two unit vectors, perpendicular to σ and to each other."""
    axis = jnp.eye(3, dtype=sigma.dtype)[jnp.argmin(jnp.abs(sigma))]
    first = unit(cross(sigma, axis))
    return jnp.stack([first, cross(sigma, first)])


def _sum_weighted(weights: Float[Array, " nodes"], tangents: Array) -> Array:
    """Computes the sum of the tangents of all nodes, each with its weight."""
    return jnp.sum(weights * tangents if tangents.ndim == 1 else weights[:, None] * tangents, axis=0)


def _size(tangent: Array) -> Float[Array, ""]:
    return jnp.abs(tangent) if tangent.ndim == 0 else root(jnp.sum(tangent**2))


def _least_turning(sigma: Float[Array, " n"], change: Array) -> Float[Array, ""]:
    """Computes the component across σ of the change of a as σ turns, where that is least."""
    if sigma.size == 2:
        return across(sigma, change)
    (a, b), (c, d) = linear.product(change, _beside(sigma).T)
    return 0.5 * (a + d) - root(0.25 * (a - d) ** 2 + 0.25 * (b + c) ** 2)
