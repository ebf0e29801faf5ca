"""The two ends of a slip, where its direction σ = v_s/|v_s| cannot be computed from its velocity.

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
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ...numerics import cooper_verner
from ...numerics.linear import inverses, solutions
from ...numerics.norms import root
from ..body import AbstractBody
from ..hybrid import Accuracy
from .friction import across, left, sliding, unit
from .released import ReleasedState, Response, rates, response, slip_velocity

DEGREE = 6  # of the polynomial through the directions of a slip that begins
SHORTER = 0.4  # a window that is too long, when it is tried again
RESOLVED = 2e-11  # the last coefficient of the polynomial in a window that is short enough
SWEEPS = 10  # of collocation, each of which gains two digits, with one window
WINDOWS = 4  # that are tried
NEARLY = 3  # times the least speed of a slip: one that is slower than that may end in the next step
SAME = 1e-9  # of a speed: what rounding may change
PAST = 0.5  # of the least speed: a step is to end no slower than that
TRUNCATED = 2e5  # tolerances: the most of a step's error beside the speed of a slip that ends, for its derivatives
STEPS = 16  # in the time τ, to the end of a slip
TURN = 1.5  # by which σ turns and ln s falls in one of them, at most


class Beginning(NamedTuple):
    """The direction of a slip that has begun, until the time ``until``: ``span`` before, it was ``sigma``.

    It turns from there by the angle whose tangent is the polynomial Σ bends[k] uᵏ⁺¹ in the share u of the window.
    """

    until: Float[Array, "*batch"]
    span: Float[Array, "*batch"]
    sigma: Float[Array, "*batch 2"]
    bends: Float[Array, "*batch degree"]

    @classmethod
    def none(cls, like: Float[Array, ""]) -> "Beginning":
        """The direction of a slip that began long ago."""
        never = jnp.full_like(like, -(float(jnp.finfo(like.dtype).max) ** 0.5))
        return cls.along(never, jnp.zeros((2,), like.dtype))

    @classmethod
    def along(cls, until: Float[Array, "*batch"], sigma: Float[Array, "*batch 2"]) -> "Beginning":
        """The direction of a slip that does not turn."""
        return cls(until, jnp.ones_like(until), sigma, jnp.zeros((*until.shape, DEGREE), sigma.dtype))

    def direction(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """σ at a time in the window."""
        u, tangent = jnp.clip(1 + (t - self.until) / self.span, 0.0, 1.0), jnp.zeros_like(t)
        for k in reversed(range(DEGREE)):
            tangent = u * (self.bends[k] + tangent)
        return _turned(self.sigma, tangent)


class End(NamedTuple):
    """The end of a slow slip: whether it ends, in which time, and the work of friction.

    ``rubbed`` is the work of friction, and ``normal`` the mean normal force.
    """

    comes: Bool[Array, ""]
    time: Float[Array, ""]
    rubbed: Float[Array, ""]
    normal: Float[Array, ""]


@jax.jit
def end(found: Response, mu: Float[Array, ""], slip: Float[Array, "3"]) -> End:
    """The end of a slow slip, during which the body's response is constant.

    It ends if the direction to which the slip turns is one in which it slows down.
    """
    speed = root(jnp.sum(slip[:2] ** 2))

    @jax.jit
    def motion(x: Float[Array, "6"]) -> tuple[Float[Array, "6"], Float[Array, ""]]:
        sigma, slower = unit(x[:2]), jnp.exp(x[2])
        acting, turned = jax.jvp(lambda sigma: sliding(found, mu, sigma), (sigma,), (left(sigma),))
        a, change = acting.slip_acceleration[:2], turned.slip_acceleration[:2]
        growth, power = jnp.sum(sigma * a), -jnp.sum(sigma * acting.R[:2])
        rest = jnp.stack([growth, slower, power * slower**2, acting.normal * slower])
        fastest = root(jnp.sum(a**2)) + root(jnp.sum(change**2))
        return jnp.concatenate([across(sigma, a) * left(sigma), rest]), jax.lax.stop_gradient(fastest)

    def advanced(x: Float[Array, "6"], _: None) -> tuple[Float[Array, "6"], None]:
        fastest = motion(x)[1]
        h = TURN / jnp.where(fastest > 0, fastest, 1.0)
        return cooper_verner.step(lambda x: motion(x)[0], x, jnp.where(fastest > 0, h, 0.0)), None

    start = jnp.concatenate([unit(slip[:2]), jnp.zeros((4,), slip.dtype)])
    x = jax.lax.scan(advanced, start, None, length=STEPS)[0]
    growth, slower, power, normal = motion(x)[0][2:]
    comes = (growth < 0) & (x[2] < 0)
    left_of_it = 1 / jnp.where(comes, -growth, 1.0)
    time = x[3] + slower * left_of_it
    rubbed, pressed = x[4] + 0.5 * power * left_of_it, x[5] + normal * left_of_it
    return End(comes, speed * time, speed**2 * rubbed, pressed / jnp.where(time > 0, time, 1.0))


def nears_its_end(before: Float[Array, ""], after: Float[Array, ""], least: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether a step has slowed down a slip that was slow when it began, so that its end may have come.

    Where friction is hardly needed to hold the body, the direction of a slow slip returns to that in which it ends much
    faster than the slip slows down. Steps are then too short to halve its speed, and would never meet a zero of the
    guard.
    """
    return (before <= (2 + SAME) * least) & (after < before)


