"""Exact dry friction against the turning of a body over its plane: the torque that brakes it, or holds it at rest.

``equations`` adds the torque; ``dry_rolling`` and the contact ask whether it can hold the body.

Without it, ω has some rate and the plane presses with some normal force, and a torque T at the contact adds to both in
proportion: ω̇ = ω̇₀ + G T, N = N₀ + ν·T. Where the body rolls and spins, T is −N r times the coefficients and the
directions of ω_h and ω₃; where friction holds one of these, T is what gives it its rate, 0. With P the projector onto
what is held and K = P (P G P + 1 − P)⁻¹ P, the inertia that it has,

    T = K (ω̇_held − ω̇₀) + N (d − K G d)

where d is the torque of a unit of N on what moves. N follows from this as for smoothed friction. All vectors are in
body axes, or all in space axes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.directions import diverging
from ...numerics.linear import product
from ...numerics.vectors import apply, cross, dot, inverse, outer, root
from ...programs.derivatives.differentiation import without_derivatives
from ..forces.resistance import Resistance, TurningMode

ROUNDING_OF_RATE = 64  # of a rate, in units of rounding: what is smaller is none
TORQUES = 32  # of a torque, in units of rounding of the torque that it is compared with: a smaller one is none


class Turning(NamedTuple):
    """How a body turns without dry friction at its contact, and with it: ``rate`` and ``normal`` are ω̇₀ and N₀.

    ``up`` is the normal of the plane. A disk only turns about ``axle``, which is None for a ball. ``compliance`` is G
    and ``lift`` ν. ``radius`` is r.
    """

    up: Float[Array, "3"]
    axle: Float[Array, "3"] | None
    rate: Float[Array, "3"]
    compliance: Float[Array, "3 3"]
    normal: Float[Array, ""]
    lift: Float[Array, "3"]
    radius: Float[Array, ""]

    @property
    def plane(self) -> Float[Array, "3 3"]:
        """The projector onto the directions that ω_h may have."""
        if self.axle is not None:
            return outer(self.axle, self.axle)
        return jnp.eye(3, dtype=self.up.dtype) - outer(self.up, self.up)

    def in_space(self, Lambda: Float[Array, "3 3"]) -> "Turning":
        """Converts the turning from body axes to space axes."""
        rate, lift = apply(Lambda, self.rate), apply(Lambda, self.lift)
        _, across, up = jnp.eye(3, dtype=rate.dtype)  # exactly, as a product with Λ would not be
        half = jnp.sum(Lambda[:, None, :] * self.compliance.T[None], axis=-1)
        G = jnp.sum(half[:, None, :] * Lambda[None], axis=-1)
        axle = None if self.axle is None else across
        return Turning(up, axle, rate, G, self.normal, lift, self.radius)


class Resisted(NamedTuple):
    """The dry ``torque`` T, the ``rate`` ω̇ and the ``normal`` force N that a body has with it."""

    torque: Float[Array, "3"]
    rate: Float[Array, "3"]
    normal: Float[Array, ""]


def resist(resistance: Resistance, turning: Turning, mode: TurningMode) -> Resisted:
    """Computes what exact dry friction does in a mode. Where N would be negative without it, it only holds."""
    G, d, hold = turning.compliance, drag(resistance, turning, mode), Hold.of(turning, mode)
    still = hold(mode.braking - turning.rate)
    by_normal = d - hold(apply(G, d))
    slope = dot(turning.lift, by_normal)
    without = turning.normal + dot(turning.lift, still)
    # Dry friction would drive the body if N were negative. Where a unit of N adds more than itself to N, there is no
    # solution, and NaN ends the run.
    N = jnp.maximum(without, 0.0) / jnp.where(slope < 1, 1 - slope, jnp.nan)
    torque = still + N * by_normal
    return Resisted(torque, turning.rate + apply(G, torque), jnp.where(without > 0, N, without))


def drag(resistance: Resistance, turning: Turning, mode: TurningMode) -> Float[Array, "3"]:
    """Computes d, the torque of a unit of N on what moves."""
    r, up = turning.radius, turning.up
    d = jnp.zeros_like(up)
    if resistance.dry is not None:
        d = d - resistance.dry * r * jnp.where(mode.rests, 0.0, mode.sigma)
    if resistance.dry_spinning is not None and turning.axle is None:
        d = d - resistance.dry_spinning * r * jnp.where(mode.still, 0.0, mode.spin) * up
    return d


class Hold(NamedTuple):
    """The product with K: ``held`` is P, and ``stiffness`` (P G P + 1 − P)⁻¹."""

    held: Float[Array, "3 3"]
    stiffness: Float[Array, "3 3"]

    @classmethod
    def of(cls, turning: Turning, mode: TurningMode) -> "Hold":
        """Builds P and the stiffness that belong to a mode."""
        up = turning.up
        held = jnp.where(mode.rests, turning.plane, 0.0) + jnp.where(mode.still, outer(up, up), 0.0)
        moving = jnp.eye(3, dtype=up.dtype) - held
        return cls(held, inverse(product(held, product(turning.compliance, held)) + moving))

    def __call__(self, rate: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns K times a rate."""
        return apply(self.held, apply(self.stiffness, apply(self.held, rate)))


