"""What dry friction holds and what it pushes: one linear law for the contact, for rolling and for spinning.

A body answers amounts z linearly: each row has an amount z_k and what comes with it, w = w₀ + Q z. On the ground, z are
the slip acceleration and the dry torque, and w are the reaction and the rate of ω; of a body that cannot slip, only the
torque and the rate remain. Of each row a mode gives one of the two, z or w, as a value and a part in proportion to the
normal force N:

- what slips has the friction w = −μ N σ, and what flies w = 0; what does not slip has z = 0;
- what turns has the torque z = −ρ r N σ; what is held has its rate w, which is 0, or that which brakes it.

N is linear in z as well, and so it is the solution of one equation, N = N₀ + slope N.

Against the turning of a body over its plane, exact dry friction has a torque that brakes it, or holds it at rest, which
``equations`` adds; ``contact.holding`` asks whether it can hold the body. Without it, ω has some rate and the plane
presses with some normal force, and a torque T at the contact adds to both in proportion: these are the rows. Where the
body rolls and spins, T is −N r times the coefficients and the directions of ω_h and ω₃; where friction holds one of
these, T is what gives it its rate. All vectors are along the axes of the contact, and ω is relative to the ground.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics import linear, vectors
from ...numerics.directions import diverging, unit
from ...numerics.vectors import apply, in_three, root
from ...programs.derivatives.differentiation import without_derivatives
from ..forces.resistance import AbstractResistance, Levels

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
            jnp.where(self.solved, apply(self.inverse, jnp.where(self.solved, value - rest, value)), value)
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
        w = jnp.where(self.solved, self.value + N * push, self.rows.rest + apply(self.rows.matrix, amounts))
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


ROUNDING = 64  # of a rate, in units of rounding: what is smaller is none
TORQUES = 32  # of a torque, in units of rounding of the torque that it is compared with: a smaller one is none


class TurningMode(NamedTuple):
    """How a body turns over its ground where dry friction is exact, as a solve knows it, along the axes of the contact.

    - ``sigma``: the direction of ω_h, shape (3,); 0 where the body rests.
    - ``spin``: 1 or −1, the sign of ω₃; 0 where the body does not spin.
    - ``rests``: whether friction holds ω_h. ``still``: whether friction holds ω₃.
    - ``braking``: the rate that ω_h has where friction holds it, shape (3,): 0 but at the end of rolling.
    - ``levels``: of dry friction at the rates of the body; of what is held, those with which it would begin to move.
    """

    sigma: Float[Array, "3"]
    spin: Float[Array, ""]
    rests: Bool[Array, ""]
    still: Bool[Array, ""]
    braking: Float[Array, "3"]
    levels: Levels


class Turning(NamedTuple):
    """How a body turns: ``rows`` has the torque for its amounts, and the rate of ω for what comes with them.

    ``radius`` is r.
    """

    rows: Rows
    radius: Float[Array, ""]


class TurningLaw(NamedTuple):
    """What a mode of turning gives, as in ``Law``: where the rate is given, not the torque, which part, and by N."""

    solved: Bool[Array, "3"]
    value: Float[Array, "3"]
    push: Float[Array, "3"]

    @classmethod
    def none(cls, like: Float[Array, "3"]) -> "TurningLaw":
        """Returns that of a body whose turning no dry friction resists."""
        nothing = jnp.zeros_like(like)
        return cls(jnp.zeros(3, bool), nothing, nothing)

    @classmethod
    def of(cls, r: Float[Array, ""], mode: TurningMode) -> "TurningLaw":
        """Returns what exact dry friction gives in a mode."""
        torque, levels = jnp.zeros_like(mode.sigma), mode.levels
        if levels.rolling is not None:
            torque = torque - levels.rolling * r * mode.sigma
        if levels.spinning is not None:
            torque = torque.at[2].add(-levels.spinning * r * mode.spin)
        solved = jnp.stack([mode.rests, mode.rests, mode.still])
        return cls(solved, jnp.where(solved, mode.braking, 0.0), jnp.where(solved, 0.0, torque))


def resist(turning: Turning, mode: TurningMode) -> Acting:
    """Computes what exact dry friction does in a mode. Where N would be negative without it, it only holds."""
    law = TurningLaw.of(turning.radius, mode)
    return Law.of(turning.rows, law.solved, law.value).act(law.push)


class Needs(NamedTuple):
    """What holds a body: ``rolling`` and ``spinning``, each the square of the largest torque, less that of the torque.

    The latter are ``loads``, as shares of the former. Largest torques are 0 or less without a normal force.
    """

    rolling: Float[Array, ""]
    spinning: Float[Array, ""]
    loads: Float[Array, "2"]

    def overloads(self, mode: TurningMode) -> Float[Array, "2"]:
        """Returns the loads where it is held although friction cannot do it; −∞ elsewhere."""
        fails = jnp.stack([mode.rests & ~(self.rolling > 0), mode.still & ~(self.spinning > 0)])
        return jnp.where(fails, self.loads, -jnp.inf)


def needs(static: Levels, r: Float[Array, ""], torque: Float[Array, "3"], normal: Float[Array, ""]) -> Needs:
    """Returns whether friction can hold the body as it does: what it has to spare is positive as long as it can.

    ``static`` are the levels of a body at rest.
    """
    spare, loads = [], []
    for level, square in (
        (static.rolling, jnp.sum(torque[:2] ** 2)),
        (static.spinning, torque[2] ** 2),
    ):
        largest = jnp.zeros_like(normal) if level is None else level * r * normal
        limits = jnp.finfo(largest.dtype)
        size = jax.lax.stop_gradient(root(square) + jnp.abs(largest))
        slack = TORQUES * float(limits.eps) * size + float(limits.tiny) ** 0.25
        # |T| ≤ largest with both sides squared, because |T| has no derivative where it is 0; a negative largest torque,
        # where the plane would have to pull, keeps its sign.
        spare.append(largest * jnp.abs(largest) - square + slack**2 + 2 * slack * size)
        loads.append(load(square, largest))
    return Needs(spare[0], spare[1], jnp.stack(loads))


def mode_of(resistance: AbstractResistance, turning: Turning, omega: Float[Array, "3"], planar: bool) -> TurningMode:
    """Returns the mode that follows from ω: held at rest if friction can do it.

    What it cannot hold turns against the torque that held it, and a ball rolls in the direction in which ω_h grows.
    """
    candidate = candidates(resistance, omega, planar)
    static, turning, held = without_derivatives((Levels.at_rest(resistance), turning, candidate))

    def weigh(mode: TurningMode) -> tuple[Float[Array, "2"], Float[Array, "3"]]:
        acting = resist(turning, mode)
        return needs(static, turning.radius, acting.amounts, acting.normal).overloads(mode), acting.amounts

    mode = release(held, weigh, let_go, jnp.zeros(2, bool))
    if not planar and static.rolling is not None:
        mode = along_growth(turning, mode, held.rests & ~mode.rests)
    rolls = jnp.sum(candidate.sigma**2) > 0
    return mode._replace(sigma=jnp.where(rolls, candidate.sigma, mode.sigma), levels=candidate.levels)


def candidates(resistance: AbstractResistance, omega: Float[Array, "3"], planar: bool) -> TurningMode:
    """Returns the mode of a body where friction holds all that does not move, whether it can or not."""
    # A disk turns about the second axis alone.
    rolling, spin = jnp.where(np.array([planar, False]), 0.0, omega[:2]), 0 * omega[2] if planar else omega[2]
    least = jax.lax.stop_gradient(ROUNDING * float(jnp.finfo(omega.dtype).eps) * root(jnp.sum(omega**2)))
    rolls, spins = jnp.sum(rolling**2) > least**2, jnp.abs(spin) > least
    along, sense = jnp.where(rolls, unit(rolling), 0.0), jnp.where(spins, jnp.sign(spin), 0.0)
    levels = Levels.at(resistance, jnp.sum(along * rolling), sense * spin)
    rests = ~rolls & (levels.rolling is not None)
    still = ~spins & (levels.spinning is not None and not planar)
    return TurningMode(in_three(along), sense, rests, still, jnp.zeros_like(omega), levels)


def let_go(mode: TurningMode, torque: Float[Array, "3"], off: Bool[Array, "2"]) -> TurningMode:
    """Returns the mode in which what was held turns against the torque that held it: in rolling, in spinning."""
    rolls, spins = off[0], off[1]
    return mode._replace(
        sigma=jnp.where(rolls, in_three(-unit(torque[:2])), mode.sigma),
        spin=jnp.where(spins, -jnp.sign(torque[2]), mode.spin),
        rests=mode.rests & ~rolls,
        still=mode.still & ~spins,
    )


def along_growth(turning: Turning, mode: TurningMode, begins: Bool[Array, ""]) -> TurningMode:
    """Returns the mode in which the direction of rolling that ``begins`` is one in which ω_h grows."""

    def search(turning: Turning, mode: TurningMode) -> TurningMode:
        sigma = diverging(_pull, (turning, mode), jax.lax.stop_gradient(mode.sigma[:2])).sigma
        return mode._replace(sigma=in_three(sigma))

    return jax.lax.cond(begins, search, lambda _, mode: mode, turning, mode)


def _pull(about: tuple[Turning, TurningMode], sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    turning, mode = about
    acting = resist(turning, mode._replace(sigma=in_three(sigma)))
    return acting.w[:2], acting.normal
