"""What ``resting`` and ``modes.held`` share: a body that exact dry resistance may hold against rolling or spinning.

With a law of contact (``resting``) or without (``modes.held``), it rolls in the direction of ω_h until that vanishes,
and rests until the torque that holds it exceeds the largest one; spinning, ω₃, has a mode of rest of its own. All
vectors are in contact axes: on a plane those of space.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics.directions import unit
from ...numerics.vectors import root
from ..body import AbstractBodyWithModes
from ..dynamics.footing import ContactAxes, in_three
from ..dynamics.rest import Needs
from ..forces.resistance import Resistance, TurningMode
from ..hybrid import Accuracy, GuardedStep
from . import slip as slips
from .slip import Heading
from .window import Course

SLOW_TURNING = 0.4  # as slip.SLOW, for rolling, which is followed to its end with what acts halfway
ERRORS_OF_ROLLING = 50  # tolerances: how fast a ball may roll to and fro by the errors of a method of low order
LONGEST_WAY = 10  # in tolerances: the angle over which a ball is followed to its rest however long that takes, ...
STEADY_RESPONSE = 0.2  # ... if what acts halfway changes the time until then by no more than this share


class AbstractTurning(AbstractBodyWithModes[Any]):
    """A ball or a disk that exact dry resistance may hold at rest.

    Its states have, besides their ``body``,

    - ``rolls``: 0 where dry resistance holds the body against rolling, else 1.
    - ``spin``: the sign of ω₃ where friction acts against spinning; 0 where it holds it, and where there is none.
    - ``rolling``: the direction in which a ball has just begun to roll; that in which a disk rolls.
    """

    def over_ground(self, t: Float[Array, ""], state: Any) -> Float[Array, "3"]:
        """Computes ω of the body relative to the ground, along the axes of the contact."""
        return self.contact_axes(t, state).over_ground(state.body.Omega)

    @abstractmethod
    def contact_axes(self, t: Float[Array, ""], state: Any) -> ContactAxes:
        """Returns the axes of the contact at a state."""

    def direction(self, t: Float[Array, ""], state: Any) -> Float[Array, "2"]:
        """Computes the direction of ω_h of a body that rolls, contact axes."""
        if self.body.planar:
            return state.rolling.sigma
        omega = self.over_ground(t, state)
        return jnp.where(t <= state.rolling.until, state.rolling.direction(t), unit(omega[:2]))

    @property
    def resistance(self) -> Resistance:
        """The exact resistance."""
        resistance = self.body.resistance
        assert isinstance(resistance, Resistance)
        return resistance

    @property
    def resists_rolling(self) -> bool:
        return self.resistance.dry is not None

    @property
    def resists_spinning(self) -> bool:
        return self.resistance.dry_spinning is not None and not self.body.planar

    def is_held_still(self, state: Any) -> Bool[Array, ""]:
        """Returns whether friction holds the body against spinning."""
        return (state.spin == 0) & self.resists_spinning

    def unless_held(self, state: Any, omega: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns ω over the ground, or its rate, with 0 for what friction holds."""
        rests = state.rolls == 0
        return jnp.where(jnp.stack([rests, rests, self.is_held_still(state)]), 0.0, omega)

    def mode(self, t: Float[Array, ""], state: Any, sigma: Float[Array, "2"] | None = None) -> TurningMode:
        """Returns the mode of turning of a body that rolls in the direction ``sigma``, if that is known."""
        direction = self.direction(t, state) if sigma is None else sigma
        rests = state.rolls == 0
        sigma3 = jnp.where(rests, 0.0, in_three(direction))
        spin = state.spin if self.resists_spinning else jnp.zeros_like(state.spin)
        return TurningMode(sigma3, spin, rests, self.is_held_still(state), jnp.zeros_like(sigma3))

    def heading_of_rolling(self, t: Float[Array, ""], state: Any, accuracy: Accuracy) -> Heading:
        """Returns the direction of rolling as a step begins; a disk may roll however slowly."""
        sigma, omega = self.direction(t, state), self.over_ground(t, state)
        size = root(jnp.sum(omega**2))
        g, r, rate = jax.lax.stop_gradient((jnp.abs(self.body.gravity), self.body.radius, size))
        heading = Heading.of(sigma, omega[:2], root(g / r) + rate, accuracy.atol + accuracy.rtol * size, SLOW_TURNING)
        # The direction of a disk's rolling does not turn as that ends, so nothing has to stop short of zero.
        return heading._replace(least=jnp.zeros_like(heading.least)) if self.body.planar else heading

    def guards_of_turning(self, t: Float[Array, ""], state: Any, spare: Needs, heading: Heading) -> Float[Array, "2"]:
        """Computes the rate in the direction of rolling, and of spinning, or what friction that holds has to spare."""
        omega = self.over_ground(t, state)
        # A guard that the body does not have is always positive.
        rolling = spinning = jnp.ones_like(state.rolls)
        if self.resists_rolling:
            forward = jnp.sum(omega[:2] * heading.sigma) - heading.least
            rolling = jnp.where(state.rolls == 0, spare.rolling, forward)
        if self.resists_spinning:
            spinning = jnp.where(state.spin == 0, spare.spinning, state.spin * omega[2])
        return jnp.stack([rolling, spinning])

    def comes_to_rest(
        self, first: slips.End, second: slips.End, omega: Float[Array, "2"], tolerance: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Returns whether a ball that rolls slowly, with ω_h over the ground, has come to rest at its ``first`` end.

        Where resistance is hardly enough to hold it, a ball no faster than the errors of its speed takes long to stop.
        It does all the same, if it turns little until then, and if what acts halfway, by which its end is the
        ``second``, is much the same.
        """
        is_soon = first.time <= slips.longest_pause(tolerance, slips.unit_of_time(self.body))
        is_short = root(jnp.sum(omega**2)) * first.time <= LONGEST_WAY * tolerance
        is_steady = second.comes & (jnp.abs(second.time - first.time) <= STEADY_RESPONSE * first.time)
        return first.comes & (is_soon | (is_short & is_steady))

    def follow_rolling(
        self, t: Float[Array, ""], before: Any, state: Any, tolerance: Float[Array, ""]
    ) -> tuple[Course, Bool[Array, ""]]:
        """Returns how a ball rolls, and whether it does although its direction is not known beforehand.

        - ``before``: the state before an event, by whose window the direction may be known at its end.
        """
        omega, sigma = self.over_ground(t, state), self.direction(t, before)
        course = Course(sigma, jnp.sum(sigma * omega[:2]), before.rolling.next_span(t))
        size = self.unit_of_rate() + root(jnp.sum(omega**2))
        rolls = (state.rolls != 0) & (before.rolls != 0) & (state.rolling.until <= t) & self.resists_rolling
        return course, rolls & course.is_that_of(omega[:2], size, tolerance)

    def along_course(self, t: Float[Array, ""], state: Any, course: Course) -> Any:
        """Returns the state with ω_h exactly along its direction, without the errors of the solve across it."""
        omega = self.over_ground(t, state).at[:2].set(course.slip)
        return eqx.tree_at(lambda x: x.body, state, state.body.with_Omega(self.contact_axes(t, state).in_body(omega)))

    def unit_of_rate(self) -> Float[Array, ""]:
        """Computes √(g/r)."""
        return root(jax.lax.stop_gradient(jnp.abs(self.body.gravity) / self.body.radius))

    def approach_rest(
        self, step: GuardedStep, heading: Heading, guard: int, accuracy: Accuracy
    ) -> tuple[Bool[Array, ""], Bool[Array, ""], Float[Array, ""]]:
        """Returns whether a ball that rolls is slow, whether it may come to its end, and the longest next step.

        - ``guard``: the index of the guard of rolling.
        """
        least, omega = heading.least, self.over_ground(step.end, step.state)
        # Within the errors of the method the ball rolls to and fro, so that it may never be as slow as ``least``.
        slowest = least + ERRORS_OF_ROLLING * (accuracy.atol + accuracy.rtol * root(jnp.sum(omega**2)))
        slow = root(jnp.sum(omega[:2] ** 2)) <= 2 * slowest
        before, after = step.guards[guard, 0] + least, step.guards[guard, -1] + least
        nears = slow & slips.nears_its_end(before, after, slowest)
        return slow, nears, slips.longest_step(before, after, least, step.end - step.start, accuracy)