class Needs(NamedTuple):
    """What holds a body: ``rolling`` and ``spinning``, each the square of the largest torque, less that of the torque.

    The latter are ``loads``, as shares of the former. Largest torques are 0 or less without a normal force.
    """

    rolling: Float[Array, ""]
    spinning: Float[Array, ""]
    loads: Float[Array, "2"]


def needs(resistance: Resistance, turning: Turning, acting: Resisted) -> Needs:
    """Returns whether friction can hold the body as it does: what it has to spare is positive as long as it can."""
    tangential, vertical = apply(turning.plane, acting.torque), dot(turning.up, acting.torque)
    spare, loads = [], []
    for level, square in ((resistance.dry, dot(tangential, tangential)), (resistance.dry_spinning, vertical**2)):
        largest = jnp.zeros_like(acting.normal) if level is None else level * turning.radius * acting.normal
        limits = jnp.finfo(largest.dtype)
        size = jax.lax.stop_gradient(root(square) + jnp.abs(largest))
        slack = TORQUES * float(limits.eps) * size + float(limits.tiny) ** 0.25
        # |T| ≤ largest with both sides squared, because |T| has no derivative where it is 0; a negative largest torque,
        # where the plane would have to pull, keeps its sign.
        spare.append(largest * jnp.abs(largest) - square + slack**2 + 2 * slack * size)
        loads.append(square / jnp.maximum(largest, float(limits.tiny) ** 0.25) ** 2)
    return Needs(spare[0], spare[1], jnp.stack(loads))


def mode_of(resistance: Resistance, turning: Turning, omega: Float[Array, "3"]) -> TurningMode:
    """Returns the mode that a solve knows, or else the one that follows from ω: held at rest if friction can do it."""
    if resistance.mode is not None:
        return resistance.mode
    candidate = candidates(resistance, turning, omega)
    still = without_derivatives((resistance, turning, candidate))
    mode = begin(*still)
    rolls = dot(candidate.sigma, candidate.sigma) > 0
    return mode._replace(sigma=jnp.where(rolls, candidate.sigma, mode.sigma))