def longest_step(
    before: Float[Array, ""],
    after: Float[Array, ""],
    least: Float[Array, ""],
    length: Float[Array, ""],
    accuracy: Accuracy,
) -> Float[Array, ""]:
    """The longest next step after one of this length in which a slip has slowed down; infinite where it has not.

    It is a fraction of the time until the end of the slip, where the direction turns ever faster, and goes beyond the
    least speed at most half way to the end, because the stages of a step across the end pull in both directions, which
    a low-order method may not notice as an error.
    """
    share = jnp.minimum((TRUNCATED * accuracy.tolerance) ** (1 / (accuracy.order + 1)), accuracy.approach)
    slows = (after > 0) & (before > after)
    until_end = after * length / jnp.where(slows, before - after, 1.0)
    safe = 1 - PAST * least / jnp.where(slows, after, 1.0)
    longest = until_end * jnp.where(after > NEARLY * least, jnp.minimum(share, safe), safe)
    return jnp.where(slows & (longest > 0), longest, jnp.inf)


def beginning(
    body: AbstractBody,
    coefficient: Callable[[Float[Array, "3"]], Float[Array, ""]],
    t: Float[Array, ""],
    state: ReleasedState,
    sigma: Float[Array, "2"],
    longest: Float[Array, ""],
) -> Beginning:
    """How a slip begins at ``t``, where its velocity is zero, in the direction ``sigma``: in the ``longest`` window, or
    a shorter one in which a polynomial can follow it. ``coefficient`` gives μ for a slip velocity.
    """
    at, (x0, unravel) = _lobatto(), ravel_pytree(state)
    nodes, integrals, powers = (jnp.asarray(x, x0.dtype) for x in (at.nodes, at.integrals, at.powers))
    longest = jax.lax.stop_gradient(longest)
    still = _Window(longest, jnp.zeros_like(nodes), jnp.tile(x0, (nodes.size, 1)), jnp.asarray(0), jnp.asarray(False))

    def at_node(t: Float[Array, ""], x: Float[Array, " size"], tangent: Float[Array, ""]) -> tuple[Array, ...]:
        released = unravel(x)
        found = response(body, t, released, touching=jnp.asarray(True))  # as elsewhere, so that it is traced once
        mu = coefficient(slip_velocity(body, t, released))

        def pulled(tangent: Float[Array, ""]) -> tuple[Array, Array]:
            acting = sliding(found, mu, _turned(sigma, tangent))
            moved = rates(body, released, found, acting.slip_acceleration, acting.normal)
            return acting.slip_acceleration[:2], ravel_pytree(moved)[0]

        a, change, rate = jax.jvp(pulled, (tangent,), (jnp.ones_like(tangent),), has_aux=True)
        return a, change, rate

    def sweep(window: _Window) -> _Window:
        span, tangents, x, sweeps, _ = window
        a, change, rate = jax.lax.map(lambda at: at_node(*at), (t + span * nodes, x, tangents))
        slips = span * jnp.sum(integrals[:, :, None] * a[None], axis=1)
        sigmas = jax.vmap(lambda tangent: _turned(sigma, tangent))(tangents)
        # Newton's method for the directions: at each node but the first, σ is that of v_s.
        aside = jax.vmap(across)(sigmas, slips)
        along = jnp.sum(sigmas * slips, axis=1) / (1 + tangents**2)
        slopes = span * integrals * jax.vmap(lambda one: jax.vmap(lambda two: across(one, two))(change))(sigmas)
        turns = solutions(inverses((slopes[1:, 1:] - jnp.diag(along[1:]))[None]), aside[None, 1:])[0]
        tangents = tangents.at[1:].add(-jnp.clip(turns, -1.0, 1.0))
        x = x0[None] + span * jnp.sum(integrals[:, :, None] * rate[None], axis=1)
        last = jnp.abs(jnp.sum(jnp.asarray(at.last, x0.dtype) * tangents))
        done = (sweeps + 1) % SWEEPS == 0
        found = done & (last <= RESOLVED) & jnp.all(along[1:] > 0)
        again = done & ~found & (sweeps + 1 < SWEEPS * WINDOWS)
        shorter = still._replace(span=SHORTER * span)
        after = jax.tree.map(lambda a, b: jnp.where(again, a, b), shorter, _Window(span, tangents, x, sweeps, found))
        return after._replace(sweeps=sweeps + 1)

    def part(window: _Window, _: None) -> tuple[_Window, None]:
        return jax.lax.cond(window.found, lambda window: window, sweep, window), None

    window = jax.lax.scan(part, still, None, length=SWEEPS * WINDOWS)[0]
    bends = jnp.sum(powers * window.tangents[None], axis=1)[1:]
    return Beginning(t + window.span, window.span, sigma, bends)


