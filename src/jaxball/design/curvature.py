"""The Gauss–Newton Hessian of the augmented Lagrangian: the run is taken to be linear in the numbers of a design.

What terms and constraints make of a run is taken as it is, with all second derivatives, and so are bounds. Of a sum of
squares of what the run is linear in, that is JᵀJ; no term needs to be written as one.
"""

import functools
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .lagrangian import Multipliers, augmented_lagrangian, pushed_by, violated_by
from .problem import Evaluation
from .program import AbstractProgram


@functools.lru_cache(maxsize=8)
def curved_at(program: AbstractProgram) -> Callable[..., Any]:
    """What :class:`~.looked.Looked` holds of each start, by forward mode, compiled once for a program."""

    def one(y: Float[Array, " n"], multipliers: Multipliers):
        x = program.numbers(y)

        def simulated(x: Float[Array, " numbers"]) -> tuple[Any, Any]:
            return eqx.partition(program.simulate(x, diffrax.ForwardMode()), eqx.is_inexact_array)

        def along(direction: Float[Array, " numbers"]) -> tuple[Any, Any, Any]:
            return jax.jvp(simulated, (x,), (direction,), has_aux=True)

        runs, slopes, rest = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(x.size, dtype=x.dtype))

        def lagrangian(y: Float[Array, " n"]) -> tuple[Float[Array, ""], Evaluation]:
            change = program.numbers(y) - x
            moved = jax.tree.map(lambda run, slope: run + jnp.tensordot(change, slope, 1), runs, slopes)
            at = program.assess(eqx.combine(moved, rest))
            return augmented_lagrangian(program, at, multipliers), at

        def gradient(y: Float[Array, " n"]) -> tuple[Any, Any]:
            (value, at), slope = jax.value_and_grad(lagrangian, has_aux=True)(y)
            return slope, (value, slope, at)

        hessian, (value, slope, at) = jax.jacfwd(gradient, has_aux=True)(y)
        pushed, violated = pushed_by(program, at, multipliers), violated_by(program, at, multipliers)
        return value, slope, at, pushed, violated, hessian

    return jax.jit(jax.vmap(one))
