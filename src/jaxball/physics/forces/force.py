"""External loads on the body, in space axes: forces Fe(t) at the geometric centre, wrenches, and pushes for a time."""

import abc
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import call_with, describe, require_callable_with, require_function, require_value
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, a_number, default_dtype, require_shape, to_array
from ...numerics.declare import OF_FORCE, OF_TORQUE, POSITIVE, TIME, number
from ...numerics.functions import HarmonicSeries, OfKinkedFunctionOfState, VectorOfTime
from ...numerics.kinks import kinks_of_function, kinks_seen
from ...numerics.vectors import apply
from ..conditions import Condition, on_numbers


class BodyMotion(NamedTuple):
    """The position and motion of a body, which may roll, slip or fly, for a force that depends on them.

    Space axes move with the plane and never turn; velocities are relative to them.

    **Arguments:**

    - ``position``: of the geometric centre, space axes, length, shape (3,); the third entry is its height above that of
      rolling.
    - ``velocity``: of the geometric centre, space axes, length/time, shape (3,).
    - ``Lambda``: the rotation matrix Λ from body to space, shape (3, 3).
    - ``Omega``: the angular velocity Ω, body axes, rad/time, shape (3,).
    - ``theta``, ``thetadot``: θ and θ̇ of the driven masses and the joints, as in a state, shape (coordinates,).
    - ``own``: the values of the body's :class:`~jaxball.physics.OwnStates`, shape (own,); None where it has none.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import BodyMotion
    >>> still, none = jnp.zeros(3), jnp.zeros(0)
    >>> BodyMotion(still, still, jnp.eye(3), jnp.array([0.0, 1.0, 0.0]), none, none).omega
    Array([0., 1., 0.], dtype=float64)
    """

    position: Float[Array, "3"]
    velocity: Float[Array, "3"]
    Lambda: Float[Array, "3 3"]
    Omega: Float[Array, "3"]
    theta: Float[Array, " coordinates"]
    thetadot: Float[Array, " coordinates"]
    own: Float[Array, " own"] | None = None

    @property
    def omega(self) -> Float[Array, "3"]:
        """ω = ΛΩ, the angular velocity in space axes."""
        return apply(self.Lambda, self.Omega)


class Wrench(NamedTuple):
    """A force at the geometric centre, and a torque about it.

    **Arguments:**

    - ``force``: space axes, mass length/time², shape (3,).
    - ``torque``: space axes, mass length²/time², shape (3,); None for none.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionWrench, Wrench
    >>> def spun(t, motion, torque):
    ...     return Wrench(jnp.zeros(3), jnp.stack([0.0 * torque, torque, 0.0 * torque]))
    >>> FunctionWrench(spun, 0.3)
    FunctionWrench(function=spun, parameters=0.3, kink_times=())
    """

    force: Float[Array, "3"]
    torque: Float[Array, "3"] | None = None


