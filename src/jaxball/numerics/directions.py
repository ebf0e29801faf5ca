"""Directions σ in a plane, as unit vectors, and the search for one along which a vector f(σ) points.

Slips and rolling begin in such directions.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..programs.batches import map_rows
from .calculus import with_second_derivatives
from .linear import inverse
from .roots import Sample, next_point, other_end

DIRECTIONS_SAMPLED = 24  # of directions between which one is sought
ILLINOIS_STEPS = 12  # of the Illinois method: errors below 1e-15 from brackets of a quarter
STEPS_OF_GROWTH, STEPS_TO_DIRECTION = 30, 8  # of Newton's method, for the growth alone and for the direction with it


class Direction(NamedTuple):
    """A direction σ in which a slip or rolling begins, and the rate at which it grows, which must be positive."""

    sigma: Float[Array, " n"]
    growth: Float[Array, ""]


def diverging(
    pull: Callable[[Any, Float[Array, "2"]], tuple[Float[Array, "2"], Float[Array, ""]]],
    about: Any,
    guess: Float[Array, "2"],
) -> Direction:
    """Finds the direction σ along which the vector ``pull(about, σ)`` points; of several, that of the longest vector.

    ``pull`` gives a vector for each σ, and a number that is positive where the vector means something; its first
    operand is ``about``, arrays with respect to which σ has first and second derivatives. ``guess`` need not be a unit
    vector; its direction is the result where it is right to rounding. Around the circle, the part of the vector across
    σ changes sign between two of 24 directions; a pair of zeros nearer to each other is not found.
    """

    @jax.jit
    def parts(about: Any, angle: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        sigma = _at_angle(angle)
        vector, valid = pull(about, sigma)
        return across(sigma, vector), jnp.where(valid > 0, jnp.sum(sigma * vector), -jnp.inf)

    # The search itself is not differentiated; steps of Newton's method at its end give the derivatives: with a fixed
    # slope the first step gives the first ones, and one more the second ones.
    still, guess = jax.lax.stop_gradient((about, guess))

    def turning(angle: Float[Array, ""]) -> Float[Array, ""]:
        return parts(still, angle)[0]

    start = _angle(guess)
    width = 2 * jnp.pi / DIRECTIONS_SAMPLED
    # Shifted by half a width, so that a right guess is in the middle of a bracket, and not at its edge.
    angles = start + width * (jnp.arange(DIRECTIONS_SAMPLED, dtype=guess.dtype) - 0.5)
    values = map_rows(turning, angles)
    ends = jnp.roll(values, -1)
    share = values / jnp.where(values == ends, 1.0, values - ends)
    _, along = map_rows(lambda angle: parts(still, angle), angles + width * jnp.clip(share, 0.0, 1.0))
    # The part across σ turns its sign where σ is parallel to the vector; along it must be largest.
    best = jnp.argmax(jnp.where((values > 0) != (ends > 0), along, -jnp.inf))
    old, new = Sample(angles[best], values[best]), Sample(angles[best] + width, ends[best])

    def narrow(_, bracket: tuple[Sample, Sample]) -> tuple[Sample, Sample]:
        newest = next_point(*bracket)
        sample = Sample(newest, turning(newest))
        return other_end(*bracket, sample), sample

    angle = jax.lax.fori_loop(0, ILLINOIS_STEPS, narrow, (old, new))[1].x
    # Newton's method moves it only by rounding, but provides its derivatives.
    value, slope = jax.jvp(turning, (angle,), (jnp.ones_like(angle),))
    # Without a slope there is no step, instead of a division by 0.
    slope = jnp.where(slope == 0, jnp.inf, slope)
    angle = angle - value / slope

    def step(about: Any, angle: Float[Array, ""], slope: Float[Array, ""]) -> Float[Array, ""]:
        return angle - parts(about, angle)[0] / slope

    def two_steps(about: Any, angle: Float[Array, ""], slope: Float[Array, ""]) -> Float[Array, ""]:
        return step(about, step(about, angle, slope), slope)

    operands = about, angle, slope
    angle = with_second_derivatives(step(*operands), "the direction in which a slip begins", two_steps, *operands)
    sigma = _at_angle(angle)
    vector, _ = pull(about, sigma)
    return Direction(sigma, jnp.sum(sigma * vector))


def growing(
    pull: Callable[[Any, Float[Array, " n"]], Float[Array, " n"]], about: Any, nothing: Float[Array, " n"]
) -> Direction:
    """Finds the direction σ along which ``pull(about, σ)`` points, of any dimension: where friction pulls against it.

    ``pull`` is defined for vectors of any length, and is nearly b − A σ with A symmetric and positive. Then (A + κ) σ =
    b, of which the growth κ that makes |σ| = 1 is unique, and positive where b exceeds what A can hold: Newton's method
    comes to it from below (J. J. Moré, D. C. Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983) 553–572). Steps of the same
    for both do the rest. σ has first and second derivatives with respect to ``about``; ``nothing`` is a zero vector.
    """
    still = jax.lax.stop_gradient(about)
    b, A = pull(still, nothing), -jax.jacfwd(lambda sigma: pull(still, sigma))(nothing)
    eye = jnp.eye(nothing.size, dtype=nothing.dtype)

    def grow(_: Array, kappa: Float[Array, ""]) -> Float[Array, ""]:
        resolvent = inverse(A + kappa * eye)
        sigma = jnp.sum(resolvent * b[None], axis=1)
        square, slope = jnp.sum(sigma**2), jnp.sum(sigma[:, None] * resolvent * sigma[None])
        grown = kappa + (jnp.sqrt(square) - 1) * square / jnp.where(slope > 0, slope, jnp.inf)
        return jnp.maximum(grown, 0.0)

    kappa = jax.lax.fori_loop(0, STEPS_OF_GROWTH, grow, jnp.zeros_like(nothing[0]))
    start = jnp.append(unit(jnp.sum(inverse(A + kappa * eye) * b[None], axis=1)), kappa)

    def misses(about: Any, x: Float[Array, " size"]) -> Float[Array, " size"]:
        sigma = x[:-1]
        return jnp.append(pull(about, sigma) - x[-1] * sigma, 0.5 * (jnp.sum(sigma**2) - 1))

    def slopes(x: Float[Array, " size"]) -> Float[Array, "size size"]:
        return inverse(jax.jacfwd(lambda x: misses(still, x))(x))

    def step(about: Any, x: Float[Array, " size"], slope: Float[Array, "size size"]) -> Float[Array, " size"]:
        moved = x - jnp.sum(slope * misses(about, x)[None], axis=1)
        return jnp.where(jnp.all(jnp.isfinite(moved)), moved, x)

    def two_steps(about: Any, x: Float[Array, " size"], slope: Float[Array, "size size"]) -> Float[Array, " size"]:
        return step(about, step(about, x, slope), slope)

    x = jax.lax.fori_loop(0, STEPS_TO_DIRECTION, lambda _, x: step(still, x, slopes(x)), start)
    # The last step moves it only by rounding, but provides its derivatives.
    operands = about, x, slopes(x)
    x = with_second_derivatives(step(*operands), "the direction in which a slip begins", two_steps, *operands)
    return Direction(x[:-1], x[-1])


def perpendicular(sigma: Float[Array, " n"], vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """Computes the part of a vector perpendicular to σ."""
    if sigma.size == 2:
        return across(sigma, vector) * turn_left(sigma)
    return vector - jnp.sum(sigma * vector) * sigma


def across(sigma: Float[Array, "2"], vector: Float[Array, "size"]) -> Float[Array, ""]:
    """Computes the component of a vector perpendicular to σ, positive to its left."""
    return sigma[0] * vector[1] - sigma[1] * vector[0]


def unit(sigma: Float[Array, " n"]) -> Float[Array, " n"]:
    """Returns σ with length 1; 0 for 0."""
    square = jnp.sum(sigma**2)
    # The slope of the root at 0 is infinite, also in the branch that `where` does not take.
    return sigma / jnp.sqrt(jnp.where(square > 0, square, 1.0))


def turn_left(sigma: Float[Array, "2"]) -> Float[Array, "2"]:
    """Returns σ turned by a right angle."""
    return jnp.stack([-sigma[1], sigma[0]])


def _angle(sigma: Float[Array, "2"]) -> Float[Array, ""]:
    """Computes the angle of a direction; 0 where σ is 0."""
    some = jnp.sum(sigma**2) > 0
    # arctan2 has no derivatives at the origin.
    return jnp.where(some, jnp.arctan2(sigma[1], jnp.where(some, sigma[0], 1.0)), 0.0)


def _at_angle(angle: Float[Array, ""]) -> Float[Array, "2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])
