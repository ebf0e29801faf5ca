"""The force of the plane on a body that rolls, slides or flies, and when it switches between these.

Coulomb's law: a plane that presses with N > 0 holds a body that does not slip by any friction |f| ≤ μ N, with the
static coefficient; on one that slips with v_s friction is −μ N σ with σ = v_s/|v_s|, with the sliding coefficient. All
forces and accelerations are in space axes, and follow from the ``Response`` of the body.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.batches import map_rows
from ...numerics.bracketing import Sample, between, other_end
from ...numerics.vectors import apply, root
from .released import Response

SAMPLES = 24  # of directions between which one is sought
STEPS = 12  # of the Illinois method: errors below 1e-15 from brackets of a quarter


class Interaction(NamedTuple):
    """The reaction R of the plane, and the slip acceleration v̇_s that it leaves.

    ``normal`` is the normal force with which dry rolling friction is computed. ``solvability`` is the upward
    acceleration by a unit of normal force with its friction, relative to that without friction: where it is not
    positive, the normal force has no solution (Painlevé's paradox), and these numbers mean nothing.
    """

    R: Float[Array, "3"]
    slip_acceleration: Float[Array, "3"]
    normal: Float[Array, ""]
    solvability: Float[Array, ""]


def rolling(found: Response) -> Interaction:
    """The reaction that keeps v_s constant, whatever friction it needs; without dry rolling friction where N < 0."""
    R, still = found.rolling.reaction, jnp.zeros_like(found.free)
    if found.rubbing is None:
        return Interaction(R, still, jnp.maximum(R[2], 0.0), jnp.ones_like(R[2]))
    solvability = 1 - found.rubbing.reaction[2]
    N = jnp.maximum(R[2], 0.0) / jnp.where(solvability > 0, solvability, jnp.nan)
    return Interaction(found.reaction(still, N), still, N, solvability)


@jax.jit
def sliding(found: Response, mu: Float[Array, ""], direction: Float[Array, "2"]) -> Interaction:
    """R = N (e3 − μσ), with N so that the body stays on the plane; ``direction`` is σ and ``mu`` the coefficient.

    N = −v̇_free,3 / (D₃₃ − μ D₃·σ − D₃·ρ), where ρ is the reaction that the dry rolling torque of a unit of N has.
    """
    pushed = push(mu, direction)
    net = pushed if found.rubbing is None else pushed - found.rubbing.reaction
    moved, D33 = apply(found.delassus, net), found.delassus[2, 2]
    N = -found.free[2] / jnp.where(moved[2] == 0, D33, moved[2])
    acceleration = (found.free + N * moved).at[2].set(0.0)  # without what rounding leaves
    return Interaction(N * pushed, acceleration, N, moved[2] / D33)


def flight(found: Response) -> Interaction:
    """No reaction; ``found`` is the response of a body that does not touch the plane."""
    none = jnp.zeros_like(found.free[2])
    return Interaction(jnp.zeros_like(found.free), found.free, none, jnp.ones_like(none))


def margin(R: Float[Array, "3"], mu: Float[Array, ""]) -> Float[Array, ""]:
    """μ N − |f|, the friction that is left; negative outside the cone. Its derivative by f is 0 where f is 0."""
    return mu * R[2] - root(jnp.sum(R[:2] ** 2))


def slip_direction(slip: Float[Array, "3"], otherwise: Float[Array, "2"]) -> Float[Array, "2"]:
    """σ = v_s/|v_s|; ``otherwise`` where the body does not slip, with no derivative by v_s there."""
    square = jnp.sum(slip[:2] ** 2)
    slips = square > 0
    return jnp.where(slips, slip[:2] / jnp.sqrt(jnp.where(slips, square, 1.0)), otherwise)


class Direction(NamedTuple):
    """A direction σ in which a slip begins, and the rate at which it grows, which must be positive."""

    sigma: Float[Array, "2"]
    growth: Float[Array, ""]


def first_slip(found: Response, mu: Float[Array, ""]) -> Direction:
    """The direction in which a body begins to slip when friction cannot hold it: the tangential v̇_s = κσ with κ > 0.

    ``mu`` is the sliding coefficient. Where D is isotropic, σ is opposite to the friction that rolling would need; so
    it is at the brink, |f| = μ N. Where the growth κ is not positive, friction holds the body, or nothing does.
    """

    def pull(about: tuple[Response, Array], sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        along = sliding(*about, sigma)
        return along.slip_acceleration[:2], along.solvability

    return diverging(pull, (found, mu), -rolling(found).R[:2])


def diverging(
    pull: Callable[[Any, Float[Array, "2"]], tuple[Float[Array, "2"], Float[Array, ""]]],
    about: Any,
    guess: Float[Array, "2"],
) -> Direction:
    """The direction σ in which ``pull`` of it points, of several that in which it pulls most.

    ``pull`` gives a vector for each σ, and a number that is positive where the vector means something; its first
    operand is ``about``, arrays with respect to which σ has first derivatives. ``guess`` need not be a unit vector; its
    direction is the result where it is right to rounding. Around the circle, the part of the vector across σ changes
    sign between two of 24 directions; a pair of zeros nearer to each other is not found.
    """

    @jax.jit
    def parts(about: Any, angle: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        sigma = _at_angle(angle)
        vector, valid = pull(about, sigma)
        return across(sigma, vector), jnp.where(valid > 0, jnp.sum(sigma * vector), -jnp.inf)

    still, guess = jax.lax.stop_gradient((about, guess))

    def turning(angle: Float[Array, ""]) -> Float[Array, ""]:
        return parts(still, angle)[0]

    start = _angle(guess)
    width = 2 * jnp.pi / SAMPLES
    angles = start + width * (jnp.arange(SAMPLES, dtype=guess.dtype) - 0.5)
    found = map_rows(turning, angles)
    ends = jnp.roll(found, -1)
    share = found / jnp.where(found == ends, 1.0, found - ends)
    _, along = map_rows(lambda angle: parts(still, angle), angles + width * jnp.clip(share, 0.0, 1.0))
    best = jnp.argmax(jnp.where((found > 0) != (ends > 0), along, -jnp.inf))
    old, new = Sample(angles[best], found[best]), Sample(angles[best] + width, ends[best])

    def narrowed(_, bracket: tuple[Sample, Sample]) -> tuple[Sample, Sample]:
        newest = between(*bracket)
        sample = Sample(newest, turning(newest))
        return other_end(*bracket, sample), sample

    angle = jax.lax.fori_loop(0, STEPS, narrowed, (old, new))[1].x
    # Newton's method moves it only by rounding, but provides its derivatives.
    value, slope = jax.jvp(turning, (angle,), (jnp.ones_like(angle),))
    slope = jnp.where(slope == 0, jnp.inf, slope)
    angle = angle - value / slope
    sigma = _at_angle(angle - parts(about, angle)[0] / slope)
    vector, _ = pull(about, sigma)
    return Direction(sigma, jnp.sum(sigma * vector))


def push(mu: Float[Array, ""], direction: Float[Array, "2"]) -> Float[Array, "3"]:
    """e3 − μσ."""
    return jnp.concatenate([-mu * direction, jnp.ones_like(direction[:1])])


def across(sigma: Float[Array, "2"], vector: Float[Array, "size"]) -> Float[Array, ""]:
    """The component of a vector perpendicular to σ, positive to its left."""
    return sigma[0] * vector[1] - sigma[1] * vector[0]


def unit(sigma: Float[Array, "2"]) -> Float[Array, "2"]:
    """σ with length 1; 0 of 0."""
    square = jnp.sum(sigma**2)
    return sigma / jnp.sqrt(jnp.where(square > 0, square, 1.0))


def left(sigma: Float[Array, "2"]) -> Float[Array, "2"]:
    """σ turned by a right angle."""
    return jnp.stack([-sigma[1], sigma[0]])


def _angle(sigma: Float[Array, "2"]) -> Float[Array, ""]:
    """The angle of a direction; 0 of none."""
    some = jnp.sum(sigma**2) > 0
    return jnp.where(some, jnp.arctan2(sigma[1], jnp.where(some, sigma[0], 1.0)), 0.0)


def _at_angle(angle: Float[Array, ""]) -> Float[Array, "2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])