class AbstractWrench(Printed):
    """An external force, and perhaps a torque, as functions of the time and the body's motion.

    They cannot depend on accelerations or on the reaction of the plane. For a disk, components out of its plane are
    taken up by whatever holds it upright.
    """

    @abc.abstractmethod
    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        """Computes the wrench at time ``t`` on a body with this motion."""

    def conditions(self, name: str = "force") -> Iterator[Condition]:
        """Yields the conditions on its numbers; ``name`` is where it stands in the body."""
        yield from on_numbers(self, f"{name}.")

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which the force or the torque, or one of their derivatives, jumps."""
        return jnp.zeros((0,), dtype=default_dtype())

    def kinks_with(self, motion: BodyMotion) -> Float[Array, " kinks"]:
        """Returns the kinks for such a motion; of a class without ``kinks`` of its own, the ones seen in its trace."""
        if type(self).kinks is not AbstractWrench.kinks:
            return self.kinks()
        return kinks_seen(self, type(self).wrench, motion)


class AbstractForce(AbstractWrench):
    """A force Fe(t) that acts at the geometric centre (section 3.2, ``eq_dS1``)."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Computes Fe(t) in space axes."""

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which Fe or one of its derivatives jumps.

        By default, those at which the trace of ``__call__`` compares the time with something else.
        """
        return kinks_seen(self, type(self).__call__)

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        return Wrench(self(t))


class HarmonicForce(AbstractForce):
    """Fe(t) = constant + Σ powers_j t^(j + 1) + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: the constant part, space axes, mass length/time², shape (3,).
    - ``amplitude``: a row for each sinusoid, mass length/time², shape (terms, 3).
    - ``frequency``: one for each sinusoid, rad/time, shape (terms,).
    - ``phase``: one for each sinusoid, rad, shape (terms,); zero if not given.
    - ``powers``: the coefficients of t, t², …, each in the unit of the one before it over time, shape (degree, 3); none
      if not given.

    **Raises:** ``ValueError`` when ``amplitude``, ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.physics import HarmonicForce
    >>> force = HarmonicForce((0.0, 0.0, 0.0), amplitude=[(2.0, 0.0, 0.0)], frequency=[jnp.pi])
    >>> force(jnp.array(0.5))
    Array([2., 0., 0.], dtype=float64)
    """

    series: HarmonicSeries

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
        powers: Numbers | None = None,
    ):
        require_shape("constant", to_array(constant, "constant"), (3,))
        self.series = HarmonicSeries(constant, amplitude, frequency, phase, powers)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        return self.series(t)


class FunctionForce(VectorOfTime, AbstractForce):
    """Fe(t) = function(t, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: of (t, parameters), to Fe, space axes, mass length/time², shape (3,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which it jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionForce
    >>> def wind(t, strength):
    ...     return strength * jnp.array([1.0, 0.0, 0.0]) * jnp.exp(-t)
    >>> FunctionForce(wind, 0.3)(jnp.array(0.0))
    Array([0.3, 0. , 0. ], dtype=float64)
    """


class FunctionWrench(OfKinkedFunctionOfState, AbstractWrench):
    """The force, or :class:`~jaxball.Wrench`, function(t, motion, parameters): wind, drag, a magnet.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: a function of (t, motion, parameters), where ``motion`` is a :class:`~jaxball.physics.BodyMotion`,
      to the force at the geometric centre, space axes, mass length/time², shape (3,), or to a :class:`~jaxball.Wrench`.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which it jumps or has a kink, besides those found in its trace, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Ball, BallState, FunctionWrench, simulate
    >>> def drag(t, motion, coefficient):
    ...     return -coefficient * jnp.linalg.norm(motion.velocity) * motion.velocity
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), force=FunctionWrench(drag, 0.7))
    >>> run = simulate(ball, jnp.array([0.0, 2.0]), BallState(Omega=(0.0, 1.0, 0.0)))
    >>> round(float(run.state.Omega[-1, 1]), 6)  # 1 / (1 + c v₀ t / (m + d / r²))
    0.5
    """

    def __check_init__(self):
        require_callable_with("function", self.function, self.parameters, "t", "motion")

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        value = call_with(self.function, t, motion, parameters=self.parameters)
        return _check_wrench("function", value if isinstance(value, Wrench) else Wrench(value))

    def kinks_with(self, motion: BodyMotion) -> Float[Array, " kinks"]:
        return kinks_of_function(self, motion)


def require_wrench(name: str, force: AbstractWrench, coordinates: int, own: int = 0) -> None:
    """Raises a ``TypeError`` unless ``force`` returns a force or a wrench for a body with ``coordinates`` coordinates
    and ``own`` states of one's own.

    It is traced for this; an error that it raises itself is passed on with a note.
    """

    def trace(t, motion):
        return _check_wrench(name, force.wrench(t, motion)).force

    trace.__name__ = getattr(force, "function", force.wrench).__name__
    require_function(name, trace, (3,), t=a_number(), motion=shapes_of_motion(coordinates, own))


def shapes_of_motion(coordinates: int, own: int) -> BodyMotion:
    """Returns the shapes of the motion of a body with this number of ``coordinates``, and of states of its ``own``,
    for tracing a force.
    """
    shapes = ((3,), (3,), (3, 3), (3,), (coordinates,), (coordinates,), *([(own,)] if own else []))
    unknown: list[Any] = [jax.ShapeDtypeStruct(shape, default_dtype()) for shape in shapes]
    return BodyMotion(*unknown)


def _check_wrench(name: str, wrench: Wrench) -> Wrench:
    if not isinstance(wrench, Wrench):  # the entries of a vector would be taken for the parts of one
        raise TypeError(
            f"Argument `{name}` must give a Wrench, such as Wrench(force), but it gives {describe(wrench)}."
        )
    for part in wrench:
        if part is not None:
            require_value(name, part, (3,))
    return wrench


class Push(AbstractWrench):
    """A constant force at the geometric centre, and perhaps a torque, from ``start`` for a ``duration``.

    **Arguments:**

    - ``force``: at the geometric centre, space axes, mass length/time², shape (3,).
    - ``start``: when it begins, a time.
    - ``duration``: how long it lasts, a time. The push gives the momentum force × duration.
    - ``torque``: space axes, mass length²/time², shape (3,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, simulate
    >>> from jaxball.control import Push
    >>> disk = Disk(mass=1.0, inertia=0.5, force=Push((0.3, 0.0, 0.0), start=1.0, duration=0.5))
    >>> run = simulate(disk, [0.0, 2.0])
    >>> round(float(run.observables.geometric_centre[-1, 0]), 6)  # 0.3 / (m + d / r²) (½ · 0.5² + 0.5 · 0.5)
    0.075
    """

    force: Float[Array, "*group 3"] = eqx.field(converter=number(OF_FORCE))
    start: Float[Array, "*group"] = eqx.field(converter=number(TIME))
    duration: Float[Array, "*group"] = eqx.field(converter=number(TIME, POSITIVE))
    torque: Float[Array, "*group 3"] = eqx.field(converter=number(OF_TORQUE), default=(0.0, 0.0, 0.0))

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        lasts = (t >= self.start) & (t < self.start + self.duration)
        return Wrench(jnp.where(lasts, self.force, 0.0), jnp.where(lasts, self.torque, 0.0))

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.stack([self.start, self.start + self.duration])


class Wrenches(AbstractWrench):
    """Several forces at once.

    **Arguments:**

    - ``terms``: the forces.
    """

    terms: tuple[AbstractWrench, ...]

    def conditions(self, name: str = "force") -> Iterator[Condition]:
        for k, term in enumerate(self.terms):
            yield from term.conditions(f"{name}.terms[{k}]")

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        each = [term.wrench(t, motion) for term in self.terms]
        torques = [part.torque for part in each if part.torque is not None]
        force, torque = sum((part.force for part in each[1:]), each[0].force), None
        return Wrench(force, sum(torques[1:], torques[0]) if torques else torque)

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([term.kinks() for term in self.terms])

    def kinks_with(self, motion: BodyMotion) -> Float[Array, " kinks"]:
        return jnp.concatenate([term.kinks_with(motion) for term in self.terms])
