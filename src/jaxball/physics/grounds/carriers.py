"""What carries the matter of a ground along the ground, whose form stays: a turntable and a belt."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.declare import ANGLE, FINITE, FULL_TURN, LENGTH, number
from ...numerics.vectors import root, sine_cosine
from ..conditions import Condition, on_numbers
from ..prescribed.schedules import AbstractSchedule

Slopes = tuple[Float[Array, "3"], Float[Array, "3"]]  # ∂p/∂u1 and ∂p/∂u2


class Turntable(Printed):
    """A part of the ground that turns about its normal; it has no edge.

    On a curved ground its coordinates turn, so that the form of the ground stays and its matter goes around in it.

    **Arguments:**

    - ``turning``: its angle of rotation, rad, as a schedule, whose rate is W(t): ``ConstantRate(0.0, rate=2.0)`` turns
      it at W = 2.
    - ``centre``: the point c about which it turns, in coordinates of the ground, shape (2,), on a plane a length; the
      origin if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, ConstantRate, Ground, Turntable, vector_field
    >>> ground = Ground(turntable=Turntable(ConstantRate(0.0, rate=2.0)))
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=ground)
    >>> vector_field(ball, jnp.array(0.0), BallState(z=(1.0, 0.0))).z  # without rolling, carried along
    Array([0., 2.], dtype=float64)
    """

    turning: AbstractSchedule
    centre: Float[Array, "*group 2"] = eqx.field(converter=number(LENGTH, FINITE), default=(0.0, 0.0))

    def __check_init__(self):
        must = "a schedule of its angle of rotation, such as ConstantRate(0.0, rate=2.0)"
        require("turning", self.turning, AbstractSchedule, must)

    def coordinate_rates(self, t: Float[Array, ""], u: Float[Array, "2"], slopes: Slopes | None) -> Float[Array, "2"]:
        """Computes the rates W e3 × (u − c) of the coordinates of a piece of matter that is at ``u``."""
        arm = u - self.centre
        return self.turning.derivatives(t)[1] * jnp.stack([-arm[1], arm[0]])

    def conditions(self) -> Iterator[Condition]:
        """Yields the condition on its centre; traceable."""
        yield from on_numbers(self, "ground.turntable.")

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which Ẇ jumps or has a kink."""
        return self.turning.kinks()

    def prepare(self) -> "Turntable":
        return Turntable(self.turning.prepare(), self.centre)


class Belt(Printed):
    """A conveyor belt: the matter of the ground moves along it with one speed everywhere; it has no edge.

    **Arguments:**

    - ``travel``: how far it has moved along itself, length, as a schedule: ``ConstantRate(0.0, rate=2.0)`` moves it at
      the speed 2.
    - ``heading``: its direction in the coordinates of the ground, from u1 to u2, rad; 0 if not given.

    On a curved ground it follows the ground: its coordinates change by so much that the speed along the ground is that
    of ``travel``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, Belt, ConstantRate, Ground, simulate
    >>> ground = Ground(angle=0.1, belt=Belt(ConstantRate(0.0, rate=-2.0)))
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=ground)
    >>> start = BallState(Omega=(0.0, 2.0, 0.0))  # it rolls down as fast as the belt comes up, and is at rest
    >>> print(simulate(ball, jnp.array([0.0, 2.0]), start).state.z[-1].round(6))  # ½ t² g sin a / (1 + 2/5)
    [0.142619 0.      ]
    """

    travel: AbstractSchedule
    heading: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FULL_TURN), default=0.0)

    def __check_init__(self):
        must = "a schedule of the length by which it has moved, such as ConstantRate(0.0, rate=2.0)"
        require("travel", self.travel, AbstractSchedule, must)

    def coordinate_rates(self, t: Float[Array, ""], u: Float[Array, "2"], slopes: Slopes | None) -> Float[Array, "2"]:
        """Computes the rates of the coordinates of a piece of matter: the speed along its direction d, over |∂p/∂u d|.

        Without ``slopes``, on a plane, that length is 1.
        """
        d, speed = self.direction, self.travel.derivatives(t)[1]
        if slopes is not None:
            speed = speed / root(jnp.sum((d[0] * slopes[0] + d[1] * slopes[1]) ** 2))
        return speed * d

    @property
    def direction(self) -> Float[Array, "2"]:
        """The unit vector d along it, in coordinates of the ground."""
        sine, cosine = sine_cosine(self.heading)
        return jnp.stack([cosine, sine])

    def conditions(self) -> Iterator[Condition]:
        """Yields the condition on its heading; traceable."""
        yield from on_numbers(self, "ground.belt.")

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which its acceleration jumps or has a kink."""
        return self.travel.kinks()

    def prepare(self) -> "Belt":
        return Belt(self.travel.prepare(), self.heading)
