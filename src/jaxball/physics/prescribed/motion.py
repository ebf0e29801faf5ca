"""The motions of a point mass in the ball, prescribed in time (on a rail, free, fixed) or driven by a law.

Each supplies χ, χ̇ and χ̈, body vectors from the geometric centre, for the equations of motion, which do not depend on
rails; θ of a ``Driven`` mass belongs to the state. A prescribed motion has the times of its kinks, too, and may be that
of a ground.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...interface.printing import Printed
from ...numerics.arrays import require_shape
from ...numerics.calculus import two_derivatives
from ...numerics.declare import LENGTH, number
from ...numerics.functions import HarmonicSeries, VectorOfTime
from ...numerics.kinks import kinks_seen
from .rails import AbstractRail
from .schedules import AbstractSchedule


class Kinematics(NamedTuple):
    """Position, velocity and acceleration of a mass (or of many, along a leading axis) in the body."""

    chi: Float[Array, "*n 3"]
    chidot: Float[Array, "*n 3"]
    chiddot: Float[Array, "*n 3"]


class AbstractMotion(Printed):
    """The motion of one mass."""

    def prepare(self) -> "AbstractMotion":
        """Returns the same motion, ready to be evaluated many times."""
        return self


class AbstractPrescribedMotion(AbstractMotion):
    """A motion known as a function of time."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes χ(t)."""

    def kinematics(self, t: Float[Array, ""]) -> Kinematics:
        """Computes χ(t), χ̇(t) and χ̈(t), the rates by forward mode."""
        return Kinematics(*two_derivatives(self, t))

    def velocity(self, t: Float[Array, ""]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Computes χ(t) and χ̇(t)."""
        return jax.jvp(self, (t,), (jnp.ones_like(t),))

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which χ̈ or one of its derivatives jumps; χ̇ must not.

        By default, those at which the trace of ``__call__`` compares the time with something else.
        """
        return kinks_seen(self, type(self).__call__)


def along_rail(
    rail: AbstractRail,
    theta: Float[Array, ""],
    thetadot: Float[Array, ""],
    thetaddot: Float[Array, ""],
) -> Kinematics:
    """Applies the chain rule for χ(t) = ζ(θ(t)), ``eq_1d_param``."""
    zeta, dzeta, ddzeta = rail.derivatives(theta)
    return Kinematics(zeta, thetadot * dzeta, thetadot**2 * ddzeta + thetaddot * dzeta)


def _require_rail(rail: Any) -> None:
    swapped = isinstance(rail, AbstractSchedule)
    remedy = "the rail comes first, OnRail(rail, schedule)" if swapped else ""
    require("rail", rail, AbstractRail, "a rail, such as Circle(...)", remedy)


class OnRail(AbstractPrescribedMotion):
    """χ(t) = ζ(θ(t)) on ``rail``, with θ(t) given by ``schedule``.

    **Arguments:**

    - ``rail``: where the mass can be, such as a :class:`~jaxball.Circle`.
    - ``schedule``: its position on the rail as a function of time, such as a :class:`~jaxball.Pulse`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Circle, ConstantRate, OnRail
    >>> motion = OnRail(Circle(0.5), ConstantRate(0.0, rate=2.0))
    >>> motion.kinematics(jnp.array(0.0)).chiddot  # towards the centre, rate² times the radius
    Array([-2.,  0.,  0.], dtype=float64)
    """

    rail: AbstractRail
    schedule: AbstractSchedule

    def __check_init__(self):
        _require_rail(self.rail)
        held = isinstance(self.schedule, int | float | jax.Array | np.ndarray)
        remedy = "to hold the mass at one angle, give ConstantRate(angle)" if held else ""
        require("schedule", self.schedule, AbstractSchedule, "a schedule, such as Pulse(...)", remedy)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.rail(self.schedule(t))

    def kinematics(self, t: Float[Array, ""]) -> Kinematics:
        return along_rail(self.rail, *self.schedule.derivatives(t))

    def kinks(self) -> Float[Array, " kinks"]:
        return self.schedule.kinks()

    def prepare(self) -> "OnRail":
        return OnRail(self.rail.prepare(), self.schedule.prepare())


class Driven(AbstractMotion):
    """On ``rail``, with θ̈ = u(t, state) by the ball's feedback law; θ and θ̇ belong to the state.

    **Arguments:**

    - ``rail``: on which the mass is.

    **Example:**

    >>> from jaxball import Circle, Disk, Driven, FunctionLaw, PointMass
    >>> def spring(t, state, stiffness):
    ...     return -stiffness * state.theta
    >>> law = FunctionLaw(spring, 4.0)
    >>> disk = Disk(mass=1.0, inertia=0.5, masses=[PointMass(0.5, Driven(Circle(0.5)))], law=law)
    >>> disk.driven  # the masses whose θ and θ̇ belong to the state
    (0,)
    """

    rail: AbstractRail

    def __check_init__(self):
        _require_rail(self.rail)

    def kinematics(
        self, theta: Float[Array, ""], thetadot: Float[Array, ""], thetaddot: Float[Array, ""]
    ) -> Kinematics:
        """Computes χ, χ̇ and χ̈ for given θ, θ̇ and θ̈."""
        return along_rail(self.rail, theta, thetadot, thetaddot)

    def velocity(
        self, theta: Float[Array, ""], thetadot: Float[Array, ""]
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Computes χ and χ̇ for given θ and θ̇."""
        return jax.jvp(self.rail, (theta,), (thetadot,))

    def prepare(self) -> "Driven":
        return Driven(self.rail.prepare())


def rail_of(motion: AbstractMotion) -> AbstractRail | None:
    """Returns the rail that a mass moves on; None for a motion without one."""
    return motion.rail if isinstance(motion, OnRail | Driven) else None


def schedule_of(motion: AbstractMotion) -> AbstractSchedule | None:
    """Returns the schedule that prescribes θ; None where a law does, and for a motion without a rail."""
    return motion.schedule if isinstance(motion, OnRail) else None


class Fixed(AbstractPrescribedMotion):
    """A mass held at ``position``: with only such masses, the ball has a static internal structure.

    **Arguments:**

    - ``position``: χ, from the geometric centre, body axes, length, shape (3,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Fixed
    >>> Fixed((0.0, 0.0, -0.5)).kinematics(jnp.array(3.0)).chi
    Array([ 0. ,  0. , -0.5], dtype=float64)
    """

    position: Float[Array, "*group 3"] = eqx.field(converter=number(LENGTH))

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.position


class Oscillating(AbstractPrescribedMotion):
    """A free motion in the body whose coordinates are constants plus sinusoids and powers of the time.

    **Arguments:**

    - ``path``: χ(t), body axes: a :class:`~jaxball.HarmonicSeries` with a constant of shape (3,), length, and
      ``powers`` for growth with time.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import HarmonicSeries, Oscillating
    >>> motion = Oscillating(HarmonicSeries((0.0, 0.0, 0.3), amplitude=[(0.2, 0.0, 0.0)], frequency=[2.0]))
    >>> motion.kinematics(jnp.array(0.0)).chidot
    Array([0.4, 0. , 0. ], dtype=float64)
    """

    path: HarmonicSeries

    def __check_init__(self):
        require("path", self.path, HarmonicSeries, "a HarmonicSeries with a constant of three numbers")
        require_shape("path.constant", self.path.constant, (3,))

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.path(t)


class Free(VectorOfTime, AbstractPrescribedMotion):
    """Any free motion χ(t) = function(t, parameters), on a surface or in the volume.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.
    Give the times at which its second derivative jumps in ``kink_times``.

    **Arguments:**

    - ``function``: of (t, parameters), to χ, body axes, length, shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which its second derivative jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Free
    >>> def helix(t, pitch):
    ...     return jnp.stack([0.5 * jnp.cos(t), 0.5 * jnp.sin(t), pitch * t])
    >>> print(Free(helix, 0.1).kinematics(jnp.array(jnp.pi / 2)).chi.round(3))
    [0.    0.5   0.157]
    """