class _Window(NamedTuple):
    """A window of time in which a slip begins: tangents of the angles by which σ turns, and the states, at nodes."""

    span: Float[Array, ""]
    tangents: Float[Array, " nodes"]
    x: Float[Array, "nodes size"]
    sweeps: Array
    found: Bool[Array, ""]


class _Lobatto(NamedTuple):
    """Nodes from 0 to 1, the integrals from 0 to each of them, the powers of a polynomial, its last coefficient.

    All but the nodes are matrices that take the values at the nodes to these; the last is that of Legendre.
    """

    nodes: np.ndarray
    integrals: np.ndarray
    powers: np.ndarray
    last: np.ndarray


@cache
def _lobatto() -> _Lobatto:
    legendre = np.polynomial.legendre
    inner = np.real(legendre.Legendre.basis(DEGREE).deriv().roots())
    x = np.concatenate([[-1.0], np.sort(inner), [1.0]])
    coefficients = np.linalg.inv(legendre.legvander(x, DEGREE))
    integrals = legendre.legval(x, legendre.legint(coefficients, lbnd=-1)).T / 2
    integrals[0] = 0.0
    nodes = (x + 1) / 2
    return _Lobatto(nodes, integrals, np.linalg.inv(np.vander(nodes, increasing=True)), coefficients[-1])


def _turned(sigma: Float[Array, "2"], tangent: Float[Array, ""]) -> Float[Array, "2"]:
    """σ turned by the angle with this tangent."""
    return (sigma + tangent * left(sigma)) / jnp.sqrt(1 + tangent**2)
