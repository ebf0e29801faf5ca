"""Rows of a system with a Lagrangian that a law may hold: contacts with one side, and dry friction.

A row has a velocity u = J q̇ + b, and while a law holds it, u = 0. What holds or pushes it is an amount z, which acts on
the coordinates as Jᵀ z. With the constraints of the system eliminated, all rows together answer by u̇ = w₀ + Q z, which
is a law of ``physics.dynamics.dry_friction``. In a **mode** each row is held, 0, or moves in a direction, 1 or −1:

- a contact is held, with z ≥ 0, or open, 1, with z = 0;
- dry friction holds with |z| ≤ ``static``, or acts against the motion, z = −``level`` times the direction.

Which rows are held is a problem with one solution, as Q is positive definite: z within its limits, or u̇ onwards. It is
found by Murty's method of the least index: as long as a row does not fit, the first of these changes. To let go of the
most overloaded alone would not do, because as one contact opens another may close again.

Source: K. G. Murty, Linear Complementarity, Linear and Nonlinear Programming (1988), chapter 4; for limits on both
sides J. J. Júdice and F. M. Pires, Computers Ops Res. 21 (1994), 587.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...interface.arguments import refusal
from ...interface.printing import Printed
from ...interface.wording import all_of
from ...numerics.arrays import default_dtype, namespace_of
from ...numerics.declare import number, number_or_none
from ...numerics.linear import inverse, product
from ...numerics.vectors import apply
from ...programs.derivatives.differentiation import without_derivatives
from ..conditions import Condition, ExplainedCondition, Problem, positive
from ..dynamics.dry_friction import Law, Rows
from .lagrangian import LEAST_COUNTED, AbstractLagrangianSystem, LagrangianState

if TYPE_CHECKING:
    from .from_functions import LagrangianSystem

SUMMED = 64  # in units of rounding of the terms that are summed: what is smaller counts as zero
DEPENDENT = 1e-4  # in units of 1 / rounding: where what holds a row grows so much by the others, it is not determined
MOST_TURNS = 1000  # of the search for what is held, which takes at most 3 to the power of the rows


class UnilateralContact(Printed):
    """A contact with one side: the system moves freely where ``gap`` > 0, and where that is 0 something pushes back.

    Where the gap falls to zero at a speed there is an impact, in which its rate becomes −``restitution`` times what it
    was. A rebound that is too slow is none: the gap stays 0, held by a reaction λ ≥ 0 that acts as λ ∂g/∂q, until that
    falls to zero.

    **Arguments:**

    - ``gap``: g(t, q), and ``parameters`` if it takes them: a number, or a list of them for several contacts of a kind.
    - ``restitution``: Newton's e, from 0 to 1.
    - ``slowest``: a rebound slower than this part of the fastest approach so far, of the same contact, is treated as
      none, because bounces get shorter and shorter, and infinitely many of them end in a finite time (Zeno).

    **Example:**

    >>> from jaxball.physics.classical import UnilateralContact
    >>> def height(t, q):
    ...     return q[0]
    >>> UnilateralContact(height, restitution=0.5)
    UnilateralContact(gap=height, restitution=0.5, slowest=1e-06)
    """

    gap: Callable[..., Any] = eqx.field(static=True)
    restitution: Float[Array, "*group"] = eqx.field(converter=number(), default=0.0)
    slowest: Float[Array, "*group"] = eqx.field(converter=number(), default=1e-6)

    def __check_init__(self):
        _require_function("gap", "a function g(t, q)", self.gap)

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields the conditions on its numbers; traceable."""
        holds = (self.restitution >= 0) & (self.restitution <= 1)
        must = "from 0 to 1, or impacts would create energy"
        yield Condition(holds, f"{name}.restitution", self.restitution, must)
        must = "a positive number, or bounces would never end"
        yield Condition(positive(self.slowest), f"{name}.slowest", self.slowest, must)


