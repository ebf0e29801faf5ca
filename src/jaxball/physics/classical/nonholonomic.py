"""Vehicles and bodies on blades and wheels, each from its Lagrangian and its constraints.

Sources: Neimark & Fufaev, Dynamics of Nonholonomic Systems (1972); Bloch, Nonholonomic Mechanics and Control (2015);
Ostrowski, Lewis, Murray & Burdick (1994) for the snakeboard; Krishnaprasad & Tsakiris (2001) for the roller racer.
"""

from collections.abc import Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.status import Status
from ...numerics.arrays import Numbers, to_array
from ...numerics.declare import ANGLE, LENGTH, OF_GRAVITY, OF_INERTIA, OF_MASS, POSITIVE, number
from ...numerics.vectors import sine_cosine
from ..conditions import Condition, ExplainedCondition
from .lagrangian import AbstractLagrangianSystem, LagrangianState

LEAST_UPRIGHT = 1e-6  # the cosine of a lean from which a coin can start: below, turning and rolling are one motion


class ChaplyginSleigh(AbstractLagrangianSystem):
    """A rigid body on a level plane with a blade that cannot slip sideways.

    Its coordinates are the place of the blade and the heading, ``x``, ``y`` and ``theta``. The multiplier is the force
    of the plane on the blade, to its right.

    **Arguments:**

    - ``mass``: m, the mass, in units of mass.
    - ``inertia``: I, the moment of inertia about the centre of mass, mass length².
    - ``ahead``: a, from the blade to the centre of mass, along the blade, length.

    With a > 0 it ends on a straight line, the blade behind: v̇ = a ω² and (I + m a²) ω̇ = −m a ω v.

    **Example:**

    >>> from jaxball import simulate
    >>> from jaxball.physics.classical import ChaplyginSleigh, LagrangianState
    >>> sleigh = ChaplyginSleigh(mass=1.0, inertia=0.39, ahead=0.5)
    >>> run = simulate(sleigh, [0.0, 1.0], LagrangianState([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    >>> float(run.state.qdot[-1, 2].round(6))  # 1 / cosh(a / √(I + m a²))
    0.832117
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    inertia: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), kw_only=True)
    ahead: Float[Array, ""] = eqx.field(converter=number(LENGTH), kw_only=True)

    coordinates = ("x", "y", "theta")
    title: ClassVar[str] = "Chaplygin sleigh"

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, "3"], qdot: Float[Array, "3"]) -> Float[Array, ""]:
        xdot, ydot, omega = qdot
        sine, cosine = sine_cosine(q[2])
        across = self.ahead * omega
        square = (xdot - across * sine) ** 2 + (ydot + across * cosine) ** 2
        return 0.5 * self.mass * square + 0.5 * self.inertia * omega**2

    def constraints(self, t: Float[Array, ""], q: Float[Array, "3"], qdot: Float[Array, "3"]) -> Any:
        return _sideways(q[2], qdot)


class KnifeEdge(AbstractLagrangianSystem):
    """A blade on an incline, with its centre of mass above the point of contact.

    Its coordinates are the place, ``x`` down the slope and ``y`` across, and the heading ``theta`` from x. It does not
    go down: spun at ω from rest, it moves on a cycloid across the slope.

    **Arguments:**

    - ``mass``: m, the mass, in units of mass.
    - ``inertia``: the moment of inertia about the normal of the incline, mass length².
    - ``slope``: α, the angle of the incline, rad.
    - ``gravity``: g, the acceleration of gravity, length/time².
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    inertia: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=1.0, kw_only=True)
    slope: Float[Array, ""] = eqx.field(converter=number(ANGLE), kw_only=True)
    gravity: Float[Array, ""] = eqx.field(converter=number(OF_GRAVITY), default=1.0, kw_only=True)

    coordinates = ("x", "y", "theta")
    title: ClassVar[str] = "knife edge"

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, "3"], qdot: Float[Array, "3"]) -> Float[Array, ""]:
        kinetic = 0.5 * self.mass * (qdot[0] ** 2 + qdot[1] ** 2) + 0.5 * self.inertia * qdot[2] ** 2
        return kinetic + self.mass * self.gravity * jnp.sin(self.slope) * q[0]

    def constraints(self, t: Float[Array, ""], q: Float[Array, "3"], qdot: Float[Array, "3"]) -> Any:
        return _sideways(q[2], qdot)


