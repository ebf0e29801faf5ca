"""The states at given times."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .interpolation import Between
from .observers import AbstractObserver
from .runge_kutta import Step


class Saved(NamedTuple):
    """How many of its times each lane has passed, and the states there; NaN at the others."""

    count: Int[Array, " lanes"]
    states: Float[Array, "times size lanes"]


class Saves(AbstractObserver):
    """Keeps the states at the times that it is given, in the order of time."""

    between: Between = eqx.field(static=True)
    size: int = eqx.field(static=True)

    def begin(self, given: Float[Array, "times lanes"]) -> Saved:
        times, lanes = given.shape
        return Saved(jnp.zeros(lanes, jnp.int32), jnp.full((times, self.size, lanes), jnp.nan, given.dtype))

    def observe(
        self, seen: Saved, given: Float[Array, "times lanes"], step: Step, kept: Bool[Array, " lanes"]
    ) -> Saved:
        last, lane = given.shape[0], jnp.arange(given.shape[1])

        def following(count: Int[Array, " lanes"]) -> Float[Array, " lanes"]:
            return given[jnp.minimum(count, last - 1), lane]

        def within(count: Int[Array, " lanes"]) -> Bool[Array, " lanes"]:
            return kept & (count < last) & (following(count) <= step.end)

        def save(seen: Saved) -> Saved:
            here = within(seen.count)
            found = self.between(step, following(seen.count))
            place = jnp.where(here, seen.count, last)
            states = seen.states.at[place, :, lane].set(found.T, mode="drop")
            return Saved(seen.count + here, states)

        return jax.lax.while_loop(lambda seen: jnp.any(within(seen.count)), save, seen)
