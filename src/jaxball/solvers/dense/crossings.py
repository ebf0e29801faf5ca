"""All times within the steps of a solve at which a function of the state crosses zero."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import selected
from ...numerics.bracketing import Sample, between, other_end
from ...numerics.calculus import with_derivatives
from ...numerics.differentiation import differentiated_where, without_derivatives
from .steps import Field, Steps, Values, sampling

ITERATIONS = 20
# How many steps are examined side by side.
WIDTH = 8


class Kind(NamedTuple):
    """Which crossings of a function to find: upwards (1), downwards (−1) or both (0), and how many to keep.

    With ``from_start``, a solve that starts beyond zero has crossed it at its start.
    """

    direction: int
    from_start: bool
    room: int


class Crossings(eqx.Module):
    """Where a function crossed zero.

    - ``count``: how often. ``times`` and ``vectors`` hold the first of them, as many as there is room for; NaN where
      there are fewer.
    - ``least``, ``largest``: the extreme values of the function where it was evaluated, without derivatives.
    """

    count: Int[Array, ""]
    times: Float[Array, " room"]
    vectors: Float[Array, "room size"]
    least: Float[Array, ""]
    largest: Float[Array, ""]


class _Candidates(NamedTuple):
    """Candidate crossings: which function, in which step, before which fraction of it, and whether there is one."""

    which: Int[Array, " n"]
    step: Int[Array, " n"]
    place: Int[Array, " n"]
    there: Bool[Array, " n"]


def crossings(steps: Steps, values: Values, field: Field, kinds: Sequence[Kind]) -> list[Crossings]:
    """Finds where each of k functions ``values(t, x)`` becomes positive, or stops being so.

    The functions are evaluated at five points of each step, and the quartic through these values at 35. Wherever its
    sign changes, the function itself is solved for its zero on the dense output. So two crossings within a step are
    both found if they are further apart than about a thirtieth of it. A jump across zero, at a kink, counts as a
    crossing at the time of the jump.

    The start is not a crossing, even if a function starts from zero, unless its kind says so. Times and vectors
    are differentiable, by the implicit function theorem, with ẋ by ``field``.
    """
    values = eqx.filter_closure_convert(values, *steps.like)
    search = _search(*without_derivatives((steps, values)), kinds)
    samples, changes, candidates = search.samples, search.changes, search.candidates
    valid = jnp.isfinite(samples) & without_derivatives(steps).taken[None, :, None]
    at_start = candidates.place == 0
    times = jnp.where(at_start, steps.start[candidates.step], search.zeros.x)
    scales = jnp.max(jnp.where(valid, jnp.abs(samples), 0.0), axis=(1, 2))
    real = candidates.there & (at_start | (jnp.abs(search.zeros.f) <= 1e-6 * scales[candidates.which]))
    times, vectors = jax.lax.stop_gradient((times, steps.states(candidates.step, times[:, None])[:, 0]))
    times, vectors = with_derivatives((times, vectors), _all_moved, steps, values, field, candidates, times, real)
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


class _Search(NamedTuple):
    """The functions at the nodes of all steps, where their signs change, and brackets of zeros, newest ends first."""

    samples: Float[Array, "k steps nodes"]
    changes: Bool[Array, "k steps fractions"]
    candidates: _Candidates
    zeros: Sample
    others: Sample
    open: Bool[Array, " n"]


def _search(steps: Steps, values: Values, kinds: Sequence[Kind]) -> _Search:
    """Examines all steps and then finds the zeros of the functions, without derivatives.

    All evaluations are in one loop, because XLA takes as long again to compile each copy of a long formula.
    """
    at, k, n, room = sampling(), len(kinds), steps.start.size, sum(kind.room for kind in kinds)
    width = max(WIDTH, -(-room // at.nodes.size))
    points, rounds = width * at.nodes.size, -(-steps.count // width)
    every = at.times(steps.start, steps.end, at.nodes).reshape(-1)

    def look(r: Array, search: _Search) -> _Search:
        looking, last = r < rounds, jnp.maximum(steps.count * at.nodes.size - 1, 0)
        place = jnp.minimum(r * points + jnp.arange(points), last)
        next_times = between(search.others, search.zeros)
        step = jnp.where(looking, place // at.nodes.size, _filled(search.candidates.step, points))
        times = jnp.where(looking, every[place], _filled(next_times, points))
        x = steps.states(step, times[:, None])[:, 0]
        # In a branch, because XLA would recompute it for each of its uses.
        found = jax.lax.cond(r >= 0, jax.vmap(values), lambda t, x: jnp.zeros((points, k), t.dtype), times, x)
        search = _nearer(search, Sample(next_times, found[jnp.arange(room), search.candidates.which]))
        kept = jnp.where(looking, place, n * at.nodes.size)
        samples = search.samples.reshape(k, -1).at[:, kept].set(found.T, mode="drop").reshape(k, n, -1)
        search = search._replace(samples=samples)
        return jax.lax.cond(r == rounds - 1, lambda search: _bracketed(steps, search, kinds), lambda s: s, search)

    def goes_on(carry: tuple[Array, _Search]) -> Array:
        r, search = carry
        return (r < rounds) | (r < rounds + ITERATIONS) & jnp.any(search.open)

    zero, none = jnp.zeros(room, steps.start.dtype), jnp.zeros(room, bool)
    which = jnp.asarray(np.repeat(np.arange(k), [kind.room for kind in kinds]))
    begin = _Search(
        samples=jnp.zeros((k, n, at.nodes.size), zero.dtype),
        changes=jnp.zeros((k, n, at.fractions.size), bool),
        candidates=_Candidates(which, jnp.zeros_like(which), jnp.zeros_like(which), none),
        zeros=Sample(zero, zero),
        others=Sample(zero, zero),
        open=none,
    )
    return jax.lax.while_loop(goes_on, lambda carry: (carry[0] + 1, look(*carry)), (jnp.asarray(0), begin))[1]


def _nearer(search: _Search, newest: Sample) -> _Search:
    """The brackets that are open with a new end each, closed where it is the old one to rounding."""
    near = 2 * jnp.finfo(newest.x.dtype).eps * jnp.maximum(jnp.abs(newest.x), 1.0)
    goes_on = search.open & (jnp.abs(newest.x - search.zeros.x) > near)
    ends = newest, other_end(search.others, search.zeros, newest), goes_on
    old = search.zeros, search.others, search.open
    zeros, others, goes_on = selected(search.open, ends, old)
    return search._replace(zeros=zeros, others=others, open=goes_on)


def _filled(part: Array, size: int) -> Array:
    """The padding has no effect."""
    return jnp.concatenate([part, jnp.repeat(part[:1], size - part.size)])


def _bracketed(steps: Steps, search: _Search, kinds: Sequence[Kind]) -> _Search:
    """The fractions where the quartics through the samples change sign, and brackets one fraction wider around."""
    samples, which = search.samples, search.candidates.which
    valid = steps.taken[None, :, None] & jnp.isfinite(samples)
    scales = jnp.max(jnp.where(valid, jnp.abs(samples), 0.0), axis=(1, 2))
    fine = sampling().polynomials(samples)
    changes = _changes(fine, scales, kinds) & steps.taken[None, :, None]
    flat, columns = changes.reshape(len(kinds), -1), changes.shape[2]
    # The n-th change is the first index up to which there are n of them.
    counts, order = jnp.cumsum(flat, axis=1), np.concatenate([np.arange(kind.room) for kind in kinds])
    found = jnp.sum(counts[which] <= order[:, None], axis=1)
    there = found < flat.shape[1]
    found = jnp.where(there, found, 0)
    i, j = found // columns, found % columns
    fractions = jnp.asarray(sampling().fractions, fine.dtype)
    left, right = jnp.maximum(j - 2, 0), jnp.minimum(j + 1, columns - 1)
    old, new = (
        Sample(steps.start[i] + (steps.end[i] - steps.start[i]) * fractions[at], fine[which, i, at])
        for at in (left, right)
    )
    return _Search(samples, changes, _Candidates(which, i, j, there), new, old, there & (j > 0))


def _parts(kinds: Sequence[Kind]) -> list[slice]:
    """The indices of the candidates of each function."""
    ends = np.cumsum([kind.room for kind in kinds])
    return [slice(int(end) - kind.room, int(end)) for end, kind in zip(ends, kinds, strict=True)]


def _all_moved(steps: Steps, values: Values, field: Field, candidates: _Candidates, times: Array, real: Array) -> tuple:
    return jax.lax.map(lambda at: _moved(steps, values, field, *at), (*candidates[:3], times, real))


def _moved(steps: Steps, values: Values, field: Field, which, i, j, t, real) -> tuple[Array, Array]:
    """A time and the vector there, moved to the zero by a Newton step, which has the derivatives of the zero."""
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
    fine: Float[Array, "k steps fractions"], scales: Float[Array, " k"], kinds: Sequence[Kind]
) -> Bool[Array, "k steps fractions"]:
    """Where the sign changes in the right direction from the point before, including the end of the last step."""
    flat = fine.reshape(len(kinds), -1)
    # A start from zero, to rounding, has the sign that follows it.
    from_zero = jnp.abs(flat[:, 0]) <= 16 * jnp.finfo(flat.dtype).eps * scales
    start = jnp.where(from_zero, flat[:, 1], flat[:, 0])
    flat = flat.at[:, 0].set(start)
    directions = np.array([kind.direction for kind in kinds])
    from_start = np.array([kind.from_start for kind in kinds])
    first = jnp.where(from_start, -directions.astype(start.dtype), start)
    before = jnp.concatenate([first[:, None], flat[:, :-1]], axis=1) > 0
    after = flat > 0
    rises, falls = jnp.asarray(directions >= 0)[:, None], jnp.asarray(directions <= 0)[:, None]
    return (rises & ~before & after | falls & before & ~after).reshape(fine.shape)
