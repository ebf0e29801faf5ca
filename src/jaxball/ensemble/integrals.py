"""The integrals of quantities over runs."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..solvers.dense.sampling import sampling
from .extremes import Quantities
from .interpolation import Between
from .observers import AbstractObserver
from .runge_kutta import Step


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
