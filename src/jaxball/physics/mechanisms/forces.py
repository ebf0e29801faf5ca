"""Generalised forces Q on joints: motors, springs, dampers, servos, end stops, and their sums."""

import abc
import dataclasses
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import call_with, require, require_callable_with, require_flags, require_value, traceable
from ...interface.printing import Printed
from ...numerics.arrays import (
    default_dtype,
    join_arrays,
    require_not_nan,
)
from ...numerics.declare import (
    ANGLE,
    DAMPING,
    EFFORT,
    FROM_0,
    PER_RATE,
    POSITIVE,
    RATE,
    STIFFNESS,
    number,
    number_or_none,
)
from ...numerics.functions import OfKinkedFunctionOfState
from ...numerics.kinks import kinks_of_function, kinks_seen
from ..conditions import Condition, on_numbers
from ..prescribed.schedules import AbstractSchedule
from ..prescribed.signals import AbstractIntegrableSignal, AbstractSignal, ToSignal
from ..state import State


class AbstractJointForce(Printed):
    """The generalised force Q on a free joint, between the two links that it connects.

    It is a torque about a hinge and a force along a slider. Forces add up: ``Motor(...) + Damper(0.1)``.
    """

    def __check_init__(self):
        for field in dataclasses.fields(self):
            if field.name != "parameters":  # those of a function are its own affair
                require_not_nan(field.name, getattr(self, field.name))

    @abc.abstractmethod
    def __call__(
        self, t: Float[Array, ""], theta: Float[Array, ""], thetadot: Float[Array, ""], state: State
    ) -> Float[Array, ""]:
        """Computes Q, where ``theta`` and ``thetadot`` are the angle and rate of the joint and ``state`` is the state
        of the body.
        """

    def __add__(self, other: "AbstractJointForce") -> "JointForces":
        return JointForces((*_terms(self), *_terms(other)))

    def conditions(self, name: str) -> Iterator[Condition]:
        """Yields every condition that its numbers must meet; ``name`` is what sentences call the force."""
        yield from on_numbers(self, f"{name}.")

    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """Computes ∫ Q up to t, for the part of Q whose integral is known in closed form; None if there is none."""
        return None

    def without_impulse(
        self, t: Float[Array, ""], theta: Float[Array, ""], thetadot: Float[Array, ""], state: State
    ) -> Float[Array, ""]:
        """Computes Q without the part that :meth:`impulse` integrates."""
        return self(t, theta, thetadot, state)

    def motion_kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which the part that :meth:`impulse` integrates jumps or has a kink."""
        return jnp.zeros((0,), dtype=default_dtype())

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which the rest of Q or one of its derivatives jumps."""
        return jnp.zeros((0,), dtype=default_dtype())

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        """Returns the kinks for such a state; of a class without ``kinks`` of its own, the ones seen in its trace."""
        if type(self).kinks is not AbstractJointForce.kinks:
            return self.kinks()
        return kinks_seen(self, type(self).__call__, *_joint_at_rest(), state)

    @property
    def sticking(self) -> "tuple[AbstractJointForce, ...]":
        """The friction by which the joint sticks, if there is one: a :class:`~jaxball.JointFriction`."""
        return ()

    @property
    def stopping(self) -> "tuple[AbstractJointForce, ...]":
        """The stops at the ends of the joint's range, if there are any: a :class:`~jaxball.HardStops`."""
        return ()

    @property
    def dissipating(self) -> "tuple[AbstractJointForce, ...]":
        """The forces in it that only take energy from the body, such as friction."""
        return ()

    def slipping(self, direction: Float[Array, "*group"]) -> "AbstractJointForce":
        """Returns the same force where the joint slips in a direction, 1 or −1, or sticks, 0."""
        return self

    def prepare(self) -> "AbstractJointForce":
        """Returns the same force, ready to be evaluated many times."""
        return self


