"""Conditions that parameters and initial states must meet, as values that can be traced."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

UNIT = 1e-6  # how far the square of a unit vector may be from 1


class Condition(NamedTuple):
    """A condition on a parameter: whether it holds, which parameter, what it is and what it must be."""

    holds: Bool[Array, ""]
    name: str
    value: Array
    must: str


def positive(x: Array) -> Bool[Array, ""]:
    """Whether every entry is positive and finite."""
    return jnp.all((x > 0) & jnp.isfinite(x))


def positive_inertia(d: Float[Array, "..."]) -> Condition:
    """The condition on a moment of inertia, or on three, to be positive."""
    return Condition(positive(d), "inertia", d, "positive")


def real_inertia(d: Float[Array, "3"]) -> Condition:
    """The condition on three principal moments that some distribution of mass has them."""
    return Condition(
        jnp.all(2 * d <= jnp.sum(d) * (1 + 1e-6)),
        "inertia",
        d,
        "three moments of which none exceeds the sum of the other two, as in every real body",
    )


def versor(q: Float[Array, "4"]) -> Condition:
    """The condition on the versor of an initial state."""
    return Condition(
        jnp.abs(jnp.sum(q**2) - 1) < UNIT, "state.q", q, "a versor, four numbers whose squares add up to 1"
    )
