"""The times within the steps of a solve at which a function of the state crosses zero, all of them."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.bracketing import Sample, between, other_end
from ...numerics.masks import differentiated_where, without_derivatives
from .sampling import sampling
from .steps import Steps

ITERATIONS = 20

Values = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]


class Kind(NamedTuple):
    """Which crossings of a function are wanted: those upwards (1), downwards (−1) or both (0), and how many to keep.

    With ``from_start``, a solve that starts beyond zero has crossed it at its start.
    """

    direction: int
    from_start: bool
    room: int


class Crossings(eqx.Module):
    """Where a function crossed zero.

    - ``count``: how often. ``times`` and ``vectors`` hold the first of them, as many as there is room for; NaN where
      there are fewer.
    - ``least``, ``largest``: the extreme values of the function where it was looked at, without derivatives.
    """

    count: Int[Array, ""]
    times: Float[Array, " room"]
    vectors: Float[Array, "room size"]
    least: Float[Array, ""]
    largest: Float[Array, ""]


class _Candidates(NamedTuple):
    """Where crossings seem to be: which function, in which step, before which place of it, and whether at all."""

    which: Int[Array, " n"]
    step: Int[Array, " n"]
    place: Int[Array, " n"]
    there: Bool[Array, " n"]


def crossings(steps: Steps, values: Values, field: Field, kinds: Sequence[Kind]) -> list[Crossings]:
    """Finds where each of k functions ``values(t, x)`` becomes positive, or stops being so.

    Each step is looked at in five places, and the quartic through these values in 35. Wherever its sign changes,
    the function itself is solved for its zero on the dense output. So two crossings within a step are both found if
    they are further apart than a thirtieth of it or so. A jump across zero, at a kink, counts as a crossing at the
    time of the jump.

    The start is not a crossing, also where a function starts from zero, unless its kind says so. Times and vectors
    are differentiable, by the implicit function theorem, with ẋ by ``field``.
    """
    values = eqx.filter_closure_convert(values, steps.start[0], steps.state(jnp.asarray(0), steps.start[0]))
    fixed, fixed_values = without_derivatives((steps, values))
    samples = jnp.moveaxis(fixed.samples(fixed_values, (len(kinds),)), -1, 0)
    valid = fixed.taken[None, :, None] & jnp.isfinite(samples)
    scales = jnp.max(jnp.where(valid, jnp.abs(samples), 0.0), axis=(1, 2))
    fine = sampling().polynomials(samples)
    changes = [_changes(fine[k], scales[k], kind) & fixed.taken[:, None] for k, kind in enumerate(kinds)]
    candidates = _candidates(changes, kinds)
    times, sizes = _zeros(fixed_values, fixed, fine, candidates)
    at_start = candidates.place == 0
    times = jax.lax.stop_gradient(jnp.where(at_start, fixed.start[candidates.step], times))
    real = candidates.there & (at_start | (sizes <= 1e-6 * scales[candidates.which]))
    times, vectors = jax.lax.map(lambda at: _moved(steps, values, field, *at), (*candidates[:3], times, real))
    return [
        Crossings(
            count=jnp.sum(changes[k]) - jnp.sum(candidates.there[part] & ~real[part]),
            times=_first(times[part], real[part]),
            vectors=_first(vectors[part], real[part]),
            least=jnp.min(jnp.where(valid[k], samples[k], jnp.inf)),
            largest=jnp.max(jnp.where(valid[k], samples[k], -jnp.inf)),
        )
        for k, part in enumerate(_parts(kinds))
    ]


def _parts(kinds: Sequence[Kind]) -> list[slice]:
    """Where the candidates of each function are."""
    ends = np.cumsum([kind.room for kind in kinds])
    return [slice(int(end) - kind.room, int(end)) for end, kind in zip(ends, kinds, strict=True)]


def _candidates(changes: Sequence[Bool[Array, "steps fractions"]], kinds: Sequence[Kind]) -> _Candidates:
    columns = changes[0].shape[1]
    changed = [
        jnp.nonzero(change.reshape(-1), size=kind.room, fill_value=-1)[0]
        for change, kind in zip(changes, kinds, strict=True)
    ]
    which = np.repeat(np.arange(len(kinds)), [kind.room for kind in kinds])
    flat = jnp.concatenate(changed)
    return _Candidates(jnp.asarray(which), flat // columns, flat % columns, flat >= 0)


def _moved(steps: Steps, values: Values, field: Field, which, i, j, t, real) -> tuple[Array, Array]:
    """A time and the vector then, moved to the zero by a step of Newton's, which has the derivatives of the zero."""
    step, values = differentiated_where(real, (steps.step(i), values))
    x = step.evaluate(t)
    rate = jax.lax.stop_gradient(field(t, x))
    _, slopes = jax.jvp(values, jax.lax.stop_gradient((t, x)), (jnp.ones_like(t), rate))
    slope = jax.lax.stop_gradient(slopes[which])
    smooth = (j > 0) & (slope != 0)
    change = jnp.where(smooth, -values(t, x)[which] / jnp.where(smooth, slope, 1.0), 0.0)
    return t + change, x + rate * change


