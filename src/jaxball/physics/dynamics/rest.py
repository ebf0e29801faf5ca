"""Exact dry friction against the turning of a body over its plane: the torque that brakes it, or holds it at rest.

``equations`` adds the torque; ``contact.holding`` asks whether it can hold the body.

Without it, ω has some rate and the plane presses with some normal force, and a torque T at the contact adds to both in
proportion: these are the rows of ``law``. Where the body rolls and spins, T is −N r times the coefficients and the
directions of ω_h and ω₃; where friction holds one of these, T is what gives it its rate. All vectors are along the axes
of the contact, and ω is relative to the ground.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...numerics.directions import diverging, unit
from ...numerics.vectors import in_three, root
from ...programs.derivatives.differentiation import without_derivatives
from ..forces.resistance import Resistance
from .law import Acting, Law, Rows, load, release

ROUNDING = 64  # of a rate, in units of rounding: what is smaller is none
TORQUES = 32  # of a torque, in units of rounding of the torque that it is compared with: a smaller one is none


class TurningMode(NamedTuple):
    """How a body turns over its ground where dry friction is exact, as a solve knows it, along the axes of the contact.

    - ``sigma``: the direction of ω_h, shape (3,); 0 where the body rests.
    - ``spin``: 1 or −1, the sign of ω₃; 0 where the body does not spin.
    - ``rests``: whether friction holds ω_h. ``still``: whether friction holds ω₃.
    - ``braking``: the rate that ω_h has where friction holds it, shape (3,): 0 but at the end of rolling.
    """

    sigma: Float[Array, "3"]
    spin: Float[Array, ""]
    rests: Bool[Array, ""]
    still: Bool[Array, ""]
    braking: Float[Array, "3"]


class Turning(NamedTuple):
    """How a body turns: ``rows`` has the torque for its amounts, and the rate of ω for what comes with them.

    ``radius`` is r.
    """

    rows: Rows
    radius: Float[Array, ""]


class TurningLaw(NamedTuple):
    """What a mode of turning gives, as in ``law``: where the rate is given, not the torque, which part, and by N."""

    solved: Bool[Array, "3"]
    value: Float[Array, "3"]
    push: Float[Array, "3"]

    @classmethod
    def none(cls, like: Float[Array, "3"]) -> "TurningLaw":
        """Returns that of a body whose turning no dry friction resists."""
        nothing = jnp.zeros_like(like)
        return cls(jnp.zeros(3, bool), nothing, nothing)

    @classmethod
    def of(cls, resistance: Resistance, r: Float[Array, ""], mode: TurningMode) -> "TurningLaw":
        """Returns what exact dry friction gives in a mode."""
        torque = jnp.zeros_like(mode.sigma)
        if resistance.dry is not None:
            torque = torque - resistance.dry * r * mode.sigma
        if resistance.dry_spinning is not None:
            torque = torque.at[2].add(-resistance.dry_spinning * r * mode.spin)
        solved = jnp.stack([mode.rests, mode.rests, mode.still])
        return cls(solved, jnp.where(solved, mode.braking, 0.0), jnp.where(solved, 0.0, torque))


def resist(resistance: Resistance, turning: Turning, mode: TurningMode) -> Acting:
    """Computes what exact dry friction does in a mode. Where N would be negative without it, it only holds."""
    law = TurningLaw.of(resistance, turning.radius, mode)
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


def needs(resistance: Resistance, r: Float[Array, ""], torque: Float[Array, "3"], normal: Float[Array, ""]) -> Needs:
    """Returns whether friction can hold the body as it does: what it has to spare is positive as long as it can."""
    spare, loads = [], []
    for level, square in (
        (resistance.dry, jnp.sum(torque[:2] ** 2)),
        (resistance.dry_spinning, torque[2] ** 2),
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


def mode_of(resistance: Resistance, turning: Turning, omega: Float[Array, "3"], planar: bool) -> TurningMode:
    """Returns the mode that follows from ω: held at rest if friction can do it."""
    candidate = candidates(resistance, omega, planar)
    still = without_derivatives((resistance, turning, candidate))
    mode = begin(*still, planar)
    rolls = jnp.sum(candidate.sigma**2) > 0
    return mode._replace(sigma=jnp.where(rolls, candidate.sigma, mode.sigma))


def candidates(resistance: Resistance, omega: Float[Array, "3"], planar: bool) -> TurningMode:
    """Returns the mode of a body where friction holds all that does not move, whether it can or not."""
    # A disk turns about the second axis alone.
    rolling, spin = jnp.where(np.array([planar, False]), 0.0, omega[:2]), 0 * omega[2] if planar else omega[2]
    least = jax.lax.stop_gradient(ROUNDING * float(jnp.finfo(omega.dtype).eps) * root(jnp.sum(omega**2)))
    rolls, spins = jnp.sum(rolling**2) > least**2, jnp.abs(spin) > least
    sigma = in_three(jnp.where(rolls, unit(rolling), 0.0))
    rests = ~rolls & (resistance.dry is not None)
    still = ~spins & (resistance.dry_spinning is not None and not planar)
    return TurningMode(sigma, jnp.where(spins, jnp.sign(spin), 0.0), rests, still, jnp.zeros_like(omega))


def begin(
    resistance: Resistance,
    turning: Turning,
    mode: TurningMode,
    planar: bool,
    rolls: Bool[Array, ""] | bool = False,
    spins: Bool[Array, ""] | bool = False,
) -> TurningMode:
    """Releases whatever friction cannot hold, the more overloaded first.

    ``rolls`` and ``spins`` say that it lets go at once of rolling and of spinning, if they are held. What is let go
    turns against the torque that held it; and a ball rolls in the direction in which ω_h grows.
    """

    def weigh(mode: TurningMode) -> tuple[Float[Array, "2"], Float[Array, "3"]]:
        acting = resist(resistance, turning, mode)
        need = needs(resistance, turning.radius, acting.amounts, acting.normal)
        return need.overloads(mode), acting.amounts

    first, at_once = mode.rests, jnp.stack([mode.rests & rolls, mode.still & spins])
    mode = release(mode, weigh, let_go, at_once)
    return mode if planar or resistance.dry is None else along_growth(resistance, turning, mode, first & ~mode.rests)


def let_go(mode: TurningMode, torque: Float[Array, "3"], off: Bool[Array, "2"]) -> TurningMode:
    """Returns the mode in which what was held turns against the torque that held it: in rolling, in spinning."""
    rolls, spins = off[0], off[1]
    return mode._replace(
        sigma=jnp.where(rolls, in_three(-unit(torque[:2])), mode.sigma),
        spin=jnp.where(spins, -jnp.sign(torque[2]), mode.spin),
        rests=mode.rests & ~rolls,
        still=mode.still & ~spins,
    )


def along_growth(resistance: Resistance, turning: Turning, mode: TurningMode, begins: Bool[Array, ""]) -> TurningMode:
    """Returns the mode in which the direction of rolling that ``begins`` is one in which ω_h grows."""

    def search(resistance: Resistance, turning: Turning, mode: TurningMode) -> TurningMode:
        about = resistance, turning, mode
        sigma = diverging(_pull, about, jax.lax.stop_gradient(mode.sigma[:2])).sigma
        return mode._replace(sigma=in_three(sigma))

    return jax.lax.cond(begins, search, lambda _, __, mode: mode, resistance, turning, mode)


def _pull(
    about: tuple[Resistance, Turning, TurningMode], sigma: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    resistance, turning, mode = about
    acting = resist(resistance, turning, mode._replace(sigma=in_three(sigma)))
    return acting.w[:2], acting.normal
