"""What moves the matter of a ground: a turntable or a belt along it, and the motion of a surface as a rigid body."""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require, require_each
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, join_arrays, to_array
from ...numerics.declare import ANGLE, DIRECTION, FINITE, FULL_TURN, LENGTH, number
from ...numerics.vectors import apply, root, sine_cosine, turn_about, unit_vector
from ..conditions import Condition, on_numbers
from ..prescribed.motion import AbstractPrescribedMotion
from ..prescribed.schedules import AbstractSchedule

Slopes = tuple[Float[Array, "3"], Float[Array, "3"]]  # ∂p/∂u1 and ∂p/∂u2


class Turntable(Printed):
    """A part of the ground that turns about its normal; it has no edge.

    On a curved ground its coordinates turn, so that the form of the ground stays and its matter goes around in it.

    **Arguments:**

    - ``turning``: its angle of rotation, a schedule, whose rate is W(t), rad. ``ConstantRate(0.0, rate=2.0)`` turns it
      at W = 2.
    - ``centre``: the point c about which it turns, in coordinates of the ground, on a plane a length, shape (2,); the
      origin if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, ConstantRate, Ground, Turntable
    >>> from jaxball.physics import vector_field
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

    - ``travel``: how far it has moved along itself, a schedule of a length. ``ConstantRate(0.0, rate=2.0)`` moves it at
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


class Turn(Printed):
    """A rotation about an axis by a schedule.

    **Arguments:**

    - ``axis``: the direction of the axis, of any nonzero length, shape (3,).
    - ``angle``: the angle of rotation, a schedule, rad. Such as ``ConstantRate(0.0, rate=2.0)``.

    **Example:**

    >>> from jaxball import ConstantRate
    >>> from jaxball.physics import Turn
    >>> Turn((0.0, 0.0, 1.0), ConstantRate(0.0, rate=2.0))
    Turn(axis=(0.0, 0.0, 1.0), angle=ConstantRate(theta=0.0, rate=2.0))
    """

    axis: Float[Array, "*group 3"] = eqx.field(converter=number(rule=DIRECTION))
    angle: AbstractSchedule

    def __check_init__(self):
        require("angle", self.angle, AbstractSchedule, "a schedule, such as ConstantRate(0.0, rate=2.0)")


class MovingFrame(Printed):
    """The motion of a surface as a rigid body: a point x of it is at X(t) + b + R(t) (x − b).

    **Arguments:**

    - ``turns``: rotations, each carried by those before it. A list of :class:`Turn`; R is the product of their
      rotations, the first on the left.
    - ``displacement``: X(t), its displacement, length; none if not given. A motion such as an
      :class:`~jaxball.Oscillating` of sinusoids or a :class:`~jaxball.Free` of a function.
    - ``pivot``: the point b about which it turns, length, shape (3,); the origin if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import ConstantRate
    >>> from jaxball.physics import MovingFrame, Turn
    >>> frame = MovingFrame([Turn((0.0, 0.0, 1.0), ConstantRate(0.0, rate=jnp.pi))], pivot=(1.0, 0.0, 0.0))
    >>> print(frame.place(jnp.array(1.0), jnp.array([2.0, 0.0, 0.0])).round(6))
    [0. 0. 0.]
    """

    turns: tuple[Turn, ...]
    displacement: AbstractPrescribedMotion | None
    pivot: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH))

    def __init__(
        self,
        turns: Sequence[Turn] = (),
        displacement: AbstractPrescribedMotion | None = None,
        pivot: Numbers = (0.0, 0.0, 0.0),
    ):
        require_each("turns", turns, Turn, "a Turn")
        must = "a motion, such as Oscillating(HarmonicSeries(...)), or None"
        require("displacement", displacement, (AbstractPrescribedMotion, type(None)), must)
        self.turns, self.displacement, self.pivot = tuple(turns), displacement, to_array(pivot, "pivot")

    def place(self, t: Float[Array, ""], x: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the place in space of the point ``x`` of the surface."""
        arm = x - self.pivot
        for turn in reversed(self.turns):
            arm = apply(turn_about(unit_vector(turn.axis), turn.angle(t)), arm)
        x = self.pivot + arm
        return x if self.displacement is None else x + self.displacement(t)

    def undo(self, t: Float[Array, ""], x: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the point of the surface that is at ``x`` in space: the inverse of :meth:`place`."""
        x = x if self.displacement is None else x - self.displacement(t)
        arm = x - self.pivot
        for turn in self.turns:
            arm = apply(turn_about(unit_vector(turn.axis), turn.angle(t)).T, arm)
        return self.pivot + arm

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields the conditions on its numbers; ``name`` is what sentences call it."""
        for index, turn in enumerate(self.turns):
            yield from on_numbers(turn, f"{name}.turns[{index}].")

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which an acceleration jumps or has a kink."""
        sources = [turn.angle for turn in self.turns]
        return join_arrays([source.kinks() for source in (*sources, self.displacement) if source is not None])

    def prepare(self) -> "MovingFrame":
        turns = tuple(Turn(turn.axis, turn.angle.prepare()) for turn in self.turns)
        displacement = None if self.displacement is None else self.displacement.prepare()
        return eqx.tree_at(
            lambda frame: (frame.turns, frame.displacement), self, (turns, displacement), is_leaf=lambda x: x is None
        )
