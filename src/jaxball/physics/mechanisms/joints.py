"""Joints: how one link of a mechanism moves relative to another, what drives it, and what holds it.

A joint with exact dry friction sticks and slips; smooth laws are beside it. A joint strikes a hard end stop, rests
against it and leaves it.
"""

import abc
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.arrays import AnyArray
from ...numerics.declare import (
    ANGLE,
    BETWEEN_0_AND_1,
    DAMPING,
    DIRECTION,
    EFFORT,
    FROM_0,
    FROM_1,
    LENGTH,
    POSITIVE,
    RATE,
    number,
    number_or_none,
)
from ...numerics.linear import product
from ...numerics.vectors import apply, turn_about, unit_vector
from ..conditions import Condition, on_numbers, positive
from ..prescribed.rails import AbstractRail
from ..prescribed.schedules import AbstractSchedule
from .forces import AbstractJointForce


class Accelerated(Printed):
    """The drive of a joint whose θ̈ is given by the body's feedback law, as for :class:`~jaxball.Driven` masses.

    **Example:**

    >>> from jaxball import Accelerated, Hinge
    >>> Hinge((0.0, 1.0, 0.0), drive=Accelerated())
    Hinge(axis=(0.0, 1.0, 0.0), point=(0.0, 0.0, 0.0), drive=Accelerated())
    """


Drive = AbstractSchedule | Accelerated | AbstractJointForce | None


def require_drive(name: str, drive: Drive) -> None:
    """Raises a ``TypeError`` unless ``drive`` is what may drive a joint."""
    must = "a schedule of θ, a force on the joint such as Motor(...), Accelerated() for a feedback law, or None"
    require(name, drive, (AbstractSchedule, Accelerated, AbstractJointForce, type(None)), must)