class RollingCoin(AbstractLagrangianSystem):
    """A thin disk that rolls on a level plane without slipping, and may lean and turn.

    Its coordinates are the place ``x``, ``y`` of the contact, the ``heading``, the ``lean`` to the left from upright,
    and the angle ``roll`` about its axis, which grows as it rolls ahead. Upright, it is stable if it rolls faster than
    ω² = g/(3r), a hoop than g/(4r). A run in which it falls over ends as ``TOPPLED`` where it lies on its side.

    **Arguments:**

    - ``mass``: m, the mass, in units of mass.
    - ``radius``: r, the radius of the coin, length.
    - ``inertia``: the moments of inertia about the axis and about a diameter, mass length², shape (2,); if not given
      those of a uniform disk, m r²/2 and m r²/4.
    - ``gravity``: g, the acceleration of gravity, length/time².
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE))
    radius: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE))
    inertia: Float[Array, "2"] = eqx.field(converter=number(OF_INERTIA, POSITIVE))
    gravity: Float[Array, ""] = eqx.field(converter=number(OF_GRAVITY))

    coordinates = ("x", "y", "heading", "lean", "roll")
    title: ClassVar[str] = "rolling coin"
    leaving_status: ClassVar[Status] = Status.TOPPLED

    def __init__(
        self,
        *,
        mass: Numbers = 1.0,
        radius: Numbers = 1.0,
        inertia: Numbers | None = None,
        gravity: Numbers = 1.0,
    ):
        self.mass, self.radius = to_array(mass, "mass"), to_array(radius, "radius")
        self.gravity = to_array(gravity, "gravity")
        disk = self.mass * self.radius**2 * jnp.array([0.5, 0.25], self.mass.dtype)
        self.inertia = disk if inertia is None else to_array(inertia, "inertia")

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, "5"], qdot: Float[Array, "5"]) -> Float[Array, ""]:
        xdot, ydot, turn, tilt, roll = qdot
        (sine, cosine), (s, c) = sine_cosine(q[2]), sine_cosine(q[3])
        # The centre is at r (sin lean, cos lean) to the left of the contact and above it.
        left, up = self.radius * s, self.radius * c
        along = xdot * cosine + ydot * sine - turn * left
        across = ydot * cosine - xdot * sine + tilt * up
        square = along**2 + across**2 + (tilt * left) ** 2
        axial, diametral = self.inertia
        spin = 0.5 * axial * (roll - turn * s) ** 2 + 0.5 * diametral * (tilt**2 + (turn * c) ** 2)
        return 0.5 * self.mass * square + spin - self.mass * self.gravity * up

    def constraints(self, t: Float[Array, ""], q: Float[Array, "5"], qdot: Float[Array, "5"]) -> Any:
        sine, cosine = sine_cosine(q[2])
        travelled = self.radius * qdot[4]
        return [qdot[0] - travelled * cosine, qdot[1] - travelled * sine]

    def start_conditions(self, t: Float[Array, ""], state: LagrangianState) -> Iterator[Condition | ExplainedCondition]:
        conditions = list(super().start_conditions(t, state))
        lean = state.q[3]
        stands = jnp.cos(lean) > LEAST_UPRIGHT
        must = "a lean between −π/2 and π/2, at which the coin lies on its side"
        yield Condition(stands, "state.q[3]", lean, must)
        # Flat on the plane, where turning is rolling, the mass matrix is singular: that follows, and is not told.
        yield from (condition._replace(holds=condition.holds | ~stands) for condition in conditions)

    def clearance(self, t: Float[Array, ""], state: LagrangianState) -> Float[Array, ""]:
        """Returns the height of the centre over r: 0 where the coin lies down, and may go no further."""
        return jnp.cos(state.q[3])


class Snakeboard(AbstractLagrangianSystem):
    """A board on two wheeled trucks that turn, with a rotor in the middle, on a level plane.

    Its coordinates are the place ``x``, ``y`` of the middle, the heading ``theta``, the angle ``psi`` of the rotor
    against the board, and those of the ``back`` and the ``front`` truck. No constraint contains ψ̇, so without a torque
    on the rotor its momentum J₀ (θ̇ + ψ̇) is constant, and so are those of the trucks.

    **Arguments:**

    - ``mass``: m, the mass of all, in units of mass.
    - ``board``: the moment of inertia of the board about the vertical, mass length².
    - ``rotor``: the moment of inertia of the rotor about the vertical, mass length².
    - ``truck``: the moment of inertia of each truck about the vertical, mass length².
    - ``half_length``: l, from the middle to the axle of a truck, length.
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    board: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=0.1, kw_only=True)
    rotor: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=0.1, kw_only=True)
    truck: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=0.01, kw_only=True)
    half_length: Float[Array, ""] = eqx.field(converter=number(LENGTH, POSITIVE), default=0.5, kw_only=True)

    coordinates = ("x", "y", "theta", "psi", "back", "front")
    title: ClassVar[str] = "snakeboard"

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, "6"], qdot: Float[Array, "6"]) -> Float[Array, ""]:
        xdot, ydot, turn, psidot, back, front = qdot
        turning = self.board * turn**2 + self.rotor * (turn + psidot) ** 2
        trucks = self.truck * ((turn + back) ** 2 + (turn + front) ** 2)
        return 0.5 * (self.mass * (xdot**2 + ydot**2) + turning + trucks)

    def constraints(self, t: Float[Array, ""], q: Float[Array, "6"], qdot: Float[Array, "6"]) -> Any:
        arm = self.half_length * qdot[2]
        return [
            _sideways(q[2] + q[4], qdot) + arm * jnp.cos(q[4]),
            _sideways(q[2] + q[5], qdot) - arm * jnp.cos(q[5]),
        ]


