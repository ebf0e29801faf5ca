"""How a slip begins and how it ends, where its direction σ = v_s/|v_s| cannot be computed from its velocity.

Rolling under exact dry resistance begins and ends in the same way, with ω_h in place of v_s (``dry_rolling``).

With the angle φ of σ and the speed s, a slip obeys ṡ = a·σ and s φ̇ = a·n, where n is σ turned by a right angle and
the slip acceleration a = v̇_s is a smooth function of φ and of the motion of the rest. Both ends, s = 0, are singular.

**A slip begins** along the direction in which it grows. The solution with v_s = 0 at the start is smooth; others
approach it as a power of the time, or faster. So it is found by collocation, on a short window of time: the motion of
the rest and v_s at the nodes of Lobatto's quadrature follow from the accelerations there, and σ at each node is the
direction of v_s. Within the window a solve takes σ from the polynomial through these, and v_s from its acceleration as
usual, so that the end of the window is not a kink.

**A slip ends** in a finite time, in which its direction turns ever faster. In the time τ with dt = s dτ nothing is
singular: φ′ = a·n, (ln s)′ = a·σ, t′ = s. Where the slip is slow, the rest hardly moves until the end, and the slip is
followed to its end with the response of the body halfway.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ...numerics import cooper_verner
from ...numerics.arrays import select_tree
from ...numerics.calculus import with_derivatives
from ...numerics.directions import across, turn_left, unit
from ...numerics.linear import inverses, solutions
from ...numerics.vectors import root
from ...programs.derivatives.differentiation import without_derivatives
from ..body import AbstractBody
from ..hybrid import Accuracy
from .friction import sliding
from .released import ReleasedState, Response, rates, response, slip_velocity

DEGREE = 6  # of the polynomial through the directions of a slip that begins
SHORTER_WINDOW = 0.4  # a window that is too long, when it is tried again
RESOLVED = 2e-11  # the last coefficient of the polynomial in a window that is short enough
SWEEPS = 10  # of collocation, each of which gains two digits, with one window
MOST_SWEEPS = 4 * SWEEPS  # with four windows
NEARLY_STILL = 3  # times the least speed of a slip: a slower one may end in the next step
SAME_SPEED = 1e-9  # of a speed: what rounding may change
PAST = 0.5  # of the least speed: a step is to end no slower than that
TRUNCATED = 2e5  # tolerances: the largest error of a step, relative to the speed of a slip that ends, for derivatives
SLOW = 0.3  # power of rounding: a slip slower than this share of a body's speed is followed by `end`, not by steps
UNTOLD = 10  # errors of the speed: steps cannot tell the direction of so slow a slip
ERRORS = 30  # errors of the speed, by which a slip at its end may exceed twice the least one
LONGEST_WINDOW = 0.1  # of √(r/g): the longest time for which the direction of a slip that begins is known beforehand
BEFORE_KINK = 0.999  # of the time until the next kink: no window is longer than that
LONGEST_PAUSE = 0.25  # power of rounding: the longest time, in √(r/g), over which a slip is followed to its end
COARSER = 0.3  # times the cube root of the tolerance: the same if that is loose, as the error is cubic in the time
HALFWAY = 0.5  # through the time, and the speed, of a slip that ends
STEPS_TO_END = 24  # in the time τ, to the end of a slip
TURN = 1.5  # by which σ turns and ln s falls in one of them, at most


class Beginning(NamedTuple):
    """The direction of a slip in a window of time from its beginning, ``span`` long, which ends at ``until``.

    It is ``sigma`` at first, and turns from there by the angle whose tangent is the polynomial Σ bends[k] uᵏ⁺¹ in the
    share u of the window.
    """

    until: Float[Array, "*batch"]
    span: Float[Array, "*batch"]
    sigma: Float[Array, "*batch 2"]
    bends: Float[Array, "*batch degree"]

    @classmethod
    def none(cls, like: Float[Array, ""]) -> "Beginning":
        """Returns the direction of a slip that began long ago."""
        # Not −∞, nor the largest number: differences from it, and their squares, are to be finite.
        never = jnp.full_like(like, -(float(jnp.finfo(like.dtype).max) ** 0.5))
        return cls.along(never, jnp.zeros((2,), like.dtype))

    @classmethod
    def along(cls, until: Float[Array, "*batch"], sigma: Float[Array, "*batch 2"]) -> "Beginning":
        """Returns the direction of a slip that does not turn."""
        return cls(until, jnp.ones_like(until), sigma, jnp.zeros((*until.shape, DEGREE), sigma.dtype))

    def direction(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Computes σ at a time in the window."""
        # Limited, because this is evaluated outside the window, too, where it is not used: powers of a long time would
        # overflow, and their derivatives be NaN.
        u, tangent = jnp.clip(1 + (t - self.until) / self.span, 0.0, 1.0), jnp.zeros_like(t)
        for k in reversed(range(DEGREE)):
            tangent = u * (self.bends[k] + tangent)
        return _turn(self.sigma, tangent)