def candidates(resistance: Resistance, turning: Turning, omega: Float[Array, "3"]) -> TurningMode:
    """Returns the mode of a body where friction holds all that does not move, whether it can or not."""
    spin = dot(turning.up, omega)
    rolling = apply(turning.plane, omega) if turning.axle is not None else omega - spin * turning.up
    least = jax.lax.stop_gradient(ROUNDING_OF_RATE * float(jnp.finfo(omega.dtype).eps) * root(dot(omega, omega)))
    rolls, spins = dot(rolling, rolling) > least**2, jnp.abs(spin) > least
    sigma = jnp.where(rolls, rolling / jnp.sqrt(jnp.where(rolls, dot(rolling, rolling), 1.0)), 0.0)
    rests = ~rolls & (resistance.dry is not None)
    still = ~spins & (resistance.dry_spinning is not None and turning.axle is None)
    return TurningMode(sigma, jnp.where(spins, jnp.sign(spin), 0.0), rests, still, jnp.zeros_like(omega))


def begin(
    resistance: Resistance,
    turning: Turning,
    mode: TurningMode,
    rolls: Bool[Array, ""] | bool = False,
    spins: Bool[Array, ""] | bool = False,
) -> TurningMode:
    """Releases whatever friction cannot hold, the more overloaded first.

    ``rolls`` and ``spins`` say that it lets go at once of rolling and of spinning, if they are held. What is let go
    turns against the torque that held it; and a ball rolls in the direction in which ω_h grows.
    """
    first = mode.rests
    mode = _let_go(turning, mode, resist(resistance, turning, mode), mode.rests & rolls, mode.still & spins)
    # Letting go of one changes the load of the other.
    for _ in range(2):
        acting = resist(resistance, turning, mode)
        need = needs(resistance, turning, acting)
        falls, slips = mode.rests & ~(need.rolling > 0), mode.still & ~(need.spinning > 0)
        more = need.loads[0] >= need.loads[1]
        mode = _let_go(turning, mode, acting, falls & (more | ~slips), slips & (~more | ~falls))
    if turning.axle is not None or resistance.dry is None:
        return mode
    return jax.lax.cond(first & ~mode.rests, _along_growth, lambda _, __, mode: mode, resistance, turning, mode)


def _let_go(
    turning: Turning, mode: TurningMode, acting: Resisted, rolls: Bool[Array, ""], spins: Bool[Array, ""]
) -> TurningMode:
    """Returns the mode in which what was held turns against the torque that held it."""
    against = -apply(turning.plane, acting.torque)
    square = dot(against, against)
    sigma = jnp.where(rolls, against / jnp.sqrt(jnp.where(square > 0, square, 1.0)), mode.sigma)
    spin = jnp.where(spins, -jnp.sign(dot(turning.up, acting.torque)), mode.spin)
    return TurningMode(sigma, spin, mode.rests & ~rolls, mode.still & ~spins, mode.braking)


def _along_growth(resistance: Resistance, turning: Turning, mode: TurningMode) -> TurningMode:
    """Returns the mode in which the direction of rolling is one in which ω_h grows."""
    about = resistance, turning, mode
    guess = jnp.stack([dot(axis, mode.sigma) for axis in axes(turning.up)])
    sigma = diverging(_pull, about, jax.lax.stop_gradient(guess)).sigma
    return with_direction(turning, mode, sigma)


def _pull(
    about: tuple[Resistance, Turning, TurningMode], sigma: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    resistance, turning, mode = about
    acting = resist(resistance, turning, with_direction(turning, mode, sigma))
    return jnp.stack([dot(axis, acting.rate) for axis in axes(turning.up)]), acting.normal


def with_direction(turning: Turning, mode: TurningMode, sigma: Float[Array, "2"]) -> TurningMode:
    """Returns the mode of a body that rolls in the direction with these components along :func:`axes`."""
    first, second = axes(turning.up)
    return mode._replace(sigma=sigma[0] * first + sigma[1] * second)


def axes(up: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Returns two unit vectors along the plane; e1 and e2 in space axes."""
    # The axis that is most nearly along the plane, so that its projection on it is not short.
    small = jnp.argmin(jnp.abs(up))
    axis = jnp.where(jnp.arange(3) == small, 1.0, 0.0).astype(up.dtype)
    first = axis - dot(axis, up) * up
    first = first / root(dot(first, first))
    return first, cross(up, first)