class JointForces(AbstractJointForce):
    """The sum of several forces on one joint.

    **Arguments:**

    - ``terms``: the forces.

    **Example:**

    >>> from jaxball import Damper, Spring
    >>> Spring(stiffness=2.0) + Damper(0.1)
    JointForces(terms=(Spring(stiffness=2.0), Damper(coefficient=0.1)))
    """

    terms: tuple[AbstractJointForce, ...]

    def __check_init__(self):
        for index, term in enumerate(self.terms):
            require(f"terms[{index}]", term, AbstractJointForce, "a force on a joint, such as Spring(...)")
        if len(self.sticking) > 1:
            raise ValueError(
                f"Argument `terms` must have one JointFriction at most without smoothing, but it has "
                f"{len(self.sticking)}; add up their levels in one."
            )
        if len(self.stopping) > 1:
            raise ValueError(
                f"Argument `terms` must have one HardStops at most, but it has {len(self.stopping)}; keep the inner "
                "stops."
            )

    def __call__(self, t, theta, thetadot, state):
        return sum((term(t, theta, thetadot, state) for term in self.terms), jnp.zeros_like(theta))

    def impulse(self, t):
        parts = [part for term in self.terms if (part := term.impulse(t)) is not None]
        return sum(parts[1:], parts[0]) if parts else None

    def without_impulse(self, t, theta, thetadot, state):
        return sum((term.without_impulse(t, theta, thetadot, state) for term in self.terms), jnp.zeros_like(theta))

    def motion_kinks(self) -> Float[Array, " kinks"]:
        return join_arrays([term.motion_kinks() for term in self.terms])

    def conditions(self, name: str) -> Iterator[Condition]:
        for index, term in enumerate(self.terms):
            yield from term.conditions(f"{name}.terms[{index}]")

    def kinks(self) -> Float[Array, " kinks"]:
        return join_arrays([term.kinks() for term in self.terms])

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        return join_arrays([term.kinks_with(state) for term in self.terms])

    @property
    def sticking(self) -> tuple[AbstractJointForce, ...]:
        return tuple(friction for term in self.terms for friction in term.sticking)

    @property
    def stopping(self) -> tuple[AbstractJointForce, ...]:
        return tuple(stops for term in self.terms for stops in term.stopping)

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return tuple(force for term in self.terms for force in term.dissipating)

    def slipping(self, direction: Float[Array, "*group"]) -> "JointForces":
        return JointForces(tuple(term.slipping(direction) for term in self.terms))

    def prepare(self) -> "JointForces":
        return JointForces(tuple(term.prepare() for term in self.terms))


def _terms(force: AbstractJointForce) -> tuple[AbstractJointForce, ...]:
    return force.terms if isinstance(force, JointForces) else (force,)


class Spring(AbstractJointForce):
    """Q = −stiffness (θ − rest). Its energy is not part of the body's energy: a spring does work, as a motor does.

    **Arguments:**

    - ``stiffness``: the torque per rad, or force per length.
    - ``rest``: the θ at which its force is zero.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, Spring
    >>> float(Spring(stiffness=2.0, rest=0.5)(jnp.array(0.0), jnp.array(1.0), jnp.array(0.0), BallState()))
    -1.0
    """

    stiffness: Float[Array, "*group"] = eqx.field(converter=number(STIFFNESS))
    rest: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=0.0)

    def __call__(self, t, theta, thetadot, state):
        return -self.stiffness * (theta - self.rest)


class Damper(AbstractJointForce):
    """Q = −coefficient θ̇.

    **Arguments:**

    - ``coefficient``: the torque or force per rate, not negative unless ``negative``.
    - ``negative``: whether it may be negative, and so supply energy.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, Damper
    >>> float(Damper(0.5)(jnp.array(0.0), jnp.array(0.0), jnp.array(2.0), BallState()))
    -1.0
    """

    coefficient: Float[Array, "*group"] = eqx.field(converter=number(DAMPING))
    negative: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        require_flags(negative=self.negative)

    @property
    def dissipating(self) -> tuple[AbstractJointForce, ...]:
        return (self,)

    def __call__(self, t, theta, thetadot, state):
        return -self.coefficient * thetadot

    def conditions(self, name: str) -> Iterator[Condition]:
        if not self.negative:
            must = "0 or positive, unless `negative` allows it"
            yield Condition(FROM_0.holds(self.coefficient), f"{name}.coefficient", self.coefficient, must)


