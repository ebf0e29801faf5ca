"""The augmented Lagrangian of a program (Nocedal & Wright, Numerical Optimization, section 17.3)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .problem import Evaluation
from .program import AbstractProgram

# An equality is to hold so many times more exactly, because what is left of it at a joint grows along the run.
STRICTER = 1e3


class Multipliers(NamedTuple):
    """λ for each place, ≥ 0 for an inequality, the penalty ρ, and by how much each is to be overfulfilled."""

    value: Float[Array | np.ndarray, "*batch places"]
    penalty: Float[Array | np.ndarray, "*batch"]
    margin: Float[Array | np.ndarray, "*batch places"]


def augmented_lagrangian(program: AbstractProgram, at: Evaluation, multipliers: Multipliers) -> Float[Array, ""]:
    """f + Σ w (p² − λ²) / 2ρ, where p is the next λ and w the share of a place in its constraint."""
    objective = jnp.sum(jnp.asarray(program.weights, dtype=at.terms.dtype) * at.terms)
    pushed = pushed_by(program, at, multipliers)
    shares = jnp.asarray(program.places.shares, dtype=at.terms.dtype)
    return objective + jnp.sum(shares * (pushed**2 - multipliers.value**2)) / (2 * multipliers.penalty)


def pushed_by(program: AbstractProgram, at: Evaluation, multipliers: Multipliers) -> Float[Array, " places"]:
    """λ + ρ c of an equality c = 0, and max(0, λ + ρ c) of an inequality c ≤ 0: the next λ; c = violation + margin."""
    pushed = multipliers.value + multipliers.penalty * (at.violations + multipliers.margin)
    return jnp.where(jnp.asarray(program.equal), pushed, jnp.maximum(0.0, pushed))


def violated_by(program: AbstractProgram, at: Evaluation, multipliers: Multipliers) -> Float[Array, " places"]:
    """By how much c is violated, margins included: c of an inequality, and a thousand times |c| of an equality."""
    violations = at.violations + multipliers.margin
    return jnp.where(jnp.asarray(program.equal), STRICTER * jnp.abs(violations), violations)