class Heading(NamedTuple):
    """The direction σ of a slip as a step begins, and along it its ``speed``; slower than ``least``, it soon ends."""

    sigma: Float[Array, "2"]
    speed: Float[Array, ""]
    least: Float[Array, ""]

    @classmethod
    def of(
        cls,
        sigma: Float[Array, "2"],
        slip: Float[Array, "2"],
        size: Float[Array, ""],
        errors: Float[Array, ""],
        power: float,
    ) -> "Heading":
        """Returns the heading of a slip in the direction σ: ``size`` is the size of velocities, ``errors`` the size of
        their errors, and ``power`` that of rounding which is slow.
        """
        speed = jnp.maximum(jnp.sum(slip * sigma), 0.0)
        # The guard of a slip is its speed along σ less ``least``: with at most half the speed, it is positive as a step
        # begins.
        least = jnp.maximum(float(jnp.finfo(speed.dtype).eps) ** power * size, UNTOLD * errors)
        return cls(sigma, speed, jnp.minimum(least, 0.5 * speed))


class Pull(NamedTuple):
    """What acts on a slip in some direction σ.

    ``acceleration`` is a, ``power`` that of friction over the speed, and ``normal`` the normal force.
    """

    acceleration: Float[Array, "2"]
    power: Float[Array, ""]
    normal: Float[Array, ""]


@runtime_checkable
class Pulled(Protocol):
    """What slips, a PyTree: how it is pulled in a direction σ.

    ``prepare`` is whatever does not depend on σ, and ``pull`` gives a and the rates of the state.
    """

    def prepare(self, t: Float[Array, ""], state: Any) -> Any: ...

    def pull(
        self, t: Float[Array, ""], state: Any, prepare: Any, sigma: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Any]: ...


class OnPlane(NamedTuple):
    """A body that slips; ``coefficient`` gives μ for a slip velocity."""

    body: AbstractBody
    coefficient: Callable[[Float[Array, "3"]], Float[Array, ""]]

    def prepare(self, t: Float[Array, ""], state: ReleasedState) -> tuple[Response, Float[Array, ""]]:
        """Computes the response of the body, and μ."""
        body_response = response(
            self.body, t, state, touching=jnp.asarray(True)
        )  # as elsewhere, so that it is traced once
        return body_response, self.coefficient(slip_velocity(self.body, t, state))

    def pull(
        self,
        t: Float[Array, ""],
        state: ReleasedState,
        prepare: tuple[Response, Float[Array, ""]],
        sigma: Float[Array, "2"],
    ) -> tuple[Float[Array, "2"], ReleasedState]:
        """Computes the slip acceleration along the ground, and ẋ."""
        body_response, mu = prepare
        acting = sliding(body_response, mu, sigma)
        moved = rates(self.body, state, body_response, acting.slip_acceleration, acting.normal)
        return acting.slip_acceleration[:2], moved