class Motor(AbstractJointForce):
    """Q(t) = signal(t), limited to ±``limit``.

    **Arguments:**

    - ``signal``: the torque of a hinge or the force along a slider, mass length²/time² or mass length/time². A number,
      a :class:`~jaxball.PiecewiseSignal`, a :class:`~jaxball.RecordedSignal`, or a schedule of it.
    - ``limit``: the largest |Q|; none if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, Motor, Sinusoids
    >>> motor = Motor(Sinusoids(0.0, amplitude=[3.0], frequency=[jnp.pi]), limit=2.0)
    >>> float(motor(jnp.array(0.5), jnp.array(0.0), jnp.array(0.0), BallState()))
    2.0
    """

    signal: AbstractSignal | AbstractSchedule = eqx.field(converter=ToSignal())
    limit: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(EFFORT, FROM_0), default=None)

    def __call__(self, t, theta, thetadot, state):
        return _limit(self.signal(t), self.limit)

    def impulse(self, t):
        signal = self._integrable
        return None if signal is None else signal.impulse(t)

    def without_impulse(self, t, theta, thetadot, state):
        return self(t, theta, thetadot, state) if self._integrable is None else jnp.zeros_like(theta)

    def motion_kinks(self) -> Float[Array, " kinks"]:
        signal = self._within_limit()._integrable
        return AbstractJointForce.motion_kinks(self) if signal is None else signal.kinks()

    def kinks(self) -> Float[Array, " kinks"]:
        return self.signal.kinks() if self._within_limit()._integrable is None else AbstractJointForce.kinks(self)

    def prepare(self) -> "Motor":
        limited = self._within_limit()
        return Motor(limited.signal.prepare(), limited.limit)

    def _within_limit(self) -> "Motor":
        """Returns the same motor without a limit, where the signal can be limited itself."""
        if self.limit is None or not isinstance(self.signal, AbstractIntegrableSignal):
            return self
        signal = self.signal.limit(self.limit)
        return self if signal is None else Motor(signal)

    @property
    def _integrable(self) -> AbstractIntegrableSignal | None:
        """The signal where its integral is that of the force; else None."""
        return self.signal if self.limit is None and isinstance(self.signal, AbstractIntegrableSignal) else None


class SpeedLimitedMotor(AbstractJointForce):
    """A motor with a linear torque–speed curve: Q = stall (command(t) − θ̇ / free_speed), like an electric motor's.

    **Arguments:**

    - ``command``: the voltage relative to the maximum, from −1 to 1, as a function of time. A number, a
      :class:`~jaxball.PiecewiseSignal` or a schedule.
    - ``stall``: the torque of a hinge, or the force along a slider, at full command and zero speed.
    - ``free_speed``: θ̇ at full command and zero torque.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState
    >>> from jaxball.physics import SpeedLimitedMotor
    >>> motor = SpeedLimitedMotor(1.0, stall=2.0, free_speed=10.0)
    >>> float(motor(jnp.array(0.0), jnp.array(0.0), jnp.array(5.0), BallState()))
    1.0
    """

    command: AbstractSignal | AbstractSchedule = eqx.field(converter=ToSignal())
    stall: Float[Array, "*group"] = eqx.field(converter=number(EFFORT, FROM_0))
    free_speed: Float[Array, "*group"] = eqx.field(converter=number(RATE, POSITIVE))

    def __call__(self, t, theta, thetadot, state):
        return self.stall * (self.command(t) - thetadot / self.free_speed)

    def impulse(self, t):
        command = self._integrable
        return None if command is None else self.stall * command.impulse(t)

    def without_impulse(self, t, theta, thetadot, state):
        command = jnp.zeros_like(theta) if self._integrable is not None else self.command(t)
        return self.stall * (command - thetadot / self.free_speed)

    def motion_kinks(self) -> Float[Array, " kinks"]:
        return AbstractJointForce.motion_kinks(self) if self._integrable is None else self.command.kinks()

    def kinks(self) -> Float[Array, " kinks"]:
        return self.command.kinks() if self._integrable is None else AbstractJointForce.kinks(self)

    @property
    def _integrable(self) -> AbstractIntegrableSignal | None:
        """The command if its integral is known; else None."""
        return self.command if isinstance(self.command, AbstractIntegrableSignal) else None

    def prepare(self) -> "SpeedLimitedMotor":
        return SpeedLimitedMotor(self.command.prepare(), self.stall, self.free_speed)


