"""The ground: its contract, how it holds a body at one moment, and a plane that may be tilted and move without turning.

Space axes move with that plane and never turn; e3 is its normal, and the position z and all velocities are relative to
these axes. A ground of any other form or motion is a ``surface``, in space axes that are at rest.
"""

import abc
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import describe, require
from ...interface.printing import Printed
from ...numerics.arrays import join_arrays, namespace_of
from ...numerics.declare import ANGLE, FULL_TURN, QUARTER_TURN, number
from ...numerics.linear import product
from ...numerics.vectors import add, apply, in_three, sine_cosine
from ..conditions import Condition, ExplainedCondition, on_numbers
from ..prescribed.motion import AbstractPrescribedMotion
from ..prescribed.schedules import AbstractSchedule
from .carriers import Belt, Turntable


class Footing(NamedTuple):
    """How a ground holds a body at one moment, in space axes.

    What is None is as on a level plane at rest: the contact axes are those of space, the vectors are 0, and places and
    their rates are those that the state of the body has.

    - ``axes``: the contact axes as rows: unit vectors along ∂p/∂u1 and across, and the normal n towards the body.
    - ``centre``, ``foot``: the positions c of the ball's centre and p of the contact point.
    - ``coordinate_rates``: u̇.
    - ``velocity``: w of the ground's matter at the contact; ``spin`` is the angular velocity of that matter.
    - ``normal_rate``: ṅ along the motion of the contact point; ``acceleration`` is ẇ, likewise.
    - ``turning``: the angular velocity of the contact axes, likewise.
    """

    axes: Float[Array, "3 3"] | None = None
    centre: Float[Array, "3"] | None = None
    foot: Float[Array, "3"] | None = None
    coordinate_rates: Float[Array, "*two"] | None = None
    velocity: Float[Array, "3"] | None = None
    spin: Float[Array, "3"] | None = None
    normal_rate: Float[Array, "3"] | None = None
    acceleration: Float[Array, "3"] | None = None
    turning: Float[Array, "3"] | None = None

    @property
    def normal(self) -> Float[Array, "3"] | None:
        """n; None for e3."""
        return None if self.axes is None else self.axes[2]

    def to_axes(self, v: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the components of a vector in the contact axes."""
        return v if self.axes is None else apply(self.axes, v)

    def to_space(self, v: Float[Array, "3"]) -> Float[Array, "3"]:
        """Returns the vector whose components in the contact axes are ``v``."""
        return v if self.axes is None else apply(self.axes.T, v)

    def rows(self, Lambda: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
        """Returns the contact axes in body axes, as rows: what takes vectors of the body to the contact axes."""
        return Lambda if self.axes is None else product(self.axes, Lambda)


AT_REST = Footing()  # on a level plane at rest


Kind = TypeVar("Kind", bound="AbstractGround")
SINE_ALONG = 1e-6  # how far the sine of a disk's heading may be from 0


class AbstractGround(Printed):
    """What a body rolls on: a :class:`Ground`, which is a plane, or an :class:`~jaxball.physics.AbstractSurface`.

    Nothing else is known to the equations of motion; a ground of one's own is a surface. Any ground may have these,
    which carry its matter along it:

    - ``turntable``: a part of the ground that turns, under a ball. A :class:`~jaxball.Turntable`.
    - ``belt``: a conveyor along the ground, under a disk along its line. A :class:`~jaxball.Belt`.
    """

    turntable: Turntable | None = eqx.field(default=None, kw_only=True)
    belt: Belt | None = eqx.field(default=None, kw_only=True)

    if TYPE_CHECKING:  # to a type checker, a field declared here would come first among the arguments
        motion = cast(Any, None)
    else:
        motion: eqx.AbstractVar[Any]

    def __check_init__(self):
        require("turntable", self.turntable, (Turntable, type(None)), "a Turntable or None")
        require("belt", self.belt, (Belt, type(None)), "a Belt or None")

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

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        """Yields the conditions on its numbers; traceable. ``planar``: for a disk, which rolls along e1."""
        yield from on_numbers(self, "ground.")
        for carrier in self.carriers:
            yield from carrier.conditions()

    def start_conditions(
        self, t: Float[Array, ""], r: Float[Array, ""], state: Any
    ) -> Iterator[Condition | ExplainedCondition]:
        """Yields the conditions on the ground where a ball of radius ``r`` starts; traceable."""
        yield from ()

    @property
    def carriers(self) -> tuple[Turntable | Belt, ...]:
        """What carries its matter along it."""
        return tuple(carrier for carrier in (self.turntable, self.belt) if carrier is not None)

    @property
    def moves(self) -> str:
        """What moves it, a name of a field; empty of a ground at rest."""
        return next((name for name in ("turntable", "belt", "motion") if getattr(self, name) is not None), "")

    def up(self) -> Float[Array, "3"]:
        """Returns the vertical −**g**/g, space axes."""
        return jnp.zeros((3,)).at[2].set(1.0)

    def lift(self, t: Float[Array, ""], g: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes the acceleration of the space axes, less **g**, in these axes."""
        return g * self.up().astype(g.dtype)

    @abc.abstractmethod
    def footing(
        self,
        t: Float[Array, ""],
        r: Float[Array, ""],
        u: Float[Array, "*two"],
        omega: Float[Array, "3"],
        V: Float[Array, "3"] | None = None,
        height: Float[Array, ""] | None = None,
    ) -> Footing:
        """Computes how it holds a ball of radius ``r`` that turns at ``omega``, space axes, where its coordinates are
        ``u``, of a disk one number.

        ``V`` is the velocity of its centre, that of rolling if not given; ``height`` is how far it is above the ground.
        """

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which the acceleration of its matter has a kink or jumps; by default those of its
        motion, its turntable and its belt.
        """
        return join_arrays([part.kinks() for part in (self.motion, *self.carriers) if part is not None])

    def prepare(self: Kind) -> Kind:
        """Returns the same ground, ready to be evaluated many times."""
        names = [name for name in ("motion", "turntable", "belt") if getattr(self, name) is not None]
        if not names:
            return self
        parts = [getattr(self, name).prepare() for name in names]
        return eqx.tree_at(lambda ground: [getattr(ground, name) for name in names], self, parts)


def require_plane(ground: AbstractGround | None, purpose: str) -> None:
    """Raises a ``ValueError`` for a ground that is not a plane in something that is only for one, ``purpose``."""
    if not (ground is None or isinstance(ground, Ground)):
        raise ValueError(
            f"Argument `ground` of the body must be a Ground or None for {purpose}, which is for planes, but it is "
            f"{describe(ground)}."
        )


class Ground(AbstractGround):
    """A plane that is tilted or moves; without a ground, a body rolls on a level plane at rest.

    **Arguments:**

    - ``angle``: the tilt of the plane, between −π/2 and π/2, rad.
    - ``heading``: the direction of steepest descent, from e1 to e2, rad.
    - ``motion``: the displacement X(t) of the plane, with its axes; at rest if not given. An
      :class:`~jaxball.Oscillating` of sinusoids, an :class:`~jaxball.OnRail` of a rail and a schedule, or a
      :class:`~jaxball.Free` of a function.
    - ``turntable``, ``belt``: as for an :class:`AbstractGround`.

    Gravity is g (sin a cos b, sin a sin b, −cos a), with a the angle and b the heading. The weight, the plane's
    acceleration and that of its matter act together on the masses as γ = Λ⁻¹(Ẍ + u̇ − **g**), which replaces gΓ.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, Ground, simulate
    >>> slope = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=Ground(angle=0.1))
    >>> path = simulate(slope, jnp.array([0.0, 2.0])).state.z  # ½ t² g sin a / (1 + 2/5)
    >>> print(path[-1].round(6))
    [0.142619 0.      ]
    """

    angle: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, QUARTER_TURN), default=0.0)
    heading: Float[Array, "*group"] = eqx.field(converter=number(ANGLE, FULL_TURN), default=0.0)
    motion: AbstractPrescribedMotion | None = None

    def __check_init__(self):
        must = "a motion of the plane, such as Oscillating(HarmonicSeries(...)), or None"
        require("motion", self.motion, (AbstractPrescribedMotion, type(None)), must)

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        number = namespace_of(self.angle)
        tilted = "an angle of less than a right angle, π/2, either way"
        yield Condition(abs(self.angle) < number.pi / 2, "ground.angle", self.angle, tilted)
        headings = {"heading": self.heading} | ({} if self.belt is None else {"belt.heading": self.belt.heading})
        for name, heading in headings.items() if planar else ():
            along = abs(number.sin(heading)) < SINE_ALONG
            yield Condition(along, f"ground.{name}", heading, "0 or π for a disk, which rolls along e1")
        yield from AbstractGround.conditions(self, planar)

    def up(self) -> Float[Array, "3"]:
        (sine, cosine), (sine_b, cosine_b) = sine_cosine(self.angle), sine_cosine(self.heading)
        return jnp.stack([-sine * cosine_b, -sine * sine_b, cosine])

    def lift(self, t: Float[Array, ""], g: Float[Array, ""]) -> Float[Array, "3"]:
        return add(g * self.up(), None if self.motion is None else self.motion.kinematics(t).chiddot)

    def footing(
        self,
        t: Float[Array, ""],
        r: Float[Array, ""],
        u: Float[Array, "*two"],
        omega: Float[Array, "3"],
        V: Float[Array, "3"] | None = None,
        height: Float[Array, ""] | None = None,
    ) -> Footing:
        if not self.carriers:
            return AT_REST
        first, *others = self.carriers

        def carried(t: Float[Array, ""], z: Float[Array, "2"]) -> Float[Array, "2"]:
            rates = (carrier.coordinate_rates(t, z, None) for carrier in others)
            return add(first.coordinate_rates(t, z, None), *rates)

        z = u if u.ndim else jnp.stack([u, jnp.zeros_like(u)])

        w = carried(t, z)
        along = w + r * jnp.stack([omega[1], -omega[0]]) if V is None else V[:2]
        _, acceleration = jax.jvp(carried, (t, z), (jnp.ones_like(t), along))
        # The angular velocity of the matter is the antisymmetric part of the gradient of its velocity.
        along_1, along_2 = (jax.jvp(carried, (t, z), (jnp.zeros_like(t), e))[1] for e in jnp.eye(2, dtype=z.dtype))
        spin = jnp.zeros_like(omega).at[2].set(0.5 * (along_1[1] - along_2[0]))
        return Footing(velocity=in_three(w), spin=spin, acceleration=in_three(acceleration))
