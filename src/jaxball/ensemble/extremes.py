"""The largest values of quantities within the steps of runs."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..solvers.dense.sampling import last_within, place_of_largest, sampling
from .observers import AbstractObserver, Quantities
from .runge_kutta import Between, Step

# From what the field is given of each lane, and a start, an end and a state, to the step.
Recompute = Callable[
    [Float[Array, "numbers lanes"], Float[Array, " lanes"], Float[Array, " lanes"], Float[Array, "size lanes"]], Step
]
ROUNDS = 5


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
    - ``between``: the states by which the steps are found; ``exact``: those by which the places are.
    - ``recompute``: a step that was taken, recomputed, which is faster than keeping its stages.
    """

    quantities: Quantities
    between: Between
    exact: Between
    which: tuple[int, ...]
    signs: tuple[float, ...]
    recompute: Recompute
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

        ``of_field`` are the numbers of each row with which its step is recomputed.

        Values have derivatives and times do not: a maximum does not change to first order as its place does.
        """

        # A loop, because the quantities are a long program that is to be compiled few times.
        def search(i, results):
            values, times = results
            rank, k = i // len(self.which), i % len(self.which)
            step = self.recompute(of_field, seen.start[rank, k], seen.end[rank, k], seen.x[rank, k])
            still, fixed = jax.lax.stop_gradient((step, given))
            first, last = still.start, last_within(still.start, still.end)
            at = lambda t: self._at(fixed, t, self.exact(still, t))[k]  # noqa: E731
            t = place_of_largest(at, first, last - first, first, last, ROUNDS)
            value = self._at(given, t, self.exact(step, t))[k]
            return values.at[rank, k].set(value), times.at[rank, k].set(t)

        empty = jnp.zeros_like(seen.value)
        values, times = jax.lax.fori_loop(0, 2 * len(self.which), search, (empty, empty))
        values = jnp.where(seen.value > -jnp.inf, values, -jnp.inf)
        first = ~(values[1] > values[0])
        value, time = jnp.where(first, values[0], values[1]), jnp.where(first, times[0], times[1])
        seen_one = value > -jnp.inf
        return jnp.where(seen_one, value, jnp.nan), jnp.where(seen_one, jax.lax.stop_gradient(time), jnp.nan)


def _inside(step: Step, fraction: Float[Array, ""]) -> Float[Array, " lanes"]:
    """A time in a step."""
    return jnp.minimum(step.start + fraction * (step.end - step.start), last_within(step.start, step.end))


def _largest(samples: Float[Array, "nodes k lanes"]) -> Float[Array, "k lanes"]:
    """The largest value of the polynomial through samples; that of the samples where one of them is not finite."""
    matrix = jnp.asarray(sampling().matrix, samples.dtype)
    finite = jnp.all(jnp.isfinite(samples), axis=0)
    most = jnp.max(samples, axis=0)

    def one(i, most):
        value = sum(matrix[i, j] * samples[j] for j in range(samples.shape[0]))
        return jnp.where(finite, jnp.maximum(most, value), most)

    return jax.lax.fori_loop(0, matrix.shape[0], one, most)
