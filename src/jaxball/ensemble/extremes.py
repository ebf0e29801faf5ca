"""The largest values of quantities within the steps of runs."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..sampling import sampling
from .interpolation import Between
from .observers import AbstractObserver
from .runge_kutta import Step

# From what is given of each lane, times and state vectors to k quantities.
Quantities = Callable[
    [Float[Array, "numbers lanes"], Float[Array, " lanes"], Float[Array, "size lanes"]], Float[Array, "k lanes"]
]
# From what the field is given of each lane, and a start, an end and a state, to the step.
Again = Callable[
    [Float[Array, "numbers lanes"], Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, "size lanes"]], Step
]
ROUNDS = 4
# Of a window, what the next one is to either side of the place found in it: some times what a quartic errs by.
NARROWER = 1 / 12


class Best(NamedTuple):
    """For each quantity the largest values in two steps, the better first, and where these begin, and when they end.

    Two, because where a maximum lies near the end of a step, five values may take the next one for better.
    """

    value: Float[Array, "2 k lanes"]
    start: Float[Array, "2 k lanes"]
    end: Float[Array, "2 k lanes"]
    x: Float[Array, "2 k size lanes"]


@dataclasses.dataclass(frozen=True, eq=False)
class Extremes(AbstractObserver):
    """Finds the steps in which each of k quantities is largest, by five values in each; ``refined`` finds the place.

    - ``which``, ``signs``: the quantity of each search, and what it is multiplied by.
    - ``again``: a step that was taken, computed anew: that takes less time than to keep its stages.
    """

    quantities: Quantities
    between: Between
    which: tuple[int, ...]
    signs: tuple[float, ...]
    again: Again
    size: int

    def begin(self, given: Float[Array, "numbers lanes"]) -> Best:
        k, lanes = len(self.which), given.shape[1]
        number = jnp.zeros((2, k, lanes), given.dtype)
        state = jnp.zeros((2, k, self.size, lanes), given.dtype)
        return Best(jnp.full_like(number, -jnp.inf), number, number, state)

    def observe(
        self, seen: Best, given: Float[Array, "numbers lanes"], step: Step, kept: Bool[Array, " lanes"]
    ) -> Best:
        most = _largest(self._samples(*jax.lax.stop_gradient((given, step))))
        best = kept[None] & (most > seen.value[0])
        second = kept[None] & (most > seen.value[1])

        def placed(old: Array, new: Array) -> Array:
            wide = (slice(None), *(None for _ in range(old.ndim - 3)))
            first = jnp.where(best[wide], new, old[0])
            return jnp.stack([first, jnp.where(best[wide], old[0], jnp.where(second[wide], new, old[1]))])

        return jax.tree.map(placed, seen, Best(most, step.start[None], step.end[None], step.x[None]))

    def _samples(self, given: Float[Array, "numbers lanes"], step: Step) -> Float[Array, "nodes k lanes"]:
        nodes = jnp.asarray(sampling().nodes, step.x.dtype)

        def one(i, samples):
            t = _inside(step, nodes[i])
            return jax.lax.dynamic_update_index_in_dim(samples, self._at(given, t, self.between(step, t)), i, 0)

        empty = jnp.zeros((nodes.size, len(self.which), step.start.shape[0]), step.x.dtype)
        return jax.lax.fori_loop(0, nodes.size, one, empty)

    def _at(self, given: Float[Array, "numbers lanes"], t: Float[Array, " lanes"], x: Float[Array, "size lanes"]):
        values = self.quantities(given, t, x)
        return jnp.stack([sign * values[k] for k, sign in zip(self.which, self.signs, strict=True)])

    def refined(
        self, seen: Best, given: Float[Array, "numbers rows"], of_field: Float[Array, "others rows"]
    ) -> tuple[Float[Array, "k rows"], Float[Array, "k rows"]]:
        """The largest values, and when they occur; NaN where there was no step or a quantity was never a number.

        ``of_field`` are the numbers of each row with which its step is computed anew.

        Values have derivatives and times do not: a maximum does not change to first order as its place does.
        """

        # A loop, because the quantities are a long program that is to be compiled few times.
        def search(i, found):
            values, times = found
            rank, k = i // len(self.which), i % len(self.which)
            step = self.again(of_field, seen.start[rank, k], seen.end[rank, k], seen.x[rank, k])
            still, fixed = jax.lax.stop_gradient((step, given))
            last = _inside(still, jnp.ones((), still.end.dtype))
            t = _place_of_largest(lambda t: self._at(fixed, t, self.between(still, t))[k], still.start, last)
            value = self._at(given, t, self.between(step, t))[k]
            return values.at[rank, k].set(value), times.at[rank, k].set(t)

        empty = jnp.zeros_like(seen.value)
        values, times = jax.lax.fori_loop(0, 2 * len(self.which), search, (empty, empty))
        values = jnp.where(seen.value > -jnp.inf, values, -jnp.inf)
        first = ~(values[1] > values[0])
        value, time = jnp.where(first, values[0], values[1]), jnp.where(first, times[0], times[1])
        found = value > -jnp.inf
        return jnp.where(found, value, jnp.nan), jnp.where(found, jax.lax.stop_gradient(time), jnp.nan)


def _place_of_largest(
    values: Callable[[Float[Array, " rows"]], Float[Array, " rows"]],
    first: Float[Array, " rows"],
    last: Float[Array, " rows"],
) -> Float[Array, " rows"]:
    """Where a function of time is largest, by quartics in narrower and narrower windows."""
    at = sampling()
    nodes, fractions = jnp.asarray(at.nodes, first.dtype), jnp.asarray(at.fractions, first.dtype)

    def narrower(i, carry):
        times, low, high = carry

        def sample(j, samples):
            return samples.at[j].set(values(low + nodes[j] * (high - low)))

        samples = jax.lax.fori_loop(0, nodes.size, sample, jnp.zeros((nodes.size, first.size), first.dtype))
        fine = jnp.sum(jnp.asarray(at.matrix, first.dtype)[:, :, None] * samples[None], axis=1)
        # The place of the largest, without the search for an index, which XLA's CPU compiler breaks off at in a loop.
        here = jnp.where(fine == jnp.max(fine, axis=0)[None], fractions[:, None], jnp.inf)
        found = low + (high - low) * jnp.min(here, axis=0)
        times = jnp.where(jnp.all(jnp.isfinite(samples), axis=0), found, times)
        half = (last - first) * NARROWER ** (i + 1)
        return times, jnp.maximum(times - half, first), jnp.minimum(times + half, last)

    return jax.lax.fori_loop(0, ROUNDS + 1, narrower, (first, first, last))[0]


def _inside(step: Step, fraction: Float[Array, ""]) -> Float[Array, " lanes"]:
    """A time in a step; a little before its end, so that a kink there is seen from before."""
    t = step.start + fraction * (step.end - step.start)
    latest = step.end - 4 * float(np.finfo(step.end.dtype).eps) * jnp.abs(step.end)
    return jnp.maximum(step.start, jnp.minimum(t, latest))


def _largest(samples: Float[Array, "nodes k lanes"]) -> Float[Array, "k lanes"]:
    """The largest value of the polynomial through samples; that of the samples where one of them is not finite."""
    matrix = jnp.asarray(sampling().matrix, samples.dtype)
    finite = jnp.all(jnp.isfinite(samples), axis=0)
    most = jnp.max(samples, axis=0)

    def one(i, most):
        value = sum(matrix[i, j] * samples[j] for j in range(samples.shape[0]))
        return jnp.where(finite, jnp.maximum(most, value), most)

    return jax.lax.fori_loop(0, matrix.shape[0], one, most)