class PDServo(AbstractJointForce):
    """Q = −stiffness (θ − target(t)) − damping (θ̇ − target rate), limited to ±``limit``.

    A :class:`~jaxball.Servo` prescribes accelerations, whatever force they take; this one gives forces.

    **Arguments:**

    - ``target``: a schedule of θ.
    - ``stiffness``: the torque per rad, or force per length.
    - ``damping``: the torque or force per rate.
    - ``limit``: the largest |Q|; none if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, ConstantRate, PDServo
    >>> servo = PDServo(ConstantRate(1.0), stiffness=4.0, damping=2.0)
    >>> float(servo(jnp.array(0.0), jnp.array(0.0), jnp.array(0.5), BallState()))  # −4 (0 − 1) − 2 · 0.5
    3.0
    """

    target: AbstractSchedule
    stiffness: Float[Array, "*group"] = eqx.field(converter=number(STIFFNESS))
    damping: Float[Array, "*group"] = eqx.field(converter=number(DAMPING), default=0.0)
    limit: Float[Array, "*group"] | None = eqx.field(converter=number_or_none(EFFORT, FROM_0), default=None)

    def __check_init__(self):
        require("target", self.target, AbstractSchedule, "a schedule, such as Waypoints(...)")

    def __call__(self, t, theta, thetadot, state):
        target, rate, _ = self.target.derivatives(t)
        return _limit(-self.stiffness * (theta - target) - self.damping * (thetadot - rate), self.limit)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.target.kinks()

    def prepare(self) -> "PDServo":
        return PDServo(self.target.prepare(), self.stiffness, self.damping, self.limit)


class EndStops(AbstractJointForce):
    """Stiff springs, with dampers, at both ends of a joint's range; no force between them.

    Beyond an end by x > 0, the force back is stiffness x (1 + damping ẋ), and never outward: it grows from 0, as in the
    contact law of Hunt and Crossley (*J. Appl. Mech.* 42, 1975, 440) with an exponent of 1.

    **Arguments:**

    - ``lower``: θ at the lower end.
    - ``upper``: θ at the upper end, more than ``lower``.
    - ``stiffness``: the torque per rad, or force per length, beyond an end. A mass m that hits a stop at speed v
      overshoots it by about v √(m / stiffness).
    - ``damping``: by how much the force grows with the rate ẋ, time/rad.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, EndStops
    >>> stops = EndStops(-1.0, 1.0, stiffness=100.0)
    >>> float(stops(jnp.array(0.0), jnp.array(1.25), jnp.array(0.0), BallState()))
    -25.0
    """

    lower: Float[Array, "*group"] = eqx.field(converter=number(ANGLE))
    upper: Float[Array, "*group"] = eqx.field(converter=number(ANGLE))
    stiffness: Float[Array, "*group"] = eqx.field(converter=number(STIFFNESS, FROM_0))
    damping: Float[Array, "*group"] = eqx.field(converter=number(PER_RATE, FROM_0), default=0.0)

    def __call__(self, t, theta, thetadot, state):
        back = self._push(self.lower - theta, -thetadot)
        return back - self._push(theta - self.upper, thetadot)

    def _push(self, beyond, rate):
        return self.stiffness * jnp.maximum(beyond, 0.0) * jnp.maximum(1.0 + self.damping * rate, 0.0)

    def conditions(self, name: str) -> Iterator[Condition]:
        yield Condition(self.lower < self.upper, f"{name}.lower", self.lower, "less than `upper`")
        yield from super().conditions(name)


class FunctionJointForce(OfKinkedFunctionOfState, AbstractJointForce):
    """Q = function(t, theta, thetadot, state, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.
    It may depend on the body's Ω, Γ and position through ``state``, but not on accelerations or on the reaction of the
    plane.

    **Arguments:**

    - ``function``: of (t, theta, thetadot, state, parameters), with θ and θ̇ of the joint, to Q, shape ().
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which it jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState
    >>> from jaxball.physics import FunctionJointForce
    >>> def hardening(t, theta, thetadot, state, stiffness):
    ...     return -stiffness * theta**3
    >>> force = FunctionJointForce(hardening, 2.0)
    >>> float(force(jnp.array(0.0), jnp.array(1.0), jnp.array(0.0), BallState()))
    -2.0
    """

    def __check_init__(self):
        require_callable_with("function", self.function, self.parameters, "t", "theta", "thetadot", "state")

    def __call__(self, t, theta, thetadot, state):
        with traceable("function", self.function):
            force = call_with(self.function, t, theta, thetadot, state, parameters=self.parameters)
        require_value("function", force, ())
        return force

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        return kinks_of_function(self, *_joint_at_rest(), state)


def _joint_at_rest() -> tuple[Float[Array, ""], Float[Array, ""]]:
    return jnp.zeros((), default_dtype()), jnp.zeros((), default_dtype())


def _limit(force: Float[Array, ""], limit: Float[Array, ""] | None) -> Float[Array, ""]:
    return force if limit is None else jnp.clip(force, -limit, limit)
