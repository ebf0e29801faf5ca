"""The motion of a surface as a rigid body: turns by schedules, and a displacement."""

from collections.abc import Iterator, Sequence

import equinox as eqx
from jaxtyping import Array, Float

from ...interface.arguments import require, require_each
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, join_arrays, to_array
from ...numerics.declare import DIRECTION, LENGTH, number
from ...numerics.vectors import apply, turn_about, unit_vector
from ..conditions import Condition, on_numbers
from ..prescribed.motion import AbstractPrescribedMotion
from ..prescribed.schedules import AbstractSchedule


class Turn(Printed):
    """A rotation about an axis by a schedule.

    **Arguments:**

    - ``axis``: its direction, of any nonzero length, shape (3,).
    - ``angle``: the angle of rotation, rad, as a schedule, such as ``ConstantRate(0.0, rate=2.0)``.

    **Example:**

    >>> from jaxball import ConstantRate, Turn
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

    - ``turns``: a list of :class:`Turn`; R is the product of their rotations, the first on the left, so the axis of
      each turn is carried by the turns before it.
    - ``displacement``: X(t), a motion such as an :class:`~jaxball.Oscillating` of sinusoids or a
      :class:`~jaxball.Free` of a function, length; None for none.
    - ``pivot``: the point b about which it turns, length, shape (3,); the origin if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import ConstantRate, MovingFrame, Turn
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
