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
from ..solvers.dense.continuous import ContinuousMethod, continuous, has_one_tableau
from ..solvers.interpolation import integrals

# The lanes are the last axis of every array, so that a compiler can put neighbours into one register.
Field = Callable[[Float[Array, " lanes"], Float[Array, "size lanes"]], Float[Array, "size lanes"]]


class Step(NamedTuple):
    """A step from ``start`` to ``end``, and what it found: slopes, the new state, its error.

    The slopes are those at the stages and then, of a continuous method, those between, where these were asked for.
    ``last`` is the slope at the end, with which the next step begins.
    """

    start: Float[Array, " lanes"]
    end: Float[Array, " lanes"]
    x: Float[Array, "size lanes"]
    slopes: Float[Array, "slopes size lanes"]
    y: Float[Array, "size lanes"]
    last: Float[Array, "size lanes"]
    error: Float[Array, "size lanes"]


def step(
    tableau: diffrax.ButcherTableau,
    field: Field,
    start: Float[Array, " lanes"],
    end: Float[Array, " lanes"],
    x: Float[Array, "size lanes"],
    first: Float[Array, "size lanes"],
    fresh: Bool[Array, " lanes"],
    within: ContinuousMethod | None = None,
    asked: Bool[Array, ""] | bool = False,
) -> Step:
    """A step of a method whose last stage is the slope at its end; ``first`` is the slope at its start, which lanes
    that are ``fresh`` have yet to compute.

    Where it is ``asked`` for the states ``within``, the slopes follow that these need.

    The stages are a loop, because a program in which the field stands once compiles ten times faster, and runs faster
    too, than one in which it stands thirteen times. Each stage then sums over all stages, with zeros for later ones.
    """
    stages, nodes, rows = tableau.num_stages, np.concatenate([[0.0], tableau.c]), jnp.asarray(matrix(tableau), x.dtype)
    h, used, more = end - start, [j for j in range(stages) if np.any(matrix(tableau)[:, j])], 0
    if within is not None:
        more, nodes = within.nodes.size, np.concatenate([nodes, within.nodes])
        rows = jnp.concatenate([jnp.pad(rows, ((0, 0), (0, more))), jnp.asarray(within.rows, x.dtype)])
        used = range(stages + more)

    def stage(i, carry):
        slopes, y = carry
        state = separately(x + h[None] * sum(rows[i, j] * slopes[j] for j in used))
        # Rounding must not lead past the end, which may be a kink.
        t = jnp.minimum(start + jnp.asarray(nodes, x.dtype)[i] * h, end)
        slope = jnp.where((i > 0) | fresh, field(t, state), first)
        slopes = jax.lax.dynamic_update_index_in_dim(slopes, slope, i, 0)
        return slopes, jnp.where(i < stages, state, y) if more else state

    slopes = jnp.zeros((stages + more, *x.shape), x.dtype).at[0].set(first)
    from_stage, to_stage = jnp.where(jnp.any(fresh), 0, 1), jnp.where(asked, stages + more, stages)
    slopes, y = jax.lax.fori_loop(from_stage, to_stage, stage, (slopes, x))
    error = h[None] * sum(float(b) * slopes[j] for j, b in enumerate(tableau.b_error) if b != 0)
    return Step(start, end, x, slopes, y, slopes[stages - 1], jnp.asarray(error))


def matrix(tableau: diffrax.ButcherTableau) -> np.ndarray:
    """The coefficients of a tableau as a square matrix, zero on and above the diagonal."""
    square = np.zeros((tableau.num_stages, tableau.num_stages))
    for i, row in enumerate(tableau.a_lower, start=1):
        square[i, : len(row)] = row
    return square


def fits(solver: diffrax.AbstractSolver) -> bool:
    """Whether this is an explicit method whose last stage is the slope at the end, and which estimates its error."""
    return has_one_tableau(solver)


def tableau_of(solver: diffrax.AbstractERK) -> diffrax.ButcherTableau:
    """The coefficients of a suitable method."""
    assert isinstance(solver.tableau, diffrax.ButcherTableau)
    return solver.tableau


# From steps and a time in each lane to the states then.
Between = Callable[[Step, Float[Array, " lanes"]], Float[Array, "size lanes"]]


def interpolation(solver: diffrax.AbstractERK, size: int, dtype: jnp.dtype) -> Between:
    """The states within a step, by the solver's own interpolation."""
    stages = tableau_of(solver).num_stages

    def one(t, t0, t1, y0, y1, k):
        return solver.interpolation_cls(t0=t0, t1=t1, y0=y0, y1=y1, k=k).evaluate(t)

    return _in_lanes(one, stages, size, dtype)


def exact(solver: diffrax.AbstractERK, size: int, dtype: jnp.dtype) -> Between:
    """The states within a step of which these were asked for, nearly as exact as that at its end."""
    method = continuous(solver)
    if method is None:
        return interpolation(solver, size, dtype)

    degree, slopes = method.expansion.shape

    def one(t, t0, t1, y0, _, k):
        weights = jnp.stack(integrals((t - t0) / jnp.where(t1 == t0, 1.0, t1 - t0), degree)) @ method.expansion
        return y0 + weights @ k

    return _in_lanes(one, slopes, size, dtype)


def _in_lanes(one: Callable[..., Array], slopes: int, size: int, dtype: jnp.dtype) -> Between:
    """The states ``one(t, t0, t1, y0, y1, k)`` in all lanes, from the first slopes of steps."""
    number, vector = jnp.zeros((), dtype), jnp.zeros((size,), dtype)
    like = number, number, number, vector, vector, jnp.zeros((slopes, size), dtype)
    program = LaneProgram(lambda _, *changing: one(*changing), (), *like)

    def between(step: Step, t: Float[Array, " lanes"]) -> Float[Array, "size lanes"]:
        increments = (step.end - step.start)[None, None] * step.slopes[:slopes]
        return program([], [t, step.start, step.end, *elements_of(step.x, step.y, increments)])

    return between
