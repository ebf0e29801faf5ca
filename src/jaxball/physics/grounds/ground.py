"""The ground: its contract, and a plane that may be tilted, move without turning, and carry a turntable.

Space axes move with that plane and never turn; e3 is its normal, and the position z and all velocities are relative to
these axes. A ground of any other form or motion is a ``surface``, in space axes that are at rest.
"""

import abc
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import describe, require
from ...interface.printing import Printed
from ...numerics.arrays import join_arrays, namespace_of, numbers
from ...numerics.vectors import sine_cosine
from ..conditions import Condition, ExplainedCondition
from ..prescribed.motion import AbstractPrescribedMotion
from ..prescribed.schedules import AbstractSchedule

SINE_ALONG = 1e-6  # how far the sine of a disk's heading may be from 0


class AbstractGround(Printed):
    """What a body rolls on: a :class:`Ground`, which is a plane, or an :class:`~jaxball.AbstractSurface`.

    Nothing else is known to the equations of motion; a ground of one's own is a surface.
    """

    @property
    def driven(self) -> tuple[str, ...]:
        """The names of its coordinates that the body's feedback law drives; they are the last ones in a state's θ."""
        return ()

    @property
    def schedules(self) -> tuple[AbstractSchedule, ...]:
        """The schedules of those of its coordinates that a law could drive, in the order of ``driven``."""
        return ()

    def follow_law(self) -> "AbstractGround":
        """Returns the same ground with a law in place of ``schedules``."""
        return self

    def follow(self, schedules: Sequence[AbstractSchedule]) -> "AbstractGround":
        """Returns the same ground with others in place of ``schedules``."""
        return self

    @abc.abstractmethod
    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        """Yields the conditions on its numbers; traceable. ``planar``: for a disk, which rolls along e1."""

    def start_conditions(
        self, t: Float[Array, ""], r: Float[Array, ""], state: Any
    ) -> Iterator[Condition | ExplainedCondition]:
        """Yields the conditions on the ground where a ball of radius ``r`` starts; traceable."""
        yield from ()

    @abc.abstractmethod
    def up(self) -> Float[Array, "3"]:
        """Returns the vertical −**g**/g, space axes."""

    @abc.abstractmethod
    def lift(self, t: Float[Array, ""], g: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes the acceleration of the space axes, less **g**, in these axes."""

    @abc.abstractmethod
    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which the acceleration of its matter jumps or has a kink."""

    @abc.abstractmethod
    def prepare(self) -> "AbstractGround":
        """Returns the same ground, ready to be evaluated many times."""


def require_plane(ground: AbstractGround | None, purpose: str, error: type[Exception] = ValueError) -> None:
    """Refuses a ground that is not a plane in something that is only for one, ``purpose``.

    **Raises:** ``error``.
    """
    if not (ground is None or isinstance(ground, Ground)):
        raise error(
            f"Argument `ground` of the body must be a Ground or None for {purpose}, which is for planes, but it is "
            f"{describe(ground)}."
        )


class Turntable(Printed):
    """A part of the plane that turns about its normal; it has no edge.

    **Arguments:**

    - ``turning``: its angle of rotation, rad, as a schedule, whose rate is W(t): ``ConstantRate(0.0, rate=2.0)`` turns
      it at W = 2.
    - ``centre``: the point c about which it turns, length, shape (2,); the origin if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, ConstantRate, Ground, Turntable, vector_field
    >>> ground = Ground(turntable=Turntable(ConstantRate(0.0, rate=2.0)))
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=ground)
    >>> vector_field(ball, jnp.array(0.0), BallState(z=(1.0, 0.0))).z  # without rolling, carried along
    Array([0., 2.], dtype=float64)
    """

    turning: AbstractSchedule
    centre: Float[Array, "*group 2"] = eqx.field(converter=numbers("centre", (2,)), default=(0.0, 0.0))

    def __check_init__(self):
        must = "a schedule of its angle of rotation, such as ConstantRate(0.0, rate=2.0)"
        require("turning", self.turning, AbstractSchedule, must)

    def prepare(self) -> "Turntable":
        return Turntable(self.turning.prepare(), self.centre)


class TableMotion(NamedTuple):
    """What a turntable does to the body's centre: its rate W, the velocity u, and u̇ in space axes."""

    W: Float[Array, ""]
    velocity: Float[Array, "2"]
    acceleration: Float[Array, "2"]


class Ground(AbstractGround):
    """A plane that is tilted, moves or carries a turntable; without a ground, a body rolls on a level plane at rest.

    **Arguments:**

    - ``angle``: the tilt of the plane, rad, between −π/2 and π/2.
    - ``heading``: the direction of steepest descent, from e1 to e2, rad.
    - ``motion``: the displacement X(t) of the plane, with its axes, as a motion: an :class:`~jaxball.Oscillating` of
      sinusoids, an :class:`~jaxball.OnRail` of a rail and a schedule, or a :class:`~jaxball.Free` of a function.
    - ``turntable``: a :class:`~jaxball.Turntable` in the plane, for a ball.

    Gravity is g (sin a cos b, sin a sin b, −cos a), with a the angle and b the heading. The weight, the plane's
    acceleration and the turntable act together on the masses as γ = Λ⁻¹(Ẍ + u̇ − **g**), which replaces gΓ.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, Ground, simulate
    >>> slope = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=Ground(angle=0.1))
    >>> path = simulate(slope, jnp.array([0.0, 2.0])).state.z  # ½ t² g sin a / (1 + 2/5)
    >>> print(path[-1].round(6))
    [0.142619 0.      ]
    """

    angle: Float[Array, "*group"] = eqx.field(converter=numbers("angle"), default=0.0)
    heading: Float[Array, "*group"] = eqx.field(converter=numbers("heading"), default=0.0)
    motion: AbstractPrescribedMotion | None = None
    turntable: Turntable | None = None

    def __check_init__(self):
        must = "a motion of the plane, such as Oscillating(HarmonicSeries(...)), or None"
        require("motion", self.motion, (AbstractPrescribedMotion, type(None)), must)
        require("turntable", self.turntable, (Turntable, type(None)), "a Turntable or None")

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        """Yields the conditions on the tilt; traceable. ``planar``: for a disk, which rolls along e1."""
        number = namespace_of(self.angle)
        tilted = "an angle of less than a right angle, π/2, either way"
        yield Condition(abs(self.angle) < number.pi / 2, "ground.angle", self.angle, tilted)
        yield Condition(number.isfinite(self.heading), "ground.heading", self.heading, "a finite number")
        if planar:
            along = abs(number.sin(self.heading)) < SINE_ALONG
            yield Condition(along, "ground.heading", self.heading, "0 or π for a disk, which rolls along e1")

    @property
    def moving(self) -> bool:
        """Whether it has a motion or a turntable, even one that does not turn."""
        return not (self.motion is None and self.turntable is None)

    def up(self) -> Float[Array, "3"]:
        """Returns the vertical −**g**/g, space axes."""
        (sine, cosine), (sine_b, cosine_b) = sine_cosine(self.angle), sine_cosine(self.heading)
        return jnp.stack([-sine * cosine_b, -sine * sine_b, cosine])

    def lift(self, t: Float[Array, ""], g: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes Ẍ − **g**, space axes."""
        weight = g * self.up()
        return weight if self.motion is None else weight + self.motion.kinematics(t).chiddot

    def velocity(self, t: Float[Array, ""], z: Float[Array, "2"]) -> Float[Array, "2"] | None:
        """Computes u = W e3 × (z − c), with which the turntable carries the body's centre; None without one."""
        if self.turntable is None:
            return None
        return self.turntable.turning.derivatives(t)[1] * _turn(z - self.turntable.centre)

    def table_motion(self, t: Float[Array, ""], z: Float[Array, "2"], rolling: Float[Array, "2"]) -> TableMotion | None:
        """Computes W, u and u̇ where the body's centre is at z and rolls over the table at ``rolling``; None without
        one.
        """
        if self.turntable is None:
            return None
        _, W, Wdot = self.turntable.turning.derivatives(t)
        aside = _turn(z - self.turntable.centre)
        return TableMotion(W, W * aside, Wdot * aside + W * _turn(rolling + W * aside))

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which Ẍ or Ẇ jumps or has a kink."""
        sources = [self.motion, None if self.turntable is None else self.turntable.turning]
        return join_arrays([source.kinks() for source in sources if source is not None])

    def prepare(self) -> "Ground":
        motion = None if self.motion is None else self.motion.prepare()
        turntable = None if self.turntable is None else self.turntable.prepare()
        return eqx.tree_at(
            lambda ground: (ground.motion, ground.turntable), self, (motion, turntable), is_leaf=lambda x: x is None
        )


def _turn(v: Float[Array, "2"]) -> Float[Array, "2"]:
    """Computes e3 × v."""
    return jnp.stack([-v[1], v[0]])
