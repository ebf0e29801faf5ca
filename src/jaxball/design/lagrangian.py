"""The augmented Lagrangian of a problem (Nocedal & Wright, Numerical Optimization, section 17.3)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .problem import Evaluation, Problem


class Multipliers(NamedTuple):
    """λ ≥ 0 for each place, the penalty ρ, and by how much each constraint is to be overfulfilled."""

    value: Float[Array | np.ndarray, "*batch places"]
    penalty: Float[Array | np.ndarray, "*batch"]
    margin: Float[Array | np.ndarray, "*batch places"]


def augmented_lagrangian(problem: Problem, at: Evaluation, multipliers: Multipliers) -> Float[Array, ""]:
    """f + Σ w ( max(0, λ + ρ c)² − λ² ) / 2ρ, c = violation + margin, w the share of a place in its constraint."""
    objective = jnp.sum(jnp.asarray(problem.weights, dtype=at.terms.dtype) * at.terms)
    pushed = pushed_by(at, multipliers)
    shares = jnp.asarray(problem.shares, dtype=at.terms.dtype)
    return objective + jnp.sum(shares * (pushed**2 - multipliers.value**2)) / (2 * multipliers.penalty)


def pushed_by(at: Evaluation, multipliers: Multipliers) -> Float[Array, " places"]:
    """max(0, λ + ρ c): the next λ."""
    return jnp.maximum(0.0, multipliers.value + multipliers.penalty * (at.violations + multipliers.margin))
