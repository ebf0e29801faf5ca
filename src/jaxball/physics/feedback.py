"""Feedback laws: θ̈ = u(t, state) for the masses and joints whose θ̈ is not given otherwise.

A body takes one as its ``law``. Sampled feedback along a motion is in :mod:`jaxball.control`.
"""

import abc
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import call_with, require_callable_with, require_count, require_each, traceable
from ..interface.printing import Printed
from ..numerics.arrays import default_dtype, require_shape
from ..numerics.declare import ACCELERATION, NOT_NEGATIVE, PER_TIME, PER_TIME_SQUARED, Dimension, number, number_or_none
from ..numerics.functions import OfKinkedFunctionOfState
from ..numerics.kinks import kinks_of_function, kinks_seen
from .prescribed.schedules import AbstractSchedule
from .prescribed.signals import AbstractSignal, as_signal
from .state import ReducedState, State


class AbstractLaw(Printed):
    """A law that gives θ̈ of every :class:`~jaxball.Driven` mass and :class:`~jaxball.Accelerated` joint.

    They are in the order of the body's ``coordinates``: the masses, then the joints of each mechanism.
    """

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        """Computes u(t, state)."""

    def among(self, driven: Sequence[int], t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        """Computes u(t, state), where ``driven`` are the indices in the state's ``theta`` that the law drives."""
        return self(t, state)

    def require_driven(self, count: int) -> None:
        """Raises a ``ValueError`` if the law is known not to fit ``count`` driven masses."""

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which u or one of its derivatives jumps."""
        return jnp.zeros((0,), dtype=default_dtype())

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        """Returns the kinks for such a state; of a class without ``kinks`` of its own, the ones seen in its trace."""
        if type(self).kinks is not AbstractLaw.kinks:
            return self.kinks()
        return kinks_seen(self, type(self).__call__, state)

    def prepare(self) -> "AbstractLaw":
        """Returns the same law, ready to be evaluated many times."""
        return self


class FunctionLaw(OfKinkedFunctionOfState, AbstractLaw):
    """u(t, state) = function(t, state, parameters), for any function that JAX can trace.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.

    **Arguments:**

    - ``function``: of (t, state, parameters), to θ̈ of each driven mass, rad/time², or length/time² in a tube,
      shape (driven,).
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``kink_times``: the times at which it jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, FunctionLaw
    >>> def brake(t, state, strength):
    ...     return -strength * state.thetadot
    >>> law = FunctionLaw(brake, 3.0)
    >>> law(jnp.array(0.0), BallState(theta=[0.0, 1.0], thetadot=[0.5, 2.0]))
    Array([-1.5, -6. ], dtype=float64)
    """

    def __check_init__(self):
        require_callable_with("function", self.function, self.parameters, "t", "state")

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        with traceable("function", self.function):
            return call_with(self.function, t, state, parameters=self.parameters)

    def kinks_with(self, state: State) -> Float[Array, " kinks"]:
        return kinks_of_function(self, state)


class FollowSchedules(AbstractLaw):
    """u(t) = θ̈(t) of given schedules, so that θ and θ̇ are integrated as in the paper.

    Where θ̈ of several schedules jumps at the same time, a solve has one derivative with respect to that time, shared
    by all of them; with the schedules prescribed, each has its own.

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
        require_count("Argument `schedules` of the law", len(self.schedules), count, "driven mass")

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
    - ``stiffness``: one for each driven coordinate, 1/time², shape (driven,).
    - ``damping``: one for each driven coordinate, 1/time, shape (driven,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, ConstantRate, Servo
    >>> law = Servo((ConstantRate(1.0),), stiffness=[4.0], damping=[2.0])
    >>> law(jnp.array(0.0), BallState(theta=[0.0], thetadot=[0.5]))  # −4 (0 − 1) − 2 · 0.5
    Array([3.], dtype=float64)
    """

    targets: tuple[AbstractSchedule, ...]
    stiffness: Float[Array, "*group driven"] = eqx.field(converter=number(PER_TIME_SQUARED, NOT_NEGATIVE, by_size=True))
    damping: Float[Array, "*group driven"] = eqx.field(converter=number(PER_TIME, NOT_NEGATIVE, by_size=True))

    def __check_init__(self):
        require_each("targets", self.targets, AbstractSchedule, "a schedule, such as Pulse(...)")
        for name in ("stiffness", "damping"):
            require_shape(name, getattr(self, name), (len(self.targets),))

    def require_driven(self, count: int) -> None:
        require_count("Argument `targets` of the law", len(self.targets), count, "driven mass")

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        return self.among(range(state.theta.shape[-1]), t, state)

    def among(self, driven: Sequence[int], t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        places = np.asarray(driven, dtype=int)
        target, rate, acceleration = (
            jnp.stack(values) for values in zip(*(s.derivatives(t) for s in self.targets), strict=True)
        )
        theta, thetadot = state.theta[places], state.thetadot[places]
        return acceleration - self.stiffness * (theta - target) - self.damping * (thetadot - rate)

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([schedule.kinks() for schedule in self.targets])

    def prepare(self) -> "Servo":
        return Servo(tuple(s.prepare() for s in self.targets), self.stiffness, self.damping)


class LinearLaw(AbstractLaw):
    """u = theta θ + thetadot θ̇ + Omega Ω + Gamma Γ + z (z) + omega ω + signals(t): linear, each factor a matrix.

    It has a row for each driven coordinate: the :class:`~jaxball.Driven` masses and :class:`~jaxball.Accelerated`
    joints and angles of a plate, in the order of ``coordinates`` of the body. Ω and Γ are in body axes, the position z
    and ω = ΛΩ in space axes: of a ball that rolls on a plate at rest, ω₂ and −ω₁ are its velocity over its radius.

    **Arguments:**

    - ``theta``: the factors of every θ of the state, 1/time², shape (driven, coordinates).
    - ``thetadot``: the factors of every θ̇, 1/time, shape (driven, coordinates).
    - ``Omega``: the factors of Ω, 1/time, shape (driven, 3).
    - ``Gamma``: the factors of Γ, rad/time², shape (driven, 3).
    - ``z``: the factors of the position, 2 of a ball and 1 of a disk, rad/(length time²), shape (driven, 2), and
      (driven, 1) for a disk.
    - ``signals``: the terms added, one for each driven coordinate, rad/time². A number, a
      :class:`~jaxball.PiecewiseSignal` or a schedule.
    - ``omega``: the factors of ω, in space axes, 1/time, shape (driven, 3).

    A factor that is not given is 0. For a mass in a tube or a slider, θ, θ̇ and θ̈ have length instead of rad.

    **Raises:** ``ValueError`` when a factor does not have a row for each driven coordinate, and, where it is evaluated,
    a column for each number of the state that it multiplies; ``TypeError`` for ``z`` and ``omega`` where the state has
    no position and no orientation.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import BallState, LinearLaw
    >>> law = LinearLaw(theta=[[-4.0]], thetadot=[[-2.0]], Gamma=[[3.0, 0.0, 0.0]], signals=[0.5])
    >>> law(jnp.array(0.0), BallState(theta=[1.0], thetadot=[0.25]))  # −4 · 1 − 2 · 0.25 + 0.5
    Array([-4.], dtype=float64)
    """

    theta: Float[Array, "*group driven coordinates"] | None = eqx.field(
        converter=number_or_none(PER_TIME_SQUARED), default=None
    )
    thetadot: Float[Array, "*group driven coordinates"] | None = eqx.field(
        converter=number_or_none(PER_TIME), default=None
    )
    Omega: Float[Array, "*group driven 3"] | None = eqx.field(converter=number_or_none(PER_TIME), default=None)
    Gamma: Float[Array, "*group driven 3"] | None = eqx.field(converter=number_or_none(ACCELERATION), default=None)
    z: Float[Array, "*group driven n"] | None = eqx.field(
        converter=number_or_none(Dimension(-1, -2, 0, 1)), default=None
    )
    signals: tuple[AbstractSignal | AbstractSchedule, ...] = eqx.field(
        converter=lambda given: tuple(as_signal(f"signals[{index}]", signal) for index, signal in enumerate(given)),
        default=(),
    )
    omega: Float[Array, "*group driven 3"] | None = eqx.field(converter=number_or_none(PER_TIME), default=None)

    def __check_init__(self):
        counts = self._counts()
        if len(set(counts.values())) != 1:
            has = ", ".join(f"{count} in `{name}`" for name, count in counts.items()) or "none in any of them"
            raise ValueError(
                "Arguments `theta`, `thetadot`, `Omega`, `Gamma`, `z`, `omega` and `signals`, as far as they are "
                f"given, must have one row or entry for each driven coordinate, but there are {has}."
            )

    def _factors(self) -> dict[str, Array]:
        names = ("theta", "thetadot", "Omega", "Gamma", "z", "omega")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def _counts(self) -> dict[str, int]:
        """Returns the number of driven coordinates, by each argument that is given."""
        signals = {"signals": len(self.signals)} if self.signals else {}
        return {name: factor.shape[0] for name, factor in self._factors().items()} | signals

    def require_driven(self, count: int) -> None:
        for name, size in self._counts().items():
            require_count(f"Argument `{name}` of the law", size, count, "driven coordinate")

    def __call__(self, t: Float[Array, ""], state: State) -> Float[Array, " driven"]:
        u = jnp.stack([signal(t) for signal in self.signals]) if self.signals else None
        for name, factor in self._factors().items():
            term = jnp.sum(factor * _numbers_of(state, name, factor)[None], axis=1)
            u = term if u is None else u + term
        assert u is not None
        return u

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([signal.kinks() for signal in self.signals]) if self.signals else AbstractLaw.kinks(self)

    def prepare(self) -> "LinearLaw":
        signals = tuple(signal.prepare() for signal in self.signals)
        return LinearLaw(self.theta, self.thetadot, self.Omega, self.Gamma, self.z, signals, self.omega)


def _numbers_of(state: State, name: str, factor: Float[Array, "driven columns"]) -> Float[Array, " columns"]:
    """Returns the numbers that a factor of a linear law multiplies: the entry ``name`` of the state, or ω."""
    if name == "omega" and not isinstance(state, ReducedState):
        return jnp.sum(state.Lambda * state.Omega[None], axis=1)
    value = getattr(state, name, None)
    if value is None:
        raise TypeError(
            f"Argument `{name}` of the law must be None for a {type(state).__name__}, which has no position; use a "
            "state with `z`."
        )
    value = jnp.atleast_1d(value)
    if factor.shape[1] != value.shape[0]:
        raise ValueError(
            f"Argument `{name}` of the law must have {value.shape[0]} columns, one for each number in `{name}` of a "
            f"{type(state).__name__}, but it has {factor.shape[1]}."
        )
    return value
