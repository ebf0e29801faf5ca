"""The states at given times."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .interpolation import Between
from .observers import AbstractObserver
from .runge_kutta import Step


class Saved(NamedTuple):
    """How many of its times each lane has ``passed``, and the states there; NaN at the others."""

    passed: Int[Array, " lanes"]
    states: Float[Array, "times size lanes"]


@dataclasses.dataclass(frozen=True, eq=False)
class Saves(AbstractObserver):
    """Keeps the states at the times that it is given, in the order of time."""

    between: Between
    size: int

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
            here = within(seen.passed)
            found = self.between(step, following(seen.passed))
            place = jnp.where(here, seen.passed, last)
            states = seen.states.at[place, :, lane].set(found.T, mode="drop")
            return Saved(seen.passed + here.astype(jnp.int32), states)

        return jax.lax.while_loop(lambda seen: jnp.any(within(seen.passed)), save, seen)
