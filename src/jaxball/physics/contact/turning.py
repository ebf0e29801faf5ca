"""How a body turns over its ground where exact dry resistance may hold it against rolling or spinning.

It rolls in the direction of ω_h until that vanishes, and rests until the torque that holds it exceeds the largest one;
spinning, ω₃, has a mode of rest of its own. All vectors are in contact axes: on a plane those of space.

The direction of rolling is ω_h/|ω_h|, which cannot be computed where a ball begins to roll or comes to rest: ``slip``
says what is done there. A disk has two directions, which its state knows.
"""

import dataclasses
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.vectors import root
from ..dynamics.rest import Needs
from ..hybrid import Accuracy, GuardedStep
from . import slip as slips
from .slip import Heading
from .window import Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

SLOW_TURNING = 0.4  # as slip.SLOW, for rolling, which is followed to its end with what acts halfway
ERRORS = 50  # tolerances: how fast a ball may roll to and fro by the errors of a method of low order
LONGEST_WAY = 10  # in tolerances: the angle over which a ball is followed to its rest however long that takes, ...
STEADY_RESPONSE = 0.2  # ... if what acts halfway changes the time until then by no more than this share


def heading_of_rolling(plane: "BodyOnPlane", t: Float[Array, ""], state: Any, accuracy: Accuracy) -> Heading:
    """Returns the direction of rolling as a step begins; a disk may roll however slowly."""
    sigma, omega = plane.direction(t, state), plane.over_ground(t, state)
    size = root(jnp.sum(omega**2))
    g, r, rate = jax.lax.stop_gradient((jnp.abs(plane.body.gravity), plane.body.radius, size))
    heading = Heading.of(sigma, omega[:2], root(g / r) + rate, accuracy.atol + accuracy.rtol * size, SLOW_TURNING)
    # The direction of a disk's rolling does not turn as that ends, so nothing has to stop short of zero.
    return heading._replace(least=jnp.zeros_like(heading.least)) if plane.body.planar else heading


def guards_of_turning(
    plane: "BodyOnPlane", t: Float[Array, ""], state: Any, spare: Needs, heading: Heading
) -> Float[Array, "2"]:
    """Computes the rate in the direction of rolling, and of spinning, or what friction that holds has to spare."""
    omega = plane.over_ground(t, state)
    # A guard that the body does not have is always positive.
    rolling = spinning = jnp.ones_like(state.rolls)
    if plane.resists_rolling:
        forward = jnp.sum(omega[:2] * heading.sigma) - heading.least
        rolling = jnp.where(state.rolls == 0, spare.rolling, forward)
    if plane.resists_spinning:
        spinning = jnp.where(state.spin == 0, spare.spinning, state.spin * omega[2])
    return jnp.stack([rolling, spinning])


def comes_to_rest(
    plane: "BodyOnPlane", first: slips.End, second: slips.End, omega: Float[Array, "2"], tolerance: Float[Array, ""]
) -> Bool[Array, ""]:
    """Returns whether a ball that rolls slowly, with ω_h over the ground, has come to rest at its ``first`` end.

    Where resistance is hardly enough to hold it, a ball no faster than the errors of its speed takes long to stop.
    It does all the same, if it turns little until then, and if what acts halfway, by which its end is the
    ``second``, is much the same.
    """
    is_soon = first.time <= slips.longest_pause(tolerance, slips.unit_of_time(plane.body))
    is_short = root(jnp.sum(omega**2)) * first.time <= LONGEST_WAY * tolerance
    is_steady = second.comes & (jnp.abs(second.time - first.time) <= STEADY_RESPONSE * first.time)
    return first.comes & (is_soon | (is_short & is_steady))


def follow_rolling(
    plane: "BodyOnPlane", t: Float[Array, ""], before: Any, state: Any, tolerance: Float[Array, ""]
) -> tuple[Course, Bool[Array, ""]]:
    """Returns how a ball rolls, and whether it does although its direction is not known beforehand.

    - ``before``: the state before an event, by whose window the direction may be known at its end.
    """
    omega, sigma = plane.over_ground(t, state), plane.direction(t, before)
    course = Course(sigma, jnp.sum(sigma * omega[:2]), before.rolling.next_span(t))
    size = _unit_of_rate(plane) + root(jnp.sum(omega**2))
    rolls = (state.rolls != 0) & (before.rolls != 0) & (state.rolling.until <= t) & plane.resists_rolling
    return course, rolls & course.is_that_of(omega[:2], size, tolerance)


def along_rolling(plane: "BodyOnPlane", t: Float[Array, ""], state: Any, course: Course) -> Any:
    """Returns the state with ω_h exactly along its direction, without the errors of the solve across it."""
    omega = plane.over_ground(t, state).at[:2].set(course.slip)
    Omega = plane.contact_axes(t, state).in_body(omega)
    return dataclasses.replace(state, body=state.body.with_Omega(Omega))


def _unit_of_rate(plane: "BodyOnPlane") -> Float[Array, ""]:
    """Computes √(g/r)."""
    return root(jax.lax.stop_gradient(jnp.abs(plane.body.gravity) / plane.body.radius))


def approach_rest(
    plane: "BodyOnPlane", step: GuardedStep, heading: Heading, guard: int, accuracy: Accuracy
) -> tuple[Bool[Array, ""], Bool[Array, ""], Float[Array, ""]]:
    """Returns whether a ball that rolls is slow, whether it may come to its end, and the longest next step.

    - ``guard``: the index of the guard of rolling.
    """
    least, omega = heading.least, plane.over_ground(step.end, step.state)
    # Within the errors of the method the ball rolls to and fro, so that it may never be as slow as ``least``.
    slowest = least + ERRORS * (accuracy.atol + accuracy.rtol * root(jnp.sum(omega**2)))
    slow = root(jnp.sum(omega[:2] ** 2)) <= 2 * slowest
    before, after = step.guards[guard, 0] + least, step.guards[guard, -1] + least
    nears = slow & slips.nears_its_end(before, after, slowest)
    return slow, nears, slips.longest_step(before, after, least, step.end - step.start, accuracy)
