"""What a search sees of a program at each of its starts."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from .lagrangian import Multipliers, augmented_lagrangian, pushed_by, violated_by
from .problem import Evaluation
from .program import AbstractProgram


class Looked(NamedTuple):
    """The augmented Lagrangian of each start with its derivatives, what it is made of, and the next multipliers.

    - ``violated``: by how much each place is violated, margins included.
    - ``hessian``: that of Gauss and Newton, where it was asked for.
    """

    value: Float[np.ndarray, " starts"]
    gradient: Float[np.ndarray, "starts n"]
    at: Evaluation
    pushed: Float[np.ndarray, "starts places"]
    violated: Float[np.ndarray, "starts places"]
    hessian: Float[np.ndarray, "starts n n"] | None = None

    @property
    def violation(self) -> Float[np.ndarray, " starts"]:
        """The largest violation of each start; −∞ where there are no constraints."""
        return np.max(self.violated, axis=1, initial=-np.inf)

    @property
    def worst(self) -> Int[np.ndarray, " starts"]:
        """The place where it is; −1 where there are no constraints."""
        starts, places = self.violated.shape
        return np.argmax(self.violated, axis=1) if places else np.full(starts, -1)


@functools.lru_cache(maxsize=8)
def looked_at(program: AbstractProgram) -> Callable[..., Any]:
    """What :class:`Looked` holds of each start, by reverse mode, compiled once for a program."""

    def lagrangian(z: Float[Array, " n"], multipliers: Multipliers):
        at = program.evaluate(z)
        return augmented_lagrangian(program, at, multipliers), at

    def one(z: Float[Array, " n"], multipliers: Multipliers):
        (value, at), gradient = jax.value_and_grad(lagrangian, has_aux=True)(z, multipliers)
        pushed, violated = pushed_by(program, at, multipliers), violated_by(program, at, multipliers)
        return value, gradient, at, pushed, violated

    return jax.jit(jax.vmap(one))