class Around(NamedTuple):
    """What a slow slip depends on, which changes linearly with the time: ``now``, and what it is ``later``, after the
    time ``span``; None where it is constant.
    """

    now: Any
    later: Any = None
    span: Any = None

    def at(self, time: Float[Array, ""]) -> Any:
        """Returns what it is after some time."""
        if self.later is None:
            return self.now
        share = jnp.where(self.span > 0, time / jnp.where(self.span > 0, self.span, 1.0), 0.0)

        def between(x: Array, later: Array) -> Array:
            return x + share * (later - x) if jnp.issubdtype(x.dtype, jnp.inexact) else x

        return jax.tree.map(between, self.now, self.later)


def pull_of_friction(
    about: tuple[Response, Float[Array, "3"]], sigma: Float[Array, "2"], slower: Float[Array, ""]
) -> Pull:
    """Computes how a body with some response slips, where ``slower`` is the share of its speed that is left and the
    coefficient μ a polynomial in that.
    """
    body_response, mu = about
    acting = sliding(body_response, mu[0] + slower * (mu[1] + slower * mu[2]), sigma)
    return Pull(acting.slip_acceleration[:2], -jnp.sum(sigma * acting.R[:2]), acting.normal)


class End(NamedTuple):
    """The end of a slow slip: whether it ends, in which time, and what happens until then.

    ``friction_loss`` is the work of friction, ``way`` the integral of v_s, ``normal`` the mean normal force, and
    ``late_normal`` that with weights that rise from 0 at the beginning to 2 at the end.
    """

    comes: Bool[Array, ""]
    time: Float[Array, ""]
    friction_loss: Float[Array, ""]
    way: Float[Array, "2"]
    normal: Float[Array, ""]
    late_normal: Float[Array, ""]

    def braking(self, slip: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Computes the mean slip acceleration, by which a slip is exactly zero in the end, and that with the weights of
        ``late_normal``.
        """
        ends = self.time > 0
        time = jnp.where(ends, self.time, 1.0)
        mean = jnp.where(ends, -slip / time, 0.0).at[2].set(0.0)
        return mean, jnp.zeros_like(slip).at[:2].set(-2 * self.way / time**2)


@partial(jax.jit, static_argnums=0)
def end(
    pull: Callable[[Any, Float[Array, "2"], Float[Array, ""]], Pull], around: Around, slip: Float[Array, "2"]
) -> End:
    """Computes the end of a slow slip, during which what is ``around`` it changes little.

    It ends if the direction to which the slip turns is one in which it slows down.
    """
    # In the time τ, x is: σ, the logarithm of the share of the speed that is left, and integrals over the time: 1 and N
    # over the speed, the work of friction, v_s and t N over its square. So x hardly depends on how slow the slip is.
    speed = root(jnp.sum(slip**2))
    still = jax.lax.stop_gradient(around.now)

    @jax.jit
    def motion(x: Float[Array, "9"]) -> Float[Array, "9"]:
        sigma, slower, time = unit(x[:2]), jnp.exp(x[2]), x[3]
        acting = pull(around.at(speed * time), sigma, slower)
        a, pressing = acting.acceleration, acting.normal * slower
        rest = jnp.stack([jnp.sum(sigma * a), slower, pressing, acting.power * slower**2, time * pressing])
        return jnp.concatenate([across(sigma, a) * turn_left(sigma), rest, slower**2 * sigma])

    def fastest(x: Float[Array, "9"]) -> Float[Array, ""]:
        sigma, slower = unit(x[:2]), jnp.exp(x[2])
        acting, turned = jax.jvp(lambda sigma: pull(still, sigma, slower), (sigma,), (turn_left(sigma),))
        return root(jnp.sum(acting.acceleration**2)) + root(jnp.sum(turned.acceleration**2))

    def advance(x: Float[Array, "9"], _: None) -> tuple[Float[Array, "9"], None]:
        # How fast σ may turn, which decides the step and is no part of the result, so it has no derivatives.
        rate = fastest(jax.lax.stop_gradient(x))
        h = jnp.where(rate > 0, TURN / jnp.where(rate > 0, rate, 1.0), 0.0)
        return cooper_verner.step(motion, x, h), None

    start = jnp.concatenate([unit(slip), jnp.zeros((7,), slip.dtype)])
    x = jax.lax.scan(advance, start, None, length=STEPS_TO_END)[0]
    # By now σ hardly turns: from here on the slip slows down uniformly, in the time slower / −growth.
    growth, slower, pressing, power = motion(x)[2:6]
    comes = (growth < 0) & (x[2] < 0)
    left_of_it = 1 / jnp.where(comes, -growth, 1.0)
    until_end = slower * left_of_it
    time, impulse, friction_loss = x[3] + until_end, x[4] + pressing * left_of_it, x[5] + 0.5 * power * left_of_it
    moment = x[6] + pressing * left_of_it * (x[3] + 0.5 * until_end)
    way, whole = x[7:] + 0.5 * slower * until_end * unit(x[:2]), jnp.where(time > 0, time, 1.0)
    return End(comes, speed * time, speed**2 * friction_loss, speed**2 * way, impulse / whole, 2 * moment / whole**2)


def longest_pause(tolerance: Float[Array, ""], unit_of_time: Float[Array, ""]) -> Float[Array, ""]:
    """Computes the longest time over which a slip is followed to its end by :func:`end`."""
    eps = float(jnp.finfo(unit_of_time.dtype).eps)
    return jnp.maximum(eps**LONGEST_PAUSE, COARSER * jnp.cbrt(tolerance)) * unit_of_time


def longest_window(
    t: Float[Array, ""], kinks: Float[Array, " kinks"], unit_of_time: Float[Array, ""]
) -> Float[Array, ""]:
    """Computes the longest time from ``t`` on for which the direction of a slip that begins is computed beforehand."""
    # A polynomial cannot follow a slip through a kink. Where the window ends is a choice, and has no derivatives.
    kink = jnp.min(jnp.where(kinks > t, kinks, jnp.inf), initial=jnp.inf)
    return jax.lax.stop_gradient(jnp.minimum(LONGEST_WINDOW * unit_of_time, BEFORE_KINK * (kink - t)))


def unit_of_time(body: AbstractBody) -> Float[Array, ""]:
    """Computes √(r/g); √r without gravity."""
    g = jnp.abs(body.gravity)
    return root(body.radius / jnp.where(g > 0, g, 1.0))


def nears_its_end(before: Float[Array, ""], after: Float[Array, ""], least: Float[Array, ""]) -> Bool[Array, ""]:
    """Returns whether a step has slowed down a slip that was slow when it began, so that its end may have come.

    Where friction is hardly needed to hold the body, the direction of a slow slip returns to that in which it ends much
    faster than the slip slows down. Steps are then too short to halve its speed, and would never meet a zero of the
    guard.
    """
    # ``Heading.of`` limits ``least`` to half the speed: equality, up to rounding, says that this limit was in force.
    return (before <= (2 + SAME_SPEED) * least) & (after < before)


def longest_step(
    before: Float[Array, ""],
    after: Float[Array, ""],
    least: Float[Array, ""],
    length: Float[Array, ""],
    accuracy: Accuracy,
) -> Float[Array, ""]:
    """Computes the longest next step after one of this length in which a slip has slowed down; infinite where it has
    not.

    It is a fraction of the time until the end of the slip, where the direction turns ever faster, and goes beyond the
    least speed at most half way to the end, because the stages of a step across the end pull in both directions, which
    a low-order method may not notice as an error.
    """
    # Close to the end, the error of a step grows as its share of the time until then, to the power of order + 1.
    share = jnp.minimum((TRUNCATED * accuracy.tolerance) ** (1 / (accuracy.order + 1)), accuracy.approach)
    slows = (after > 0) & (before > after)
    until_end = after * length / jnp.where(slows, before - after, 1.0)
    safe = 1 - PAST * least / jnp.where(slows, after, 1.0)
    longest = until_end * jnp.where(after > NEARLY_STILL * least, jnp.minimum(share, safe), safe)
    return jnp.where(slows & (longest > 0), longest, jnp.inf)


def beginning(
    what: Pulled, t: Float[Array, ""], state: Any, sigma: Float[Array, "2"], longest: Float[Array, ""]
) -> Beginning:
    """Computes how a slip begins at ``t``, where its velocity is zero, in the direction ``sigma``: in the ``longest``
    window, or a shorter one in which a polynomial can follow it.
    """
    start = _Start(what, t, state, sigma)
    # The search has no derivatives, for which ``settle`` makes some more sweeps, only where they are asked for.
    still, highest = without_derivatives(start), _lobatto(sigma.dtype).highest
    longest = jax.lax.stop_gradient(longest)
    begun = still.window(longest)

    def sweep(window: _Window) -> _Window:
        # One sweep: accelerations at the nodes with the directions so far, their integrals, and better directions from
        # these.
        a, rate, change = still.accelerations(window, turned=True)
        sigmas, aside, along, x = still.integrate(window, a, rate)
        window = window._replace(x=x, inverse=still.newton(window, sigmas, along, change))
        tangents, sweeps = window.turn(aside), window.sweeps + 1
        # The polynomial is judged after a full number of sweeps: before, all its coefficients still change. Where v_s
        # goes against σ, the sweeps have come to a direction in which no slip grows.
        done, converges = (
            sweeps % SWEEPS == 0,
            (jnp.abs(jnp.sum(highest * tangents)) <= RESOLVED) & jnp.all(along[1:] > 0),
        )
        # If the shortest window fails as well, its last polynomial is used all the same.
        again = done & ~converges & (sweeps < MOST_SWEEPS)
        shorter = begun._replace(span=SHORTER_WINDOW * window.span, sweeps=sweeps)
        window = window._replace(tangents=tangents, sweeps=sweeps, found=done & converges)
        return select_tree(again, shorter, window)

    window = jax.lax.while_loop(lambda window: ~window.found & (window.sweeps < MOST_SWEEPS), sweep, begun)
    tangents = with_derivatives(window.tangents, _Start.settle, start, window)
    bends = jnp.sum(_lobatto(sigma.dtype).powers * tangents[None], axis=1)[1:]
    return Beginning(t + window.span, window.span, sigma, bends)


class _Window(NamedTuple):
    """A window of time in which a slip begins: tangents of the angles by which σ turns, and the states, at nodes.

    ``inverse`` is that of the matrix of Newton's method for the directions.
    """

    span: Float[Array, ""]
    tangents: Float[Array, " nodes"]
    x: Float[Array, "nodes size"]
    inverse: Float[Array, "rows rows"]
    sweeps: Array
    found: Bool[Array, ""]

    def turn(self, aside: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
        """Computes the tangents after a step of Newton's method: at each node but the first, σ is to be the direction
        of v_s.
        """
        # At the first node the slip is zero, and σ is the given one. Far from the solution a step of Newton's method
        # may lead anywhere, so it is limited.
        turns = solutions(self.inverse[None], aside[None, 1:])[0]
        return self.tangents.at[1:].add(-jnp.clip(turns, -1.0, 1.0))


class _Start(NamedTuple):
    """Where a slip begins, and in which direction."""

    what: Pulled
    t: Float[Array, ""]
    state: Any
    sigma: Float[Array, "2"]

    def window(self, span: Float[Array, ""]) -> _Window:
        """Returns the window in which nothing changes."""
        x0 = ravel_pytree(self.state)[0]
        tangents = jnp.zeros((DEGREE + 1,), x0.dtype)
        inverse = jnp.zeros((DEGREE, DEGREE), x0.dtype)
        x = jnp.tile(x0, (DEGREE + 1, 1))
        return _Window(span, tangents, x, inverse, jnp.asarray(0), jnp.asarray(False))

    def accelerations(self, window: _Window, turned: bool = False) -> tuple[Array, Array, Array]:
        """Computes, at the nodes, the slip accelerations and the rates of the states.

        If σ is ``turned``, also how the accelerations change with the tangents, otherwise zeros.
        """
        unravel = ravel_pytree(self.state)[1]

        def at_node(t: Float[Array, ""], x: Float[Array, " size"], tangent: Float[Array, ""]) -> tuple:
            state = unravel(x)
            prepare = self.what.prepare(t, state)

            def pull(tangent: Float[Array, ""]) -> tuple[Array, Array]:
                a, moved = self.what.pull(t, state, prepare, _turn(self.sigma, tangent))
                return a, ravel_pytree(moved)[0]

            if not turned:
                return *pull(tangent), jnp.zeros_like(self.sigma)
            a, change, rate = jax.jvp(pull, (tangent,), (jnp.ones_like(tangent),), has_aux=True)
            return a, rate, change

        times = self.t + window.span * _lobatto(window.x.dtype).nodes
        # A loop over the nodes compiles in half the time of all nodes side by side, and runs as fast.
        return jax.lax.map(lambda node: at_node(*node), (times, window.x, window.tangents))

    def integrate(self, window: _Window, a: Array, rate: Array) -> tuple[Array, Array, Array, Array]:
        """Computes, at the nodes, σ, the components of v_s across and along it, and the states."""
        integrals, x0 = window.span * _lobatto(window.x.dtype).integrals, ravel_pytree(self.state)[0]
        slips, x = (jnp.sum(integrals[:, :, None] * y[None], axis=1) for y in (a, rate))
        sigmas = jax.vmap(lambda tangent: _turn(self.sigma, tangent))(window.tangents)
        return sigmas, jax.vmap(across)(sigmas, slips), jnp.sum(sigmas * slips, axis=1), x0[None] + x

    def newton(self, window: _Window, sigmas: Array, along: Array, change: Array) -> Float[Array, "rows rows"]:
        """Computes the inverse of the matrix of Newton's method."""
        integrals = window.span * _lobatto(window.x.dtype).integrals
        # The component of v_s across σ changes with all tangents, as v_s does, and with its own because σ turns away.
        slopes = integrals * jax.vmap(lambda sigma: jax.vmap(lambda two: across(sigma, two))(change))(sigmas)
        return inverses((slopes - jnp.diag(along / (1 + window.tangents**2)))[None, 1:, 1:])[0]

    def settle(self, window: _Window) -> Float[Array, " nodes"]:
        """Computes the tangents of a window that has been found, after as many more sweeps as give their
        derivatives.
        """

        def sweep(window: _Window, _: None) -> tuple[_Window, None]:
            aside, x = self.integrate(window, *self.accelerations(window)[:2])[1::2]
            return window._replace(x=x, tangents=window.turn(aside)), None

        # With the matrix at the end of the search. The values have converged, and the error of the derivatives shrinks
        # with each sweep as that of the values did.
        return jax.lax.scan(sweep, window, None, length=SWEEPS)[0].tangents


class _Lobatto(NamedTuple):
    """Nodes from 0 to 1, the integrals from 0 to each of them, the powers of a polynomial, its highest coefficient.

    All but the nodes are matrices that take the values at the nodes to these; the last is that of Legendre.
    """

    nodes: np.ndarray
    integrals: np.ndarray
    powers: np.ndarray
    highest: np.ndarray


@cache
def _lobatto(dtype: np.dtype) -> _Lobatto:
    legendre = np.polynomial.legendre
    inner = np.real(legendre.Legendre.basis(DEGREE).deriv().roots())
    x = np.concatenate([[-1.0], np.sort(inner), [1.0]])
    coefficients = np.linalg.inv(legendre.legvander(x, DEGREE))
    integrals = legendre.legval(x, legendre.legint(coefficients, lbnd=-1)).T / 2
    # No time has passed at the first node; rounding would set off the slip there.
    integrals[0] = 0.0
    nodes = (x + 1) / 2
    parts = nodes, integrals, np.linalg.inv(np.vander(nodes, increasing=True)), coefficients[-1]
    return _Lobatto(*(part.astype(dtype) for part in parts))


def _turn(sigma: Float[Array, "2"], tangent: Float[Array, ""]) -> Float[Array, "2"]:
    """Returns σ turned by the angle with this tangent."""
    return (sigma + tangent * turn_left(sigma)) / jnp.sqrt(1 + tangent**2)
