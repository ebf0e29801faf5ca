"""What is looked at in each step of a lane, so that no more than results is kept of a run."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..solvers.dense.sampling import sampling
from .runge_kutta import Between, Step

# From what is given of each lane, times and state vectors to k quantities.
Quantities = Callable[
    [Float[Array, "numbers lanes"], Float[Array, " lanes"], Float[Array, "size lanes"]], Float[Array, "k lanes"]
]


class AbstractObserver(abc.ABC):
    """Sees every step. What it has seen is a PyTree of arrays whose last axis is that of the lanes."""

    @abc.abstractmethod
    def begin(self, given: Any) -> Any:
        """What it has seen at the start of a run. ``given`` are the numbers of each lane that it looks with."""

    @abc.abstractmethod
    def observe(self, seen: Any, given: Any, step: Step, kept: Bool[Array, " lanes"]) -> Any:
        """What it has seen after a step in the lanes where that was kept; as before in the others."""


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
            place = jnp.where(here, seen.passed, last)
            x = self.between(step, following(seen.passed))
            states = seen.states.at[place, :, lane].set(x.T, mode="drop")
            return Saved(seen.passed + here.astype(jnp.int32), states)

        return jax.lax.while_loop(lambda seen: jnp.any(within(seen.passed)), save, seen)


@dataclasses.dataclass(frozen=True, eq=False)
class Integrals(AbstractObserver):
    """Adds up quantities over time, by the rule of Gauss and Lobatto with five nodes in each step."""

    quantities: Quantities
    between: Between
    count: int

    def begin(self, given: Float[Array, "numbers lanes"]) -> Float[Array, "k lanes"]:
        return jnp.zeros((self.count, given.shape[1]), given.dtype)

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
            return total + weights[i] * self.quantities(given, t, self.between(step, t))

        total = jax.lax.fori_loop(0, nodes.size, one, jnp.zeros_like(seen))
        return jnp.where(kept[None], seen + (step.end - step.start)[None] * total, seen)


def lobatto_weights() -> np.ndarray:
    """The weights that integrate every polynomial of degree 4 exactly, and by symmetry of degree 7."""
    nodes = sampling().nodes
    powers = np.arange(nodes.size)
    return np.linalg.solve(nodes[None, :] ** powers[:, None], 1 / (powers + 1))
