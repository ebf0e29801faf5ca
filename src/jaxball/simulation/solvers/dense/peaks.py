"""Finds the pieces of steps in which functions of time are largest, while a run is computed.

Of each piece a function is known at five points. A piece settles a function if the Legendre series through these values
tells how large it is at most: the function grows or falls throughout, or the last terms are next to nothing; or if all
terms are too small for a value larger than those known from other pieces. A piece that does not settle all functions is
halved: where the state rests, a step may be as long as the run, and a function may swing many times within it.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import legendre

from ....numerics.pieces import SLOPE_TAIL, Cut, longest_share
from .steps import sampling

TAIL = 16.0  # the weight of the last two terms in a bound: those of random values are as large as the first
GROWTH = 2.0  # the longest piece, relative to the one before it in the step
SMALLEST_PEAK = 2.0**-12  # the width of a piece that is not cut any more

Functions = Callable[[Float[Array, " n"]], Float[Array, "n k"]]


class Peaks(NamedTuple):
    """For each of k functions the largest values in two pieces of steps, the better first, and these pieces.

    Two, because a maximum may lie at the end of a piece, and the next one be better than the values tell. Each piece is
    from ``low`` to ``high``, in fractions of the step from ``start``, where the vector was ``x``, to ``end``.
    ``least`` are the smallest values at the points evaluated, from which constant functions are recognised.
    """

    value: Float[Array, "2 k"]
    start: Float[Array, "2 k"]
    end: Float[Array, "2 k"]
    x: Float[Array, "2 k size"]
    low: Float[Array, "2 k"]
    high: Float[Array, "2 k"]
    least: Float[Array, " k"]

    @classmethod
    def none(cls, count: int, x: Float[Array, " size"]) -> "Peaks":
        """Returns the peaks before the first step."""
        number = jnp.zeros((2, count), x.dtype)
        vectors = jnp.zeros((*number.shape, x.size), x.dtype)
        least = jnp.full_like(number[0], jnp.inf)
        return cls(jnp.full_like(number, -jnp.inf), number, number, vectors, number, number, least)


class _Search(NamedTuple):
    """The piece of a step that is looked at next, and the best pieces so far.

    ``origin``: 0 or 1 for what was the first or the second before the step, and 2 for pieces of the step.
    """

    cut: Cut
    value: Float[Array, "2 k"]
    low: Float[Array, "2 k"]
    high: Float[Array, "2 k"]
    origin: Int[Array, "2 k"]
    least: Float[Array, " k"]

    def note(self, most: Float[Array, " k"], least: Float[Array, " k"]) -> "_Search":
        """Returns the search after a piece in which the functions are at most and at least so large."""
        # A function that is not a number somewhere has no largest value, and the result says so.
        first, second = (most > self.value[0]) | jnp.isnan(most), most > self.value[1]

        def place(old: Array, new: Array) -> Array:
            # What was best before is now the second.
            return jnp.stack([jnp.where(first, new, old[0]), jnp.where(first, old[0], jnp.where(second, new, old[1]))])

        return self._replace(
            value=place(self.value, most),
            low=place(self.low, self.cut.start),
            high=place(self.high, self.cut.end),
            origin=place(self.origin, jnp.full_like(self.origin[0], 2)),
            least=jnp.minimum(self.least, least),
        )


def search(
    functions: Functions,
    peaks: Peaks,
    step: tuple[Float[Array, ""], Float[Array, ""], Float[Array, " size"]],
    run: Float[Array, ""],
    negligible: Float[Array, ""],
    kept: Bool[Array, ""],
) -> Peaks:
    """Returns the peaks after a step, if that was ``kept``.

    - ``functions``: of fractions of the step, without derivatives.
    - ``step``: its start, its end, and the vector at the start; ``run``: the length of the whole run.
    - ``negligible``: relative to the values, what they vary by less is no peak that could be seen.
    """
    start, end, x = step
    dtype, nodes = x.dtype, jnp.asarray(sampling().nodes, x.dtype)
    longest = longest_share(*jax.lax.stop_gradient((end - start, run)))

    def look(state: _Search) -> _Search:
        cut = state.cut
        samples = functions(cut.start + nodes * cut.width)
        passes = jnp.all(is_settled(samples, state.value[1], negligible)) | (cut.width <= SMALLEST_PEAK) | cut.is_last

        def go_on(state: _Search) -> _Search:
            return state.note(_find_largest(samples), jnp.min(samples, axis=0))._replace(
                cut=cut.go_on(jnp.minimum(GROWTH * cut.width, longest), 1.0)
            )

        return jax.lax.cond(passes, go_on, lambda state: state._replace(cut=cut.shorten()), state)

    value, low, high, least = jax.lax.stop_gradient((peaks.value, peaks.low, peaks.high, peaks.least))
    first = Cut.first(jnp.where(kept, 0.0, 1.0).astype(dtype), longest.astype(dtype), 1.0)
    origin = jnp.broadcast_to(jnp.arange(2)[:, None], value.shape)
    last = jax.lax.while_loop(lambda state: state.cut.start < 1, look, _Search(first, value, low, high, origin, least))

    def choose(new: Array, old: Array) -> Array:
        origin = last.origin.reshape(*last.origin.shape, *(1,) * (old.ndim - 2))
        return jnp.where(origin == 2, new, jnp.where(origin == 0, old[0], old[1]))

    places = choose(start, peaks.start), choose(end, peaks.end), choose(x, peaks.x), last.low, last.high
    return Peaks(last.value, *places, last.least)


@cache
def _series() -> np.ndarray:
    nodes = sampling().nodes
    return np.linalg.inv(legendre.legvander(2 * nodes - 1, nodes.size - 1))


def is_settled(
    samples: Float[Array, "nodes k"], known: Float[Array, " k"], negligible: Float[Array, ""]
) -> Bool[Array, " k"]:
    """Returns of which functions it is certain how large they are at most in a piece, in view of ``known`` values.

    - ``negligible``: relative to the values, what they vary by less is no peak.
    """
    terms = jnp.sum(jnp.asarray(_series(), samples.dtype)[..., None] * samples[None], axis=1)
    sizes = jnp.abs(terms)
    before, last = sizes[1] + sizes[2], sizes[3] + sizes[4]
    is_lower = terms[0] + before + TAIL * last <= known
    # The slope of the second Legendre polynomial is at most 3. Where a function is monotone it is largest at an end.
    is_monotone = sizes[1] > 3 * sizes[2] + SLOPE_TAIL * last
    is_known = last <= negligible * jnp.max(jnp.abs(samples), axis=0)
    return is_lower | is_monotone | is_known | ~jnp.all(jnp.isfinite(samples), axis=0)


def _find_largest(samples: Float[Array, "nodes k"]) -> Float[Array, " k"]:
    """Returns how large each function is at most in a piece."""
    grid, curves = sampling(), samples.T
    finite = jnp.all(jnp.isfinite(curves), axis=1)
    fine = grid.polynomials(curves)
    size = jnp.max(fine, axis=1)
    # The first of the largest, without argmax, at which XLA's CPU compiler fails in a loop.
    fractions = jnp.asarray(grid.fractions, samples.dtype)
    place = jnp.min(jnp.where(fine == size[:, None], fractions, 1.0), axis=1)
    slope, bend = grid.rates(curves, place)
    peak = jnp.where((place > 0) & (place < 1) & (bend < 0), -0.5 * slope**2 / jnp.where(bend < 0, bend, 1.0), 0.0)
    return jnp.maximum(jnp.max(samples, axis=0), jnp.where(finite, size + peak, -jnp.inf))