class RollerRacer(AbstractLagrangianSystem):
    """A vehicle of two bodies on an axle each, which moves as its rider swings the handlebar.

    Its coordinates are the place ``x``, ``y`` of the rear axle's middle, where the centre of mass is, the heading
    ``theta``, and the angle ``phi`` of the front body, which has no mass but a moment of inertia.

    **Arguments:**

    - ``mass``: m, the mass of the rear body, in units of mass.
    - ``rear``: the moment of inertia of the rear body about the vertical, mass length².
    - ``front``: the moment of inertia of the front body about the vertical, mass length².
    - ``lengths``: from the rear axle to the joint, and from the joint to the front axle, length, shape (2,).
    """

    mass: Float[Array, ""] = eqx.field(converter=number(OF_MASS, POSITIVE), default=1.0, kw_only=True)
    rear: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=0.2, kw_only=True)
    front: Float[Array, ""] = eqx.field(converter=number(OF_INERTIA, POSITIVE), default=0.05, kw_only=True)
    lengths: Float[Array, "2"] = eqx.field(converter=number(LENGTH), default=(0.5, 0.1), kw_only=True)

    coordinates = ("x", "y", "theta", "phi")
    title: ClassVar[str] = "roller racer"

    def lagrangian(self, t: Float[Array, ""], q: Float[Array, "4"], qdot: Float[Array, "4"]) -> Float[Array, ""]:
        xdot, ydot, turn, swing = qdot
        turning = self.rear * turn**2 + self.front * (turn + swing) ** 2
        return 0.5 * (self.mass * (xdot**2 + ydot**2) + turning)

    def constraints(self, t: Float[Array, ""], q: Float[Array, "4"], qdot: Float[Array, "4"]) -> Any:
        to_joint, to_front = self.lengths
        arm = to_joint * jnp.cos(q[3]) * qdot[2] + to_front * (qdot[2] + qdot[3])
        return [_sideways(q[2], qdot), _sideways(q[2] + q[3], qdot) - arm]


def _sideways(heading: Float[Array, ""], qdot: Float[Array, " n"]) -> Float[Array, ""]:
    """Computes ẋ sin θ − ẏ cos θ, the velocity to the right of the heading θ."""
    sine, cosine = sine_cosine(heading)
    return qdot[0] * sine - qdot[1] * cosine
