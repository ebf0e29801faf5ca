"""Lagrange's equations with multipliers: mass matrix, forces and constraints by JAX, and their linear solution.

The systems of ``lagrangian`` evaluate them in every step, and check their constraints by them where a run starts.

With M = ∂²L/∂q̇², f = ∂L/∂q + Q − (∂²L/∂q̇∂q) q̇ − ∂²L/∂q̇∂t and constraints c(t, q, q̇) = A(t, q) q̇ + b(t, q) = 0,

    [M −Aᵀ; A 0] (q̈, λ) = (f, −Ȧ q̇ − ḃ).

The matrix is solved as a whole, so that M may be singular in directions that A fixes. Source: the principle of Lagrange
and d'Alembert, ``LdA`` of Putkaradze & Rogers (2018); Bloch, Nonholonomic Mechanics and Control (2015), section 5.2.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics.linear import inverse
from ...numerics.vectors import apply
from ..conditions import Condition, Problem

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
        first = apply(K_inverse, right)
        both = first + apply(K_inverse, right - apply(K, first))
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
        return q - apply(inverse(saddle(mass, rows, held))[:n, n:], positions(t, q))

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
    return qdot - apply(inverse(saddle(mass, rows, held))[:n, n:], residual)


ALLOWED_RESIDUAL = 1e-6  # of the size of its terms: how far a constraint may be from 0 at the start
SINGULAR_PLACE = 1e-6  # relative to the largest row, below which what is left of a row is rounding
SHOWN_COEFFICIENT = 1e-6  # of the largest coefficient: one that is written in a sentence
REMEDY = "the method `consistent(t, state)` of the system gives the nearest state that keeps all constraints"


class Constraints(NamedTuple):
    """The constraints A q̇ + b = 0 in one state: those of velocities, then the rates of holonomic ones.

    - ``names``: one for each row, and ``velocities`` how many of them are constraints of velocities.
    - ``rows``, ``beside``: A, and what it is a little beside the start.
    - ``residual``, ``allowed``: A q̇ + b, and how far from 0 it may be.
    - ``second``: the largest second derivative of each constraint of velocities by q̇, which is 0 where it is affine.
    - ``places``, ``places_allowed``: φ of the holonomic ones, and how far from 0 it may be.
    """

    names: tuple[str, ...]
    velocities: int
    rows: Float[Array, "m n"]
    beside: Float[Array, "m n"]
    residual: Float[Array, " m"]
    allowed: Float[Array, " m"]
    second: Float[Array, " velocities"]
    places: Float[Array, " k"]
    places_allowed: Float[Array, " k"]


class Affine(Condition):
    """That constraints of velocities are affine in q̇; ``value`` has the largest second derivative of each."""

    __slots__ = ()

    def problems(self) -> Iterator[Problem]:
        """Yields a problem for each constraint that is not affine in q̇."""
        for holds, name, second in zip(np.asarray(self.holds), self.name, np.asarray(self.value), strict=True):
            if not holds:
                but = f"a second derivative of it by qdot is {second:.6g} at the start"
                yield Problem(str(name), "be affine in qdot, A(t, q) qdot + b(t, q)", but)


class Satisfied(Condition):
    """That the start keeps the constraints ``name[k]``; ``value`` has what each of them is there."""

    __slots__ = ()

    def problems(self) -> Iterator[Problem]:
        """Yields a problem for each constraint that the start violates, under the name of the part of the state."""
        for holds, name, residual in zip(np.asarray(self.holds), self.name, np.asarray(self.value), strict=True):
            if not holds:
                yield Problem(
                    self.must, f"keep {name} at the start", f"that is {residual:.6g} there and not 0; {REMEDY}"
                )


class Open(Condition):
    """That no contact ``name[k]`` has been passed at the start; ``value`` has the gap of each of them there."""

    __slots__ = ()

    def problems(self) -> Iterator[Problem]:
        """Yields a problem for each contact whose gap is negative."""
        for holds, name, gap in zip(np.asarray(self.holds), self.name, np.asarray(self.value), strict=True):
            if not holds:
                but = f"its gap is {gap:.6g} there; start where the contact is open or just touches"
                yield Problem(self.must, f"keep {name} at 0 or more at the start", but)


class Independent(Condition):
    """That no row of A depends on those before it; ``value`` has A, the same beside the start and, in two more columns,
    residuals and how far from 0 they may be.
    """

    __slots__ = ()

    def problems(self) -> Iterator[Problem]:
        """Yields a problem for each row of A that is a combination of rows before it, which are named."""
        holds, table = np.asarray(self.holds), np.asarray(self.value)
        (A, beside), residual, allowed = np.split(table[:, :-2], 2, axis=1), table[:, -2], table[:, -1]
        for k in np.flatnonzero(~holds):
            before = np.flatnonzero(holds[:k])
            parts = np.linalg.lstsq(A[before].T, A[k], rcond=None)[0]
            named = [(c, str(self.name[j])) for c, j in zip(parts, before, strict=True) if abs(c) > SHOWN_COEFFICIENT]
            mismatch = abs(residual[k] - parts @ residual[before])
            if np.linalg.matrix_rank(beside[[*before, k]], SINGULAR_PLACE) > len(before):
                where = "0" if not np.any(A[k]) else _sum(named)
                but = (
                    f"its row of A is {where} there, although not beside it, so that the constraints do not determine "
                    "how the motion goes on, as where a linkage is stretched out; start in another place"
                )
            elif not np.any(A[k]):
                but = "its row of A is 0 there, so that it restricts no velocity; leave it out"
            elif mismatch > allowed[k] + np.abs(parts) @ allowed[before]:
                but = f"its row of A is {_sum(named)}, and its other terms are not, so that nothing keeps them all"
            else:
                but = f"its row of A is {_sum(named)}, so that its multiplier is not determined; leave it out"
            yield Problem(str(self.name[k]), "be independent of the constraints before it at the start", but)


class Regular(Condition):
    """That [M −Aᵀ; A 0] is regular; ``value`` is M."""

    __slots__ = ()

    def problems(self) -> Iterator[Problem]:
        """Yields the problem that a motion that the constraints allow has no inertia."""
        if not bool(self.holds):
            mass = np.array2string(np.asarray(self.value), precision=4, separator=", ").replace("\n", "")
            but = f"∂²L/∂q̇² is {mass} at the start; give each coordinate a mass or a constraint"
            yield Problem(str(self.name), self.must, but)


def start_conditions(mass: Float[Array, "n n"], given: Constraints) -> Iterator[Condition]:
    """Yields the conditions on constraints, and on the mass matrix that goes with them, in one state."""
    independent, v = _are_independent(given.rows), given.velocities
    if v:
        limit = jnp.maximum(given.allowed, ALLOWED_RESIDUAL * _lengths(given.rows))[:v]
        yield Affine(jnp.abs(given.second) <= limit, given.names[:v], given.second, "affine in qdot")
    if given.names:
        # Holonomic constraints depend on each other only if they do so themselves, and not their rates alone.
        residual = jnp.concatenate([given.residual[:v], given.places])
        allowed = jnp.concatenate([given.allowed[:v], given.places_allowed])
        table = jnp.concatenate([given.rows, given.beside, residual[:, None], allowed[:, None]], axis=1)
        yield Independent(independent, given.names, table, "independent of each other")
        # A row that depends on others is told as such, and not as violated, too.
        near = (jnp.abs(given.places) <= given.places_allowed) | ~independent[v:]
        yield Satisfied(near, given.names[v:], given.places, "state.q")
        consistent = (jnp.abs(given.residual) <= given.allowed) | ~independent
        yield Satisfied(consistent, given.names, given.residual, "state.qdot")
    regular = _is_regular(mass, given.rows) | ~jnp.all(independent)
    yield Regular(regular, "lagrangian", mass, "give an inertia to every motion that the constraints allow")


def independent_beyond(count: int, rows: Float[Array, "m n"], names: tuple[str, ...]) -> Condition:
    """Returns the condition that the rows of A after the first ``count`` do not depend on those before them."""
    none = jnp.zeros((rows.shape[0], 2), rows.dtype)  # residuals, and how far from 0 they may be
    holds = _are_independent(rows) | (jnp.arange(rows.shape[0]) < count)
    return Independent(holds, names, jnp.concatenate([rows, rows, none], axis=1), "independent of each other")


def _lengths(rows: Float[Array, "m n"]) -> Float[Array, " m"]:
    return jnp.sqrt(jnp.sum(rows**2, axis=1))


def _are_independent(rows: Float[Array, "m n"]) -> Bool[Array, " m"]:
    """Returns whether each row is independent of the rows before it, by Gram and Schmidt, with the rows scaled to
    length 1.
    """
    # Half the digits: what is left of a dependent row is the rounding of the others.
    tolerance = float(jnp.finfo(rows.dtype).eps) ** 0.5
    basis: list[Float[Array, " n"]] = []
    holds: list[Bool[Array, ""]] = []
    for row, length in zip(rows, _lengths(rows), strict=True):
        rest = row / jnp.where(length > 0, length, 1.0)
        for unit in (*basis, *basis):  # twice, for what the first turn leaves by rounding
            rest = rest - jnp.sum(rest * unit) * unit
        left = jnp.sqrt(jnp.sum(rest**2))
        holds.append(left > tolerance)
        basis.append(jnp.where(left > tolerance, rest / jnp.where(left > 0, left, 1.0), 0.0))
    return jnp.stack(holds) if holds else jnp.zeros((0,), bool)


def _is_regular(mass: Float[Array, "n n"], rows: Float[Array, "m n"]) -> Bool[Array, ""]:
    """Returns whether the condition number of the matrix, with rows and columns scaled alike, leaves digits."""
    K = saddle(mass, rows)
    largest = jnp.max(jnp.abs(K), axis=1)
    scale = 1 / jnp.sqrt(jnp.where(largest > 0, largest, 1.0))
    K = K * scale[:, None] * scale[None]
    number = jnp.max(jnp.sum(jnp.abs(K), axis=1)) * jnp.max(jnp.sum(jnp.abs(inverse(K)), axis=1))
    # Two digits of a solution remain.
    return number < 1e-2 / float(jnp.finfo(K.dtype).eps)


def _sum(parts: list[tuple[float, str]]) -> str:
    """Writes a linear combination in words."""
    text = ""
    for c, name in parts:
        sign = ("−" if c < 0 else "") if not text else (" − " if c < 0 else " + ")
        text += sign + ("" if abs(abs(c) - 1) < SHOWN_COEFFICIENT else f"{abs(c):.6g} times ") + f"that of {name}"
    return text