class Placement(NamedTuple):
    """The placement of a link in the body: its points are at ``turn`` x + ``shift``, with x their position at θ = 0."""

    turn: Float[Array, "3 3"]
    shift: Float[Array, "3"]

    def of_point(self, x: Float[Array, "3"]) -> Float[Array, "3"]:
        return apply(self.turn, x) + self.shift

    def of_points(self, x: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return jnp.sum(self.turn[None] * x[:, None, :], axis=-1) + self.shift[None]


def in_place(like: Float[Array, "..."]) -> Placement:
    """Returns the placement of the body itself."""
    return Placement(jnp.eye(3, dtype=like.dtype), jnp.zeros((3,), dtype=like.dtype))


class Moved(NamedTuple):
    """What a joint does: where it places its link, and how fast a rate θ̇ = 1 moves what it carries.

    A point at χ gets the velocity w × (χ − c) + v, and v changes by ``bend`` for a unit of θ.
    """

    placement: Placement
    w: Float[Array, "3"]
    c: Float[Array, "3"]
    v: Float[Array, "3"]
    bend: Float[Array, "3"]


class AbstractJoint(Printed):
    """A joint of one degree of freedom, θ. Its axis and point are given in body axes, for every θ equal to 0.

    ``drive`` says how it moves: by a schedule of θ; by a force on the joint, with the inertia of all that it carries;
    by a feedback law that gives θ̈ (:class:`~jaxball.Accelerated`); or freely, for None. ``on`` is the index of the
    joint that carries it, −1 for the body itself; by default the joint before it in the list.
    """

    if TYPE_CHECKING:  # to a type checker, fields declared here would come before `axis` among the arguments
        drive, on = cast(Drive, None), cast(int | None, None)
    else:
        drive: eqx.AbstractVar[Drive]
        on: eqx.AbstractVar[int | None]

    def __check_init__(self):
        require_drive("drive", self.drive)
        require("on", self.on, (int, type(None)), "the index of a joint before it, -1 for the body, or None")

    @abc.abstractmethod
    def move(self, carrier: Placement, theta: Float[Array, ""]) -> Moved:
        """Moves the joint to ``theta``, on a link that is placed at ``carrier``."""

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet; ``name`` is what sentences call the joint."""
        yield from on_numbers(self, f"{name}.")

    def prepare(self) -> "AbstractJoint":
        """Returns the same joint, ready to be evaluated many times."""
        return self


class Hinge(AbstractJoint):
    """A hinge: it turns what it carries by θ about an axis.

    **Arguments:**

    - ``axis``: the direction of its axis, a vector of any nonzero length, shape (3,).
    - ``point``: a point on the axis, from the geometric centre, length, shape (3,).
    - ``drive``: what drives it: a schedule of θ in rad, a force such as :class:`~jaxball.Motor`, whose Q is a torque,
      :class:`~jaxball.Accelerated`, or None.
    - ``on``: the index of the joint that carries it, −1 for the body; by default the joint before it.

    **Example:**

    >>> from jaxball import Hinge, Motor
    >>> Hinge((0.0, 1.0, 0.0), point=(0.0, 0.0, 0.2), drive=Motor(0.1))
    Hinge(axis=(0.0, 1.0, 0.0), point=(0.0, 0.0, 0.2), drive=Motor(signal=ConstantSignal(value=0.1)))
    """

    axis: Float[Array, "*group 3"] = eqx.field(converter=number(rule=DIRECTION))
    point: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    drive: Drive = None
    on: int | None = eqx.field(static=True, default=None)

    def move(self, carrier: Placement, theta: Float[Array, ""]) -> Moved:
        n = unit_vector(self.axis)
        turn = turn_about(n, theta)
        w, c = apply(carrier.turn, n), carrier.of_point(self.point)
        turned = product(carrier.turn, turn)
        zero = jnp.zeros_like(w)
        return Moved(Placement(turned, c - apply(turned, self.point)), w, c, zero, zero)


class Slider(AbstractJoint):
    """A slider: it moves what it carries by θ, a length, along an axis.

    **Arguments:**

    - ``axis``: the direction of its axis, a vector of any nonzero length, shape (3,).
    - ``drive``: what drives it: a schedule of θ, a force such as :class:`~jaxball.Spring`,
      :class:`~jaxball.Accelerated`, or None.
    - ``on``: the index of the joint that carries it, −1 for the body; by default the joint before it.

    **Example:**

    >>> from jaxball import Slider, Spring
    >>> Slider((1.0, 0.0, 0.0), drive=Spring(stiffness=5.0))
    Slider(axis=(1.0, 0.0, 0.0), drive=Spring(stiffness=5.0))
    """

    axis: Float[Array, "*group 3"] = eqx.field(converter=number(rule=DIRECTION))
    drive: Drive = None
    on: int | None = eqx.field(static=True, default=None)

    def move(self, carrier: Placement, theta: Float[Array, ""]) -> Moved:
        v = apply(carrier.turn, unit_vector(self.axis))
        zero = jnp.zeros_like(v)
        return Moved(Placement(carrier.turn, carrier.shift + theta * v), zero, zero, v, zero)


class Carriage(AbstractJoint):
    """A carriage on a rail: it moves what it carries by ζ(θ), without turning it.

    A mass at (0, 0, 0) on it is on the rail itself.

    **Arguments:**

    - ``rail``: the curve along which it moves, where every θ is 0. Such as a :class:`~jaxball.Circle`.
    - ``drive``: what drives it: a schedule of θ, a force such as :class:`~jaxball.Motor`, whose power is Q θ̇,
      :class:`~jaxball.Accelerated`, or None.
    - ``on``: the index of the joint that carries it, −1 for the body; by default the joint before it.

    **Example:**

    >>> from jaxball import Carriage, Circle
    >>> Carriage(Circle(0.5))
    Carriage(rail=Circle(radius=0.5))
    """

    rail: AbstractRail
    drive: Drive = None
    on: int | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        require("rail", self.rail, AbstractRail, "a rail, such as Circle(...)")

    def move(self, carrier: Placement, theta: Float[Array, ""]) -> Moved:
        zeta, slope, curvature = self.rail.derivatives(theta)
        placement, zero = Placement(carrier.turn, carrier.of_point(zeta)), jnp.zeros_like(zeta)
        return Moved(placement, zero, zero, apply(carrier.turn, slope), apply(carrier.turn, curvature))

    def prepare(self) -> "Carriage":
        return Carriage(self.rail.prepare(), self.drive, self.on)


class JointFriction(AbstractJointForce):
    """Dry friction of a joint, Q = −level(|θ̇|) sign θ̇ − viscous θ̇, which sticks where θ̇ = 0.

    level(v) is ``kinetic``, or, with the Stribeck effect, kinetic + (static − kinetic) exp(−(v / stribeck)^exponent).
    Where θ̇ falls to zero the joint sticks, exactly: θ̈ = 0, with the friction Q that this needs, until |Q| exceeds
    ``static``. So a body with it is a hybrid system, and ``trajectory.switches`` says when its joints stick and break
    loose. With ``smoothing``, Q has θ̇ / √(θ̇² + smoothing²) in place of sign θ̇ instead, and a loaded joint creeps.

    **Arguments:**

    - ``kinetic``: the friction of a fast motion, a torque about a hinge, or a force along a slider, 0 or positive.
    - ``static``: the largest friction of a joint at rest, positive, ``kinetic`` or more; ``kinetic`` if not given.
    - ``viscous``: the torque or force per rate, 0 or positive.
    - ``stribeck``: the rate at which most of the difference between static and kinetic friction is gone; without it,
      friction falls to ``kinetic`` at once as the joint breaks loose.
    - ``exponent``: the exponent of the Stribeck effect, 1 for Tustin's law, 2 for a Gaussian.
    - ``smoothing``: the rate of a smooth law, which never sticks.

    **Raises:** ``TypeError`` or ``ValueError`` for an exponent that is not a positive whole number.

    **Source:** Armstrong-Hélouvry, Dupont and Canudas de Wit, *A survey of models, analysis tools and compensation
    methods for the control of machines with friction*, Automatica 30 (1994), 1083.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, JointFriction
    >>> friction = JointFriction(kinetic=0.5, static=0.8, viscous=0.1)
    >>> float(friction(jnp.array(0.0), jnp.array(0.0), jnp.array(2.0), BallState()))
    -0.7
    """

    kinetic: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    static: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(EFFORT), default=None)
    viscous: Float[Array, "*group"] = eqx.field(converter=number(DAMPING, FROM_0), default=0.0)
    stribeck: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(RATE, POSITIVE), default=None)
    exponent: int = eqx.field(static=True, default=2)
    smoothing: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(RATE, POSITIVE), default=None)
    # Of a solve, which knows in which direction the joint moves, 1 or −1, and whether it is held, 0.
    direction: Float[Array, "*group"] | None = eqx.field(init=False)

    def __post_init__(self):
        self.direction = None

    def __check_init__(self):
        require("exponent", self.exponent, int, "a positive whole number")
        if isinstance(self.exponent, bool) or self.exponent < 1:
            raise ValueError(f"Argument `exponent` must be a positive whole number, but it is {self.exponent}.")

    @property
    def largest(self) -> Float[AnyArray, "*group"]:
        """The largest friction of a joint at rest."""
        return self.kinetic if self.static is None else self.static

    @property
    def sticking(self) -> "tuple[JointFriction, ...]":
        return () if self.smoothing is not None else (self,)

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return (self,)

    def slipping(self, direction: Float[Array, "*group"]) -> "JointFriction":
        return eqx.tree_at(lambda friction: friction.direction, self, direction, is_leaf=lambda x: x is None)

    def __call__(self, t, theta, thetadot, state):
        if self.smoothing is not None:
            size = jnp.sqrt(thetadot**2 + self.smoothing**2)
            return -self._level(size) * thetadot / size - self.viscous * thetadot
        # In a solve the direction is that of the mode, also where a step goes on beyond θ̇ = 0: the field is smooth
        # there.
        direction = jnp.sign(thetadot) if self.direction is None else self.direction
        return -direction * self._level(direction * thetadot) - self.viscous * thetadot

    def _level(self, speed: Float[Array, "*rates"]) -> Float[Array, "*rates"]:
        if self.stribeck is None:
            return self.kinetic
        return self.kinetic + (self.largest - self.kinetic) * jnp.exp(-((speed / self.stribeck) ** self.exponent))

    def conditions(self, name: str) -> Iterator[Condition]:
        yield from super().conditions(name)
        holds = positive(self.largest) & (self.largest >= self.kinetic)
        yield Condition(holds, f"{name}.static", self.largest, "a positive number, not less than `kinetic`")


class MajdSimaanFriction(AbstractJointForce):
    """Q = −viscous θ̇ − (kinetic + peak e^(−v) − (peak + kinetic) e^(−steepness v)) sign θ̇, with v = |θ̇| / rate.

    A smooth law that imitates stiction: it rises from 0 at rest to its largest value at a small rate, if ``steepness``
    is greater than 1, and falls to ``kinetic``. With a steepness of 1, ``peak`` has no effect, and friction only rises.

    **Arguments:**

    - ``viscous``: f_w, the torque or force per rate, 0 or positive.
    - ``kinetic``: f_c, the torque or force of a fast motion, 0 or positive.
    - ``peak``: σ, the torque or force of the peak, 0 or positive.
    - ``rate``: ω_c, the rate over which friction changes, positive.
    - ``steepness``: n, how steeply it rises from 0, 1 or more.

    **Source:** V. J. Majd and M. A. Simaan, *A continuous friction model for servo systems with stiction*,
    International Conference on Control Applications, 1995, 296.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState
    >>> from jaxball.physics import MajdSimaanFriction
    >>> friction = MajdSimaanFriction(viscous=0.0, kinetic=0.5, peak=0.2, rate=0.01, steepness=10.0)
    >>> rates = jnp.array([0.001, 0.004, 1.0])
    >>> friction(jnp.array(0.0), jnp.array(0.0), rates, BallState()).round(3)
    Array([-0.423, -0.621, -0.5  ], dtype=float64)
    """

    viscous: Float[Array, "*group"] = eqx.field(converter=number(DAMPING, FROM_0))
    kinetic: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    peak: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    rate: Float[Array, "*group"] = eqx.field(converter=number(RATE, POSITIVE))
    steepness: Float[Array, "*group"] = eqx.field(converter=number(rule=FROM_1))

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return (self,)

    def __call__(self, t, theta, thetadot, state):
        speed = jnp.abs(thetadot) / self.rate
        rising = (self.peak + self.kinetic) * jnp.exp(-self.steepness * speed)
        level = self.kinetic + self.peak * jnp.exp(-speed) - rising
        return -self.viscous * thetadot - level * jnp.sign(thetadot)


class HardStops(AbstractJointForce):
    """Rigid stops at the ends of a joint's range, with an impact by Newton's restitution: θ̇⁺ = −e θ̇⁻.

    A joint that strikes a stop changes all velocities at once, by an impulse at this joint. Where the rebound would be
    too slow to matter, the joint rests against its stop, exactly, until a force takes it off. So a body with stops is a
    hybrid system, and ``trajectory.switches`` says when its joints strike, rest and leave. ``EndStops`` are springs
    instead, without modes. With a ``JointFriction`` besides, that also holds the joint at a stop.

    **Arguments:**

    - ``lower``: θ at the lower stop.
    - ``upper``: θ at the upper stop, more than ``lower``.
    - ``restitution``: Newton's e, from 0 to 1.
    - ``slowest``: a rebound in which the masses that the joint moves are slower than this times √(g r) counts as none;
      without gravity, their acceleration towards the stop takes the place of g.

    **Source:** Brogliato, *Nonsmooth Mechanics*, 3rd ed., Springer 2016, chapter 4.

    **Example:**

    >>> from jaxball import Disk, DiskState, HardStops, simulate
    >>> from jaxball.physics import mass_in_tube
    >>> tube = mass_in_tube(0.5, (0.0, 0.0, 1.0), drive=HardStops(-0.5, 0.5))
    >>> disk = Disk(mass=1.0, inertia=0.5, mechanisms=[tube])
    >>> run = simulate(disk, [0.0, 2.0], DiskState(theta=[0.0], thetadot=[0.0]))
    >>> run.switches.lines
    ['t = 1: mechanisms[0].joints[0] comes to rest against its lower stop']
    """

    lower: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=-math.inf)
    upper: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=math.inf)
    restitution: Float[Array, "*group"] = eqx.field(converter=number(rule=BETWEEN_0_AND_1), default=0.0)
    slowest: Float[Array, "*group"] = eqx.field(converter=number(rule=FROM_0), default=1e-6)
    # Of a solve, which knows in which direction the joint moves, 1 or −1, and whether it is held, 0.
    direction: Float[Array, "*group"] | None = eqx.field(init=False)

    def __post_init__(self):
        self.direction = None

    @property
    def stopping(self) -> "tuple[HardStops, ...]":
        return (self,)

    def slipping(self, direction: Float[Array, "*group"]) -> "HardStops":
        return eqx.tree_at(lambda stops: stops.direction, self, direction, is_leaf=lambda x: x is None)

    def __call__(self, t, theta, thetadot, state):
        return jnp.zeros_like(theta)  # what holds a joint at its stop is in the matrix of the equations

    def conditions(self, name: str) -> Iterator[Condition]:
        yield Condition(self.lower < self.upper, f"{name}.lower", self.lower, "less than `upper`")
        yield from super().conditions(name)
