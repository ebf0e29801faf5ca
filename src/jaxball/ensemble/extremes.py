"""The largest values of quantities within the steps of runs."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
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
ROUNDS = 3
# Of a window, what the next one is to either side of the place found in it: some times what a quartic errs by.
NARROWER = 1 / 12


class Best(NamedTuple):
    """For each quantity its largest value so far, and the step in which it lies."""

    value: Float[Array, "k lanes"]
    start: Float[Array, "k lanes"]
    end: Float[Array, "k lanes"]
    x: Float[Array, "k size lanes"]
    y: Float[Array, "k size lanes"]
    slopes: Float[Array, "k stages size lanes"]

    def step(self, k: int) -> Step:
        """The step of a quantity."""
        return Step(self.start[k], self.end[k], self.x[k], self.slopes[k], self.y[k], self.y[k])


class Extremes(AbstractObserver):
    """Finds the step in which each of ``k`` quantities is largest, by five values in each; :meth:`refined` finds the place.

    ``signs`` are by what the quantities are multiplied, and ``which`` of them is looked at with each.
    """

    quantities: Quantities = eqx.field(static=True)
    between: Between = eqx.field(static=True)
    which: tuple[int, ...] = eqx.field(static=True)
    signs: tuple[float, ...] = eqx.field(static=True)
    size: int = eqx.field(static=True)
    stages: int = eqx.field(static=True)

    def begin(self, given: Float[Array, "numbers lanes"]) -> Best:
        k, lanes = len(self.which), given.shape[1]
        state = jnp.zeros((k, self.size, lanes), given.dtype)
        number = jnp.zeros((k, lanes), given.dtype)
        slopes = jnp.zeros((k, self.stages, self.size, lanes), given.dtype)
        return Best(jnp.full_like(number, -jnp.inf), number, number, state, state, slopes)

    def observe(
        self, seen: Best, given: Float[Array, "numbers lanes"], step: Step, kept: Bool[Array, " lanes"]
    ) -> Best:
        step = jax.lax.stop_gradient(step)
        most = _largest(self._samples(jax.lax.stop_gradient(given), step))
        better = kept[None] & (most > seen.value)
        found = Best(most, *(jnp.broadcast_to(item[None], old.shape) for item, old in zip(
            (step.start, step.end, step.x, step.y, step.slopes), seen[1:], strict=True
        )))
        return jax.tree.map(lambda old, new: jnp.where(_spread(better, new.ndim), new, old), seen, found)

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
        self, seen: Best, given: Float[Array, "numbers rows"]
    ) -> tuple[Float[Array, "k rows"], Float[Array, "k rows"]]:
        """The largest values, and when they occur; NaN where there was no step or a quantity was never a number.

        Values have derivatives and times do not: a maximum does not change to first order as its place does.
        """
        still, fixed = jax.lax.stop_gradient((seen, given))

        # Loops, because the quantities are a long program that is to be compiled few times.
        def search(k, times):
            step = still.step(k)
            ends = step.start, _inside(step, jnp.ones((), step.end.dtype))

            def values(t: Float[Array, " rows"]) -> Float[Array, " rows"]:
                return self._at(fixed, t, self.between(step, t))[k]

            return times.at[k].set(_place_of_largest(values, *ends))

        def evaluate(k, values):
            step = seen.step(k)
            return values.at[k].set(self._at(given, times[k], self.between(step, times[k]))[k])

        count = len(self.which)
        times = jax.lax.fori_loop(0, count, search, jnp.zeros_like(still.value))
        values = jax.lax.fori_loop(0, count, evaluate, jnp.zeros_like(seen.value))
        found = still.value > -jnp.inf
        return jnp.where(found, values, jnp.nan), jnp.where(found, times, jnp.nan)


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


def _spread(holds: Bool[Array, "k lanes"], ndim: int) -> Array:
    return holds.reshape(holds.shape[0], *(1 for _ in range(ndim - 2)), holds.shape[1])
