"""Observers of each step of a lane, so that only results are kept of a run."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..solvers.dense.sampling import lobatto_weights, sampling
from .runge_kutta import Between, Step

# From what is given of each lane, times and state vectors to k quantities.
Quantities = Callable[
    [Float[Array, "numbers lanes"], Float[Array, " lanes"], Float[Array, "size lanes"]], Float[Array, "k lanes"]
]


class AbstractObserver(abc.ABC):
    """Observes every step. Its state is a PyTree of arrays whose last axis is that of the lanes."""

    @abc.abstractmethod
    def begin(self, given: Any) -> Any:
        """Its state at the start of a run. ``given`` are its parameters in each lane."""

    def asks(self, seen: Any, given: Any, start: Float[Array, " lanes"], end: Float[Array, " lanes"]) -> Any:
        """The lanes in which it needs states within a step as exact as those at its ends, or whether any does."""
        return False

    @abc.abstractmethod
    def observe(self, seen: Any, given: Any, step: Step, kept: Bool[Array, " lanes"]) -> Any:
        """Its state after a step in the lanes where that was accepted; unchanged in the others."""


class Saved(NamedTuple):
    """How many of its times each lane has ``passed``, and the states there; NaN at the rest."""

    passed: Int[Array, " lanes"]
    states: Float[Array, "times size lanes"]


@dataclasses.dataclass(frozen=True, eq=False)
class Saves(AbstractObserver):
    """Saves the states at given times, in the order of time."""

    exact: Between
    size: int

    def begin(self, given: Float[Array, "times lanes"]) -> Saved:
        times, lanes = given.shape
        return Saved(jnp.zeros(lanes, jnp.int32), jnp.full((times, self.size, lanes), jnp.nan, given.dtype))

    def asks(self, seen: Saved, given: Float[Array, "times lanes"], start: Any, end: Any) -> Bool[Array, " lanes"]:
        return _following(seen.passed, given) < end

    def observe(
        self, seen: Saved, given: Float[Array, "times lanes"], step: Step, kept: Bool[Array, " lanes"]
    ) -> Saved:
        last, lane = given.shape[0], jnp.arange(given.shape[1])

        def within(count: Int[Array, " lanes"]) -> Bool[Array, " lanes"]:
            return kept & (_following(count, given) <= step.end)

        def save(seen: Saved) -> Saved:
            here = within(seen.passed)
            place = jnp.where(here, seen.passed, last)
            x = self.exact(step, jnp.where(here, _following(seen.passed, given), step.start))
            states = seen.states.at[place, :, lane].set(x.T, mode="drop")
            return Saved(seen.passed + here.astype(jnp.int32), states)

        return jax.lax.while_loop(lambda seen: jnp.any(within(seen.passed)), save, seen)


@dataclasses.dataclass(frozen=True, eq=False)
class Integrals(AbstractObserver):
    """Adds up quantities over time, by the rule of Gauss and Lobatto with five nodes in each step."""

    quantities: Quantities
    exact: Between
    count: int

    def begin(self, given: Float[Array, "numbers lanes"]) -> Float[Array, "k lanes"]:
        return jnp.zeros((self.count, given.shape[1]), given.dtype)

    def asks(self, seen: Any, given: Any, start: Any, end: Any) -> bool:
        return True

    def observe(
        self,
        seen: Float[Array, "k lanes"],
        given: Float[Array, "numbers lanes"],
        step: Step,
        kept: Bool[Array, " lanes"],
    ) -> Float[Array, "k lanes"]:
        nodes, weights = (jnp.asarray(x, step.x.dtype) for x in (sampling().nodes, lobatto_weights()))

        def one(i, total):
            t = step.start + nodes[i] * (step.end - step.start)
            return total + weights[i] * self.quantities(given, t, self.exact(step, t))

        total = jax.lax.fori_loop(0, nodes.size, one, jnp.zeros_like(seen))
        return jnp.where(kept[None], seen + (step.end - step.start)[None] * total, seen)


def _following(count: Int[Array, " lanes"], times: Float[Array, "times lanes"]) -> Float[Array, " lanes"]:
    """The time of each lane that follows ``count`` others; infinite if there is none."""
    last, lane = times.shape[0], jnp.arange(times.shape[1])
    return jnp.where(count < last, times[jnp.minimum(count, last - 1), lane], jnp.inf)
