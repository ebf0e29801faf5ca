"""What dry friction holds and what it pushes: one linear law for the contact, for rolling and for spinning.

A body answers amounts z linearly: each row has an amount z_k and what comes with it, w = w₀ + Q z. On the ground, z are
the slip acceleration and the dry torque, and w are the reaction and the rate of ω; of a body that cannot slip, only the
torque and the rate remain. Of each row a mode gives one of the two, z or w, as a value and a part in proportion to the
normal force N:

- what slips has the friction w = −μ N σ, and what flies w = 0; what does not slip has z = 0;
- what turns has the torque z = −ρ r N σ; what is held has its rate w, which is 0, or that which brakes it.

N is linear in z as well, and so it is the solution of one equation, N = N₀ + slope N.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics import linear, vectors

AnyHeld = TypeVar("AnyHeld")


class Rows(NamedTuple):
    """w = ``rest`` + ``matrix`` z and N = ``normal`` + ``lift``·z.

    There may be more amounts than rows: the last ones are then N, and their columns are the effect of a unit of N.
    """

    rest: Float[Array, " rows"]
    matrix: Float[Array, "rows amounts"]
    normal: Float[Array, ""]
    lift: Float[Array, " amounts"]


class Acting(NamedTuple):
    """The ``amounts`` z, with w, and the ``normal`` force.

    ``pressing`` is the N of dry friction, 0 where the ground would have to pull. ``solvability`` is 1 − slope: N has no
    solution where it is not positive (Painlevé's paradox), and these numbers mean nothing there.
    """

    amounts: Float[Array, " amounts"]
    w: Float[Array, " rows"]
    normal: Float[Array, ""]
    pressing: Float[Array, ""]
    solvability: Float[Array, ""]


class Law(NamedTuple):
    """Rows in a mode: where it is ``solved`` for z, w is given, elsewhere z itself; ``value`` is that without N."""

    rows: Rows
    solved: Bool[Array, " rows"]
    value: Float[Array, " rows"]
    inverse: Float[Array, "rows rows"]

    @classmethod
    def of(cls, rows: Rows, solved: Bool[Array, " rows"], value: Float[Array, " rows"]) -> "Law":
        """Solves the rows for what a mode does not give."""
        size = solved.size
        matrix = jnp.where(solved[:, None], rows.matrix[:, :size], jnp.eye(size, dtype=rows.rest.dtype))
        return cls(rows, solved, value, vectors.inverse(matrix) if size == 3 else linear.inverse(matrix))

    def amounts(self, push: Float[Array, " rows"]) -> tuple[Float[Array, " amounts"], Float[Array, " amounts"]]:
        """Computes z without N, and what a unit of N adds, of which ``push`` is given."""
        size, more = self.solved.size, self.rows.lift.size - self.solved.size
        moved = jnp.sum(self.rows.matrix[:, size:], axis=1) if more else 0.0
        base, unit = (
            jnp.where(self.solved, _product(self.inverse, jnp.where(self.solved, value - rest, value)), value)
            for value, rest in ((self.value, self.rows.rest), (push, moved))
        )
        none, once = jnp.zeros((more,), base.dtype), jnp.ones((more,), base.dtype)
        return jnp.concatenate([base, none]), jnp.concatenate([unit, once])

    def act(self, push: Float[Array, " rows"], slides: Bool[Array, ""] | bool = False) -> Acting:
        """Computes what acts, where a unit of N gives ``push``.

        Of a contact that ``slides`` a guard says when N has no solution, so that its N is some number there; others
        have NaN, which ends the run.
        """
        base, unit = self.amounts(push)
        without, share = self.rows.normal + jnp.sum(self.rows.lift * base), 1 - jnp.sum(self.rows.lift * unit)
        sliding = without / jnp.where(share == 0, 1.0, share)
        N = jnp.where(slides, sliding, pressing_force(without, share))
        amounts = base + N * unit
        w = jnp.where(self.solved, self.value + N * push, self.rows.rest + _product(self.rows.matrix, amounts))
        return Acting(amounts, w, jnp.where((without > 0) | slides, N, without), N, share)


def release(
    held: AnyHeld,
    weigh: Callable[[AnyHeld], tuple[Float[Array, " loads"], Any]],
    let_go: Callable[[AnyHeld, Any, Bool[Array, " loads"]], AnyHeld],
    at_once: Bool[Array, " loads"],
) -> AnyHeld:
    """Lets go of all that dry friction cannot hold, the most overloaded first: as one goes, all other loads jump.

    - ``weigh``: the loads of all that is held, with what acts; −∞ where friction holds, and where nothing is held.
    - ``let_go``: what is held after some of it has let go, under what acts.
    - ``at_once``: what an event has loosened, which lets go before all else.
    """

    def with_one_less(k: Array, held: AnyHeld) -> AnyHeld:
        loads, acting = weigh(held)
        most = (loads == jnp.max(loads)) & (loads > -jnp.inf)
        # Of several that are equally overloaded the first alone lets go: that may relieve the others.
        most &= jnp.cumsum(most) == 1
        return let_go(held, acting, jnp.where((k == 0) & jnp.any(at_once), at_once, most))

    return jax.lax.fori_loop(0, at_once.size + 1, with_one_less, held)


def load(square: Float[Array, "*forces"], largest: Float[Array, "*forces"]) -> Float[Array, "*forces"]:
    """Computes the load of a friction that holds, from the square of the force that it bears and the largest one."""
    # As the square of a share loads of all kinds compare. The least divisor keeps it within the range of numbers.
    return square / jnp.maximum(largest, float(jnp.finfo(largest.dtype).tiny) ** 0.25) ** 2


def pressing_force(without: Float[Array, ""], share: Float[Array, ""]) -> Float[Array, ""]:
    """Computes the N of dry friction from N without it and from 1 − slope: 0 where the ground would have to pull.

    Where a unit of N adds more than itself to N, there is no solution, and NaN ends the run.
    """
    return jnp.maximum(without, 0.0) / jnp.where(share > 0, share, jnp.nan)


def _product(A: Float[Array, "rows amounts"], b: Float[Array, " amounts"]) -> Float[Array, " rows"]:
    return jnp.sum(A * b[None], axis=1)
