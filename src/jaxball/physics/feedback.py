"""Feedback laws: θ̈ = u(t, state) for the masses whose θ and θ̇ belong to the state."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..interface.arguments import require_callable, require_each
from ..interface.printing import Printed
from ..numerics.arrays import default_dtype, numbers, require_shape
from .schedules import AbstractSchedule
from .state import State


class AbstractLaw(Printed):
    """A law that gives θ̈ of every :class:`~jaxball.Driven` mass, in the order of the masses."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        """u(t, state)."""

    def require_driven(self, count: int) -> None:
        """Raises a ``ValueError`` where it is known that the law is not one for ``count`` driven masses."""

    def kinks(self) -> Float[Array, " kinks"]:
        """The times at which u or one of its derivatives jumps."""
        return jnp.zeros((0,), dtype=default_dtype())

    def prepare(self) -> "AbstractLaw":
        """The same law, ready to be evaluated many times."""
        return self


class FunctionLaw(AbstractLaw):
    """u(t, state) = function(t, state, parameters), for any function that JAX can trace.

    ``function`` is kept as it is, so pass the same one each time: a new lambda compiles anew.

    **Arguments:**

    - ``function``: of (t, state, parameters), to θ̈ of each driven mass, rad/time², or length/time² in a tube,
      shape (driven,).
    - ``parameters``: arrays, in any PyTree, that it is given; they can be swept and differentiated.
    - ``kink_times``: times, shape (kinks,), at which it jumps or bends.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, FunctionLaw
    >>> def brake(t, state, strength):
    ...     return -strength * state.thetadot
    >>> law = FunctionLaw(brake, 3.0)
    >>> law(jnp.array(0.0), BallState(theta=[0.0, 1.0], thetadot=[0.5, 2.0]))
    Array([-1.5, -6. ], dtype=float64)
    """

    function: Callable[[Float[Array, ""], State, PyTree], Float[Array, " driven"]] = eqx.field(static=True)
    parameters: PyTree = None
    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=numbers("kink_times", ("kinks",)), default=())

    def __check_init__(self):
        require_callable("function", self.function, "t", "state", "parameters")

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        return self.function(t, state, self.parameters)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times


class FollowSchedules(AbstractLaw):
    """u(t) = θ̈(t) of given schedules, so that θ and θ̇ are integrated as in the paper.

    Where θ̈ of several schedules jumps at one time, the derivative of a solve with respect to that time
    belongs to all of them together; with the schedules prescribed, each has its own.

    **Arguments:**

    - ``schedules``: one for each driven mass, in the order of the masses.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, FollowSchedules, Pulse
    >>> law = FollowSchedules((Pulse(0.0), Pulse(0.0, height=-2.0)))
    >>> law(jnp.array(0.05), BallState(theta=[0.0, 0.0], thetadot=[0.0, 0.0]))
    Array([ 1., -2.], dtype=float64)
    """

    schedules: tuple[AbstractSchedule, ...]

    def __check_init__(self):
        require_each("schedules", self.schedules, AbstractSchedule, "a schedule, such as Pulse(...)")

    def require_driven(self, count: int) -> None:
        _require_count("schedules", self.schedules, count)

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        return jnp.stack([schedule.derivatives(t)[2] for schedule in self.schedules])

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([schedule.kinks() for schedule in self.schedules])

    def prepare(self) -> "FollowSchedules":
        return FollowSchedules(tuple(schedule.prepare() for schedule in self.schedules))


class Servo(AbstractLaw):
    """u = −stiffness (θ − target(t)) − damping (θ̇ − target rate) + target acceleration, mass by mass.

    **Arguments:**

    - ``targets``: a schedule for each driven mass, in the order of the masses.
    - ``stiffness``: 1/time², shape (driven,).
    - ``damping``: 1/time, shape (driven,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, ConstantRate, Servo
    >>> law = Servo((ConstantRate(1.0),), stiffness=[4.0], damping=[2.0])
    >>> law(jnp.array(0.0), BallState(theta=[0.0], thetadot=[0.5]))  # −4 (0 − 1) − 2 · 0.5
    Array([3.], dtype=float64)
    """

    targets: tuple[AbstractSchedule, ...]
    stiffness: Float[Array, "*group driven"] = eqx.field(converter=numbers("stiffness", ("driven",)))
    damping: Float[Array, "*group driven"] = eqx.field(converter=numbers("damping", ("driven",)))

    def __check_init__(self):
        require_each("targets", self.targets, AbstractSchedule, "a schedule, such as Pulse(...)")
        for name in ("stiffness", "damping"):
            require_shape(name, getattr(self, name), (len(self.targets),))

    def require_driven(self, count: int) -> None:
        _require_count("targets", self.targets, count)

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        target, rate, acceleration = (
            jnp.stack(values) for values in zip(*(s.derivatives(t) for s in self.targets), strict=True)
        )
        return acceleration - self.stiffness * (state.theta - target) - self.damping * (state.thetadot - rate)

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([schedule.kinks() for schedule in self.targets])

    def prepare(self) -> "Servo":
        return Servo(tuple(s.prepare() for s in self.targets), self.stiffness, self.damping)


def _require_count(name: str, schedules: tuple[AbstractSchedule, ...], count: int) -> None:
    if len(schedules) != count:
        raise ValueError(
            f"Argument `{name}` of the law must have one schedule for each driven mass, {count} in all, but it has "
            f"{len(schedules)}."
        )