def _first(leaf: Float[Array, "room ..."], real: Bool[Array, " room"]) -> Float[Array, "room ..."]:
    """The real ones first, and NaN for the others."""
    order = jnp.argsort(~real, stable=True)
    return jnp.where(real[order].reshape(-1, *(1,) * (leaf.ndim - 1)), leaf[order], jnp.nan)


def _changes(
    fine: Float[Array, "steps fractions"], scale: Float[Array, ""], kind: Kind
) -> Bool[Array, "steps fractions"]:
    """Where the sign changes in the right direction from the place before, the end of the last step included."""
    flat = fine.reshape(-1)
    # A start from zero, to rounding, has the sign that comes after it.
    from_zero = jnp.abs(flat[0]) <= 16 * jnp.finfo(flat.dtype).eps * scale
    start = jnp.where(from_zero, flat[1], flat[0])
    flat = flat.at[0].set(start)
    first = jnp.full_like(start, -kind.direction) if kind.from_start else start
    before = jnp.concatenate([first[None], flat[:-1]]) > 0
    after = flat > 0
    rises, falls = ~before & after, before & ~after
    return {1: rises, -1: falls, 0: rises | falls}[kind.direction].reshape(fine.shape)


def _zeros(
    values: Values, steps: Steps, fine: Float[Array, "k steps fractions"], candidates: _Candidates
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The zeros of ``values`` near their candidates, where a quartic changes its sign, and the size of the value there.

    By the Illinois method, from the values of the quartic one place further to either side.
    """
    fractions = jnp.asarray(sampling().fractions, fine.dtype)

    def improve(k, bracket):
        old, new = bracket
        t = between(old, new)
        newest = Sample(t, values(t, steps.state(candidates.step[k], t))[candidates.which[k]])
        return other_end(old, new, newest), newest

    def solve(k):
        which, i, j = candidates.which[k], candidates.step[k], candidates.place[k]
        at = steps.start[i] + (steps.end[i] - steps.start[i]) * fractions
        left, right = jnp.maximum(j - 2, 0), jnp.minimum(j + 1, at.size - 1)
        bracket = Sample(at[left], fine[which, i, left]), Sample(at[right], fine[which, i, right])
        _, zero = jax.lax.fori_loop(0, ITERATIONS, lambda _, bracket: improve(k, bracket), bracket)
        return zero.x, jnp.abs(zero.f)

    def one(k, results):
        # Nowhere is the loop of iterations needed but where there is a candidate.
        t, size = jax.lax.cond(candidates.there[k], solve, lambda k: (results[0][k], results[1][k]), k)
        return results[0].at[k].set(t), results[1].at[k].set(size)

    empty = jnp.zeros(candidates.step.shape, fine.dtype)
    return jax.lax.fori_loop(0, candidates.step.size, one, (empty, empty))
