"""Joints: how one link of a mechanism moves relative to another, and what drives it."""

import abc
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.declare import DIRECTION, LENGTH, number
from ...numerics.vectors import apply, turn_about, unit_vector
from ..conditions import Condition, on_numbers
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

    - ``axis``: its direction, of any nonzero length, shape (3,).
    - ``point``: a point on the axis, from the geometric centre, length, shape (3,); the geometric centre if not given.
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
        turned = jnp.sum(carrier.turn[:, :, None] * turn[None], axis=1)
        zero = jnp.zeros_like(w)
        return Moved(Placement(turned, c - apply(turned, self.point)), w, c, zero, zero)


class Slider(AbstractJoint):
    """A slider: it moves what it carries by θ, a length, along an axis.

    **Arguments:**

    - ``axis``: its direction, of any nonzero length, shape (3,).
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

    - ``rail``: such as a :class:`~jaxball.Circle`, placed for the configuration where every θ is 0.
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
