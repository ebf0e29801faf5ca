"""Lagrange's equations with multipliers: mass matrix, forces and constraints by JAX, and their linear solution.

The systems of ``lagrangian`` evaluate them in every step.

With M = ∂²L/∂q̇², f = ∂L/∂q + Q − (∂²L/∂q̇∂q) q̇ − ∂²L/∂q̇∂t and constraints c(t, q, q̇) = A(t, q) q̇ + b(t, q) = 0,

    [M −Aᵀ; A 0] (q̈, λ) = (f, −Ȧ q̇ − ḃ).

The matrix is solved as a whole, so that M may be singular in directions that A fixes. Source: the principle of Lagrange
and d'Alembert, ``LdA`` of Putkaradze & Rogers (2018); Bloch, Nonholonomic Mechanics and Control (2015), section 5.2.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.linear import inverse, product

Scalar = Callable[[Float[Array, ""], Float[Array, " n"], Float[Array, " n"]], Float[Array, ""]]
Vector = Callable[[Float[Array, ""], Float[Array, " n"], Float[Array, " n"]], Float[Array, " m"]]
OfPlace = Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " k"]]

UNROLLED = 4  # Newton steps that are written out, which costs less than a loop


class Equations(NamedTuple):
    """The equations for q̈ and λ in one state.

    - ``mass``: M.
    - ``force``: f.
    - ``rows``: A.
    - ``bend``: Ȧ q̇ + ḃ, the rate of A q̇ + b at q̈ = 0.
    """

    mass: Float[Array, "n n"]
    force: Float[Array, " n"]
    rows: Float[Array, "m n"]
    bend: Float[Array, " m"]

    @property
    def matrix(self) -> Float[Array, "size size"]:
        """[M −Aᵀ; A 0]."""
        return saddle(self.mass, self.rows)

    def solve(self) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
        """Solves for q̈ and λ."""
        return self.solve_by(inverse(self.matrix))

    def solve_by(self, K_inverse: Float[Array, "size size"]) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
        """Solves for q̈ and λ by the inverse of the matrix, with one step of iterative refinement."""
        K, right = self.matrix, jnp.concatenate([self.force, -self.bend])
        first = times(K_inverse, right)
        both = first + times(K_inverse, right - times(K, first))
        n = self.force.size
        return both[:n], both[n:]


def saddle(
    mass: Float[Array, "n n"], rows: Float[Array, "m n"], held: Bool[Array, " m"] | None = None
) -> Float[Array, "size size"]:
    """Builds [M −Aᵀ; A 0], of all rows or of those that are ``held``; others have a multiplier of their own."""
    m = rows.shape[0]
    corner = jnp.zeros((m, m), rows.dtype)
    if held is not None:
        rows, corner = jnp.where(held[:, None], rows, 0.0), jnp.diag(jnp.where(held, 0.0, 1.0)).astype(rows.dtype)
    above = jnp.concatenate([mass, -rows.T], axis=1)
    below = jnp.concatenate([rows, corner], axis=1)
    return jnp.concatenate([above, below], axis=0)


def equations(
    lagrangian: Scalar,
    forces: Vector,
    constraint: Vector,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    qdot: Float[Array, " n"],
) -> Equations:
    """Returns the equations of a Lagrangian L, generalised forces Q and constraints A q̇ + b, each a function of (t, q,
    q̇).
    """
    momentum, unit = jax.grad(lagrangian, argnums=2), jnp.ones_like(t)
    _, drift = jax.jvp(lambda t, q: momentum(t, q, qdot), (t, q), (unit, qdot))
    _, bend = jax.jvp(lambda t, q: constraint(t, q, qdot), (t, q), (unit, qdot))
    return Equations(
        mass=jax.jacfwd(momentum, argnums=2)(t, q, qdot),
        force=jax.grad(lagrangian, argnums=1)(t, q, qdot) + forces(t, q, qdot) - drift,
        rows=jax.jacfwd(constraint, argnums=2)(t, q, qdot),
        bend=bend,
    )


def rate_along(positions: OfPlace) -> Vector:
    """Returns the function ∂φ/∂t + (∂φ/∂q) q̇ of position constraints φ(t, q) = 0, which is affine in q̇ like a
    velocity constraint.
    """

    def rate(t: Float[Array, ""], q: Float[Array, " n"], qdot: Float[Array, " n"]) -> Float[Array, " k"]:
        return jax.jvp(positions, (t, q), (jnp.ones_like(t), qdot))[1]

    return rate


def nearest_place(
    mass: Float[Array, "n n"],
    positions: OfPlace,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    steps: int,
    held: Bool[Array, " k"] | None = None,
) -> Float[Array, " n"]:
    """Finds the q near the given one with φ(t, q) = 0, by Newton steps that are as short as possible in the metric M.

    A step δ satisfies M δ = Aᵀ μ and A δ = −φ, so that the units of the coordinates do not matter. Where it is said
    which constraints are ``held``, others are left as they are.
    """
    n = q.size

    def newton(_: Any, q: Float[Array, " n"]) -> Float[Array, " n"]:
        rows = jax.jacfwd(positions, argnums=1)(t, q)
        # This block takes a residual of the constraints to the step that removes it.
        return q - times(inverse(saddle(mass, rows, held))[:n, n:], positions(t, q))

    if steps > UNROLLED:
        return jax.lax.fori_loop(0, steps, newton, q)
    for k in range(steps):
        q = newton(k, q)
    return q


def nearest_velocity(
    mass: Float[Array, "n n"],
    rows: Float[Array, "m n"],
    residual: Float[Array, " m"],
    qdot: Float[Array, " n"],
    held: Bool[Array, " m"] | None = None,
) -> Float[Array, " n"]:
    """Finds the nearest q̇ in the metric M with A q̇ + b = 0, where the given one leaves ``residual``; of all rows, or
    of those that are ``held``.
    """
    n = qdot.size
    return qdot - times(inverse(saddle(mass, rows, held))[:n, n:], residual)


def times(A: Float[Array, "k n"], b: Float[Array, " n"]) -> Float[Array, " k"]:
    """Computes A b."""
    return product(A, b[:, None])[:, 0]
