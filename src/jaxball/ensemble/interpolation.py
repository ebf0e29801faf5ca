"""The states within a step, by the solver's own interpolation."""

from collections.abc import Callable

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .lanes import LaneProgram, elements_of
from .runge_kutta import Step, tableau_of

Between = Callable[[Step, Float[Array, " lanes"]], Float[Array, "size lanes"]]


def interpolation(solver: diffrax.AbstractERK, size: int, dtype: jnp.dtype) -> Between:
    """The function from steps and a time in each lane to the states then."""
    number, vector = jnp.zeros((), dtype), jnp.zeros((size,), dtype)
    slopes = jnp.zeros((tableau_of(solver).num_stages, size), dtype)

    def one(_, t, t0, t1, y0, y1, k):
        return solver.interpolation_cls(t0=t0, t1=t1, y0=y0, y1=y1, k=k).evaluate(t)

    program = LaneProgram(one, (), number, number, number, vector, vector, slopes)

    def between(step: Step, t: Float[Array, " lanes"]) -> Float[Array, "size lanes"]:
        increments = (step.end - step.start)[None, None] * step.slopes
        numbers = [t, step.start, step.end, *elements_of(step.x, step.y, increments)]
        return program([], numbers)

    return between
