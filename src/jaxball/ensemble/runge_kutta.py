"""One step of an explicit Runge–Kutta method in every lane, and the states within it."""

from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..numerics.lanes import LaneProgram, elements_of
from ..numerics.pieces import separately

# The lanes are the last axis of every array, so that a compiler can put neighbours into one register.
Field = Callable[[Float[Array, " lanes"], Float[Array, "size lanes"]], Float[Array, "size lanes"]]


class Step(NamedTuple):
    """A step from ``start`` to ``end``, and what it found: slopes at the stages, the new state, its error."""

    start: Float[Array, " lanes"]
    end: Float[Array, " lanes"]
    x: Float[Array, "size lanes"]
    slopes: Float[Array, "stages size lanes"]
    y: Float[Array, "size lanes"]
    error: Float[Array, "size lanes"]

    @property
    def last(self) -> Float[Array, "size lanes"]:
        """The slope at the end, with which the next step begins."""
        return self.slopes[-1]


def step(
    tableau: diffrax.ButcherTableau,
    field: Field,
    start: Float[Array, " lanes"],
    end: Float[Array, " lanes"],
    x: Float[Array, "size lanes"],
    first: Float[Array, "size lanes"],
    fresh: Bool[Array, " lanes"],
) -> Step:
    """A step of a method whose last stage is the slope at its end; ``first`` is the slope at its start, which lanes
    that are ``fresh`` have yet to compute.

    The stages are a loop, because a program in which the field stands once compiles ten times faster, and runs faster
    too, than one in which it stands thirteen times. Each stage then sums over all stages, with zeros for later ones.
    """
    lower, nodes = matrix(tableau), np.concatenate([[0.0], tableau.c])
    h, used = end - start, [j for j in range(tableau.num_stages) if np.any(lower[:, j])]

    def stage(i, carry):
        slopes, _ = carry
        row = jnp.asarray(lower, x.dtype)[i]
        y = separately(x + h[None] * sum(row[j] * slopes[j] for j in used))
        # Rounding must not lead past the end, where a kink may be.
        t = jnp.minimum(start + jnp.asarray(nodes, x.dtype)[i] * h, end)
        slope = jnp.where((i > 0) | fresh, field(t, y), first)
        return jax.lax.dynamic_update_index_in_dim(slopes, slope, i, 0), y

    slopes = jnp.zeros((tableau.num_stages, *x.shape), x.dtype).at[0].set(first)
    from_stage = jnp.where(jnp.any(fresh), 0, 1)
    slopes, y = jax.lax.fori_loop(from_stage, tableau.num_stages, stage, (slopes, x))
    error = h[None] * sum(float(b) * slopes[j] for j, b in enumerate(tableau.b_error) if b != 0)
    return Step(start, end, x, slopes, y, jnp.asarray(error))


def matrix(tableau: diffrax.ButcherTableau) -> np.ndarray:
    """The coefficients of a tableau as a square matrix, zero on and above the diagonal."""
    square = np.zeros((tableau.num_stages, tableau.num_stages))
    for i, row in enumerate(tableau.a_lower, start=1):
        square[i, : len(row)] = row
    return square


def fits(solver: diffrax.AbstractSolver) -> bool:
    """Whether this is an explicit method whose last stage is the slope at the end, and which estimates its error."""
    if not isinstance(solver, diffrax.AbstractERK) or not isinstance(solver.tableau, diffrax.ButcherTableau):
        return False
    return solver.tableau.fsal and solver.tableau.ssal


def tableau_of(solver: diffrax.AbstractERK) -> diffrax.ButcherTableau:
    """The coefficients of a method that fits."""
    assert isinstance(solver.tableau, diffrax.ButcherTableau)
    return solver.tableau


# From steps and a time in each lane to the states then.
Between = Callable[[Step, Float[Array, " lanes"]], Float[Array, "size lanes"]]


def interpolation(solver: diffrax.AbstractERK, size: int, dtype: jnp.dtype) -> Between:
    """The states within a step, by the solver's own interpolation."""
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