class DryFriction(Printed):
    """Dry friction against a velocity of a system, which it holds at 0 where a force up to its level can.

    The velocity sticks at 0 until the force that this needs exceeds the level, and then slides against it.

    **Arguments:**

    - ``velocity``: of (t, q, q̇), and ``parameters`` if it takes them, affine in q̇, such as ẋ − 1 on a belt: a number,
      or a list of them, each with friction of its own.
    - ``level``: the friction, 0 or positive: a force for a speed, a torque for an angular velocity.
    - ``static``: the largest friction that holds, ``level`` or more; ``level`` if not given.

    **Example:**

    >>> from jaxball.physics.classical import DryFriction
    >>> def over_belt(t, q, qdot):
    ...     return qdot[0] - 0.5
    >>> DryFriction(over_belt, level=2.0, static=3.0)
    DryFriction(velocity=over_belt, level=2.0, static=3.0)
    """

    velocity: Callable[..., Any] = eqx.field(static=True)
    level: Float[Array, "*group"] = eqx.field(converter=number())
    static: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(), default=None)

    def __check_init__(self):
        _require_function("velocity", "a function of (t, q, qdot)", self.velocity)

    @property
    def largest(self) -> Float[Array, "*batch"]:
        """The largest friction that holds."""
        return self.level if self.static is None else self.static

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields the conditions on its numbers; traceable."""
        finite = namespace_of(self.level).isfinite
        yield Condition((self.level >= 0) & finite(self.level), f"{name}.level", self.level, "0 or positive")
        holds = positive(self.largest) & (self.largest >= self.level)
        yield Condition(holds, f"{name}.static", self.largest, "a positive number, not less than `level`")


def to_contacts(given: Any) -> tuple[UnilateralContact, ...]:
    """Returns the contacts of the argument ``unilateral``: a function stands for one without rebound.

    **Raises:** ``TypeError`` for anything else.
    """
    must = "a function g(t, q), a UnilateralContact such as UnilateralContact(g, restitution=0.5), or a list of these"
    listed = given if isinstance(given, list | tuple) else () if given is None else (given,)
    for item in listed:
        if not isinstance(item, UnilateralContact):
            _require_function("unilateral", must, item)
    return tuple(item if isinstance(item, UnilateralContact) else UnilateralContact(item) for item in listed)


def to_frictions(given: Any) -> tuple[DryFriction, ...]:
    """Returns the frictions of the argument ``dry``.

    **Raises:** ``TypeError`` for anything else.
    """
    listed = given if isinstance(given, list | tuple) else () if given is None else (given,)
    for item in listed:
        if not isinstance(item, DryFriction):
            raise refusal("dry", "a DryFriction such as DryFriction(velocity, level=0.3), or a list of these", item)
    return tuple(listed)


def _require_function(name: str, must: str, item: Any) -> None:
    if isinstance(item, type) or not callable(item):
        raise refusal(name, must, item)


class Limits(NamedTuple):
    """The numbers of all rows: z of a held row is from ``low`` to ``high``, and that of a moving one −``level`` times
    its direction.
    """

    low: Float[Array, " rows"]
    high: Float[Array, " rows"]
    level: Float[Array, " rows"]


class RowsInState(NamedTuple):
    """The rows in one state.

    - ``velocities``: u, and ``matrix``: J.
    - ``free``: q̈ without what acts on rows, and ``pull``: what a unit of each amount adds to q̈.
    - ``law``: w₀ and Q.
    - ``rounding``: of u, and of u̇ in ``rounding_of_rate``; so much of them counts as zero.
    """

    velocities: Float[Array, " rows"]
    matrix: Float[Array, "rows n"]
    free: Float[Array, " n"]
    pull: Float[Array, "n rows"]
    law: Rows
    rounding: Float[Array, " rows"]
    rounding_of_rate: Float[Array, " rows"]

    @property
    def rounding_of_amounts(self) -> Float[Array, " rows"]:
        """So much of z counts as zero."""
        return self.rounding_of_rate / jax.lax.stop_gradient(jnp.diagonal(self.law.matrix))


def limits_of(system: "LagrangianSystem") -> Limits:
    """Returns the limits of all rows."""
    contacts, frictions = system.row_sizes()
    zero = jnp.zeros(sum(contacts), default_dtype())
    largest, level = (
        repeat((getattr(friction, name) for friction in system.dry), frictions) for name in ("largest", "level")
    )
    return Limits(*map(jnp.concatenate, ([zero, -largest], [zero + jnp.inf, largest], [zero, level])))


def repeat(values: Iterable[Float[Array, ""]], sizes: Sequence[int]) -> Float[Array, " rows"]:
    """Returns each value as often as its function has rows."""
    each = [jnp.full(size, value) for value, size in zip(values, sizes, strict=True)]
    return jnp.concatenate([jnp.zeros((0,), default_dtype()), *each])


@eqx.filter_jit
def rows_in_state(system: "LagrangianSystem", t: Float[Array, ""], state: LagrangianState) -> RowsInState:
    """Computes the rows in one state."""
    q, qdot = state.q, state.qdot
    unit, terms = jnp.ones_like(t), AbstractLagrangianSystem.equations(system, t, state)
    K_inverse, n = inverse(terms.matrix), q.size
    free, _ = terms.solve_by(K_inverse)
    matrix = jax.jacfwd(system.row_rates, argnums=2)(t, q, qdot)
    _, bend = jax.jvp(lambda t, q: system.row_rates(t, q, qdot), (t, q), (unit, qdot))
    pull = product(K_inverse[:n, :n], matrix.T)
    none = jnp.zeros_like(bend)
    law = Rows(apply(matrix, free) + bend, product(matrix, pull), jnp.zeros_like(t), none)
    velocities = system.row_rates(t, q, qdot)
    sizes = without_derivatives((matrix, qdot, velocities, K_inverse, terms.force, bend))
    return RowsInState(velocities, matrix, free, pull, law, *_roundings(n, *map(jnp.abs, sizes)))


def _roundings(n, matrix, qdot, velocities, K_inverse, force, bend) -> tuple[Array, Array]:
    """Estimates the rounding of u and of u̇ from the sizes of the terms that make them."""
    limits = jnp.finfo(qdot.dtype)
    unit = SUMMED * float(limits.eps)
    of_rate = unit * (apply(matrix, apply(K_inverse[:n, :n], force)) + bend)
    # Positive also where nothing acts at all, so that a guard of 0 there is not an event.
    return unit * (apply(matrix, qdot) + velocities), of_rate + float(limits.tiny) ** 0.5


def rounding_of_gaps(
    system: "LagrangianSystem", t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, " contacts"]:
    """Estimates the rounding of g."""
    return size_of_gaps(system, t, q, SUMMED * float(jnp.finfo(q.dtype).eps))


def size_of_gaps(
    system: "LagrangianSystem", t: Float[Array, ""], q: Float[Array, " n"], part: float
) -> Float[Array, " contacts"]:
    """Computes how much g changes as the coordinates change by a part of their size."""
    slopes = jnp.abs(jax.jacfwd(system.gaps, argnums=1)(t, q))
    return part * apply(slopes, LEAST_COUNTED + jnp.abs(q))


def amounts(law: Rows, mode: Float[Array, " rows"], level: Float[Array, " rows"]) -> Float[Array, " rows"]:
    """Computes z in a mode, in which what is held has no acceleration."""
    return _in_mode(law, mode, level).amounts(jnp.zeros_like(mode))[0]


def _in_mode(law: Rows, mode: Float[Array, " rows"], level: Float[Array, " rows"]) -> Law:
    held = mode == 0
    return Law.of(law, held, jnp.where(held, 0.0, -mode * level))


@jax.jit
def choose(
    law: Rows,
    limits: Limits,
    mode: Float[Array, " rows"],
    decided: Bool[Array, " rows"],
    rounding: Float[Array, " rows"],
) -> Float[Array, " rows"]:
    """Finds which of the rows that are to be ``decided`` are held, and in which direction the others move on.

    ``mode`` is what is tried first, and ``rounding`` that of z. Where nothing fits, or rows that are held depend on
    each other, the mode is NaN, which ends a run. Of an impact, z are impulses and u̇ is u.
    """
    law, limits, rounding = without_derivatives((law, limits, rounding))

    def misfits(mode: Array) -> tuple[Array, Array]:
        held, z = mode == 0, amounts(law, mode, limits.level)
        w = law.rest + apply(law.matrix, z)
        above, below = z > limits.high + rounding, z < limits.low - rounding
        backwards = mode * w < -rounding * jnp.diagonal(law.matrix)
        other = jnp.where(held, jnp.where(above, -1.0, 1.0), 0.0)
        return decided & jnp.where(held, above | below, backwards), other

    def change(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        mode, turn, _ = carry
        wrong, other = misfits(mode)
        first = wrong & (jnp.cumsum(wrong) == 1)
        return jnp.where(first, other, mode), turn + 1, jnp.any(wrong)

    most = min(3**mode.size, MOST_TURNS)
    begin = mode, jnp.asarray(0), jnp.any(decided)
    mode, _, wrong = jax.lax.while_loop(lambda carry: carry[2] & (carry[1] <= most), change, begin)
    # The factor by which (Q⁻¹)ₖₖ exceeds 1/Qₖₖ grows without limit as a row becomes a sum of others that are held.
    share = jnp.diagonal(_in_mode(law, mode, limits.level).inverse) * jnp.diagonal(law.matrix)
    depends = (mode == 0) & ~(share * float(jnp.finfo(share.dtype).eps) < DEPENDENT)
    return jnp.where(wrong | jnp.any(depends), jnp.nan, mode)


def check_determined(mode: Float[Array, " rows"], names: tuple[str, ...]) -> ExplainedCondition:
    """Returns the condition that it is known which rows are held."""

    def problem() -> Problem:
        return Problem(
            "state",
            "let one set of contacts and frictions be held",
            f"those of {all_of(names)} depend on each other there",
        )

    return ExplainedCondition(~jnp.any(jnp.isnan(mode)), problem)


def mode_at_rest(system: "LagrangianSystem", t: Float[Array, ""], state: LagrangianState) -> Float[Array, " rows"]:
    """Finds the mode from a state alone: what touches and has no velocity is held if it can be, without an impact."""
    system, t, state = without_derivatives((system, t, state))
    rows, gaps = rows_in_state(system, t, state), system.gaps(t, state.q)
    touches = gaps <= rounding_of_gaps(system, t, state.q)
    still = jnp.abs(rows.velocities) <= rows.rounding
    decided = still.at[: gaps.size].set(still[: gaps.size] & touches)
    # A contact without a gap that is not still opens, or is about to be struck.
    moving = jnp.sign(rows.velocities).at[: gaps.size].set(1.0)
    mode = jnp.where(decided, 0.0, moving)
    return choose(rows.law, limits_of(system), mode, decided, rows.rounding_of_amounts)


def row_forces(system: "LagrangianSystem", t: Float[Array, ""], state: LagrangianState) -> Float[Array, " rows"]:
    """Computes z, as the state alone tells what is held."""
    rows, mode = rows_in_state(system, t, state), mode_at_rest(system, t, state)
    return amounts(rows.law, mode, limits_of(system).level)
