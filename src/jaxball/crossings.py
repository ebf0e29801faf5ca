"""The times within the steps of a solve at which a function of the state crosses zero, all of them."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .sampling import sampling
from .steps import Steps

ITERATIONS = 20

Value = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, ""]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]


class Crossings(eqx.Module):
    """Where a function crossed zero.

    - ``count``: how often. ``times`` and ``vectors`` hold the first of them, as many as there is room for; NaN where
      there are fewer.
    - ``least``, ``largest``: the extreme values of the function where it was looked at.
    """

    count: Int[Array, ""]
    times: Float[Array, " room"]
    vectors: Float[Array, "room size"]
    least: Float[Array, ""]
    largest: Float[Array, ""]


def crossings(steps: Steps, value: Value, field: Field, *, direction: int, from_start: bool, room: int) -> Crossings:
    """Finds where ``value(t, x)`` becomes positive (``direction`` 1), stops being so (−1), or either (0).

    Each step is looked at in five places, and the quartic through these values in 35. Wherever its sign changes,
    the function itself is solved for its zero on the dense output. So two crossings within a step are both found if
    they are further apart than a thirtieth of it or so. A jump across zero, at a kink, counts as a crossing at the
    time of the jump.

    With ``from_start``, a solve that starts beyond zero has crossed it at its start; otherwise the start is not a
    crossing, also where the function starts from zero. Times and vectors are differentiable, by the theorem of
    implicit functions, with ẋ by ``field``.
    """
    fixed = jax.lax.stop_gradient(steps)
    samples = fixed.samples(value)
    valid = fixed.taken[:, None] & jnp.isfinite(samples)
    fine = sampling().polynomials(samples)
    scale = jnp.max(jnp.where(valid, jnp.abs(samples), 0.0))
    changes = _changes(fine, scale, direction, from_start) & fixed.taken[:, None]
    (found,) = jnp.nonzero(changes.reshape(-1), size=room, fill_value=-1)
    index, place = found // fine.shape[1], found % fine.shape[1]
    times, sizes = _zeros(value, fixed, fine, index, place, jnp.sum(found >= 0))
    times = jax.lax.stop_gradient(jnp.where(place == 0, fixed.start[index], times))
    real = (found >= 0) & ((place == 0) | (sizes <= 1e-6 * scale))

    def moved(at):
        """A time and a vector, moved to the zero by a step of Newton's, which has the derivatives of the zero."""
        i, j, t = at
        x = steps.state(i, t)
        rate = jax.lax.stop_gradient(field(t, x))
        _, slope = jax.jvp(value, jax.lax.stop_gradient((t, x)), (jnp.ones_like(t), rate))
        slope = jax.lax.stop_gradient(slope)
        smooth = (j > 0) & (slope != 0)
        change = jnp.where(smooth, -value(t, x) / jnp.where(smooth, slope, 1.0), 0.0)
        return t + change, x + rate * change

    times, vectors = jax.lax.map(moved, (index, place, times))
    order = jnp.argsort(~real, stable=True)
    keep = real[order]
    spurious = jnp.sum(found >= 0) - jnp.sum(real)
    return Crossings(
        count=jnp.sum(changes) - spurious,
        times=jnp.where(keep, times[order], jnp.nan),
        vectors=jnp.where(keep[:, None], vectors[order], jnp.nan),
        least=jnp.min(jnp.where(valid, samples, jnp.inf)),
        largest=jnp.max(jnp.where(valid, samples, -jnp.inf)),
    )


def _changes(
    fine: Float[Array, "steps fractions"], scale: Float[Array, ""], direction: int, from_start: bool
) -> Bool[Array, "steps fractions"]:
    """Where the sign changes in the right direction from the place before, the end of the last step included."""
    flat = fine.reshape(-1)
    # A start from zero, to rounding, has the sign that comes after it.
    from_zero = jnp.abs(flat[0]) <= 16 * jnp.finfo(flat.dtype).eps * scale
    start = jnp.where(from_zero, flat[1], flat[0])
    flat = flat.at[0].set(start)
    before = jnp.concatenate([(jnp.full_like(start, -direction) if from_start else start)[None], flat[:-1]]) > 0
    after = flat > 0
    rises, falls = ~before & after, before & ~after
    return {1: rises, -1: falls, 0: rises | falls}[direction].reshape(fine.shape)


def _zeros(
    value: Value,
    steps: Steps,
    fine: Float[Array, "steps fractions"],
    index: Int[Array, " room"],
    place: Int[Array, " room"],
    count: Int[Array, ""],
) -> tuple[Float[Array, " room"], Float[Array, " room"]]:
    """The zeros of ``value`` before some places in steps, where a quartic changes its sign, and |value| there.

    The rule of false position in the form of Illinois, from the values of the quartic one place further to either
    side.
    """
    fractions = jnp.asarray(sampling().fractions, fine.dtype)

    def improve(i, carry):
        (a, ga), (b, gb), _ = carry
        t = b - gb * (b - a) / jnp.where(gb == ga, 1.0, gb - ga)
        t = jnp.where((t - a) * (t - b) < 0, t, (a + b) / 2)
        g = value(t, steps.state(i, t))
        crossed, done = (g > 0) != (gb > 0), (g == 0) | (a == b)
        far, g_far = jnp.where(crossed, b, a), jnp.where(crossed, gb, ga / 2)
        return (jnp.where(done, t, far), jnp.where(done, g, g_far)), (t, g), (t, jnp.abs(g))

    def one(k, found):
        i, j = index[k], place[k]
        at = steps.start[i] + (steps.end[i] - steps.start[i]) * fractions
        left, right = jnp.maximum(j - 2, 0), jnp.minimum(j + 1, at.size - 1)
        ends = (at[left], fine[i, left]), (at[right], fine[i, right])
        t, size = jax.lax.fori_loop(0, ITERATIONS, lambda _, carry: improve(i, carry), (*ends, ends[0]))[2]
        return found[0].at[k].set(t), found[1].at[k].set(size)

    empty = jnp.zeros(index.shape, fine.dtype)
    return jax.lax.fori_loop(0, jnp.minimum(count, index.size), one, (empty, empty))
