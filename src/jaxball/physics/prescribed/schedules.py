"""Schedules θ(t): where a mass is on its rail, prescribed in closed form."""

import abc
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import call_with, require_function
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...numerics.arrays import AnyArray, Numbers, a_number, numbers, to_array
from ...numerics.calculus import two_derivatives
from ...numerics.declare import ACCELERATION, ANGLE, INCREASING, RATE, TIME, number
from ...numerics.functions import HarmonicSeries, OfFunction, PiecewisePolynomial, cubic_spline_with_slopes
from ...numerics.kinks import kinks_of_function, kinks_seen

AnyPiecewise = TypeVar("AnyPiecewise", bound="AbstractPiecewise")
SORT_INTERVALS = "sort the times, with what belongs to the intervals between them"


def require_increasing(times: Float[AnyArray, "*group n"], remedy: str) -> None:
    """Raises a ``ValueError`` that ends with ``remedy`` unless the argument ``times`` increases, where it is known."""
    if is_traced(times):
        return
    wrong = np.argwhere(np.diff(np.asarray(times)) <= 0)
    if len(wrong):
        *group, row = wrong[0].tolist()
        before, here = np.asarray(times)[(*group, slice(row, row + 2))]
        raise ValueError(
            f"Argument `times` must be increasing, but `times[{row + 1}]` is {here} after {before}; {remedy}."
        )


class AbstractSchedule(Printed):
    """A prescribed parameter θ(t) of a mass on its rail.

    A family implements ``__call__`` and ``shift``, and ``kinks`` where θ̈ has jumps or corners.
    """

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Computes θ(t), in radians on a closed rail and in units of length in a tube."""

    @abc.abstractmethod
    def shift(self, by: Float[Array, ""]) -> "AbstractSchedule":
        """Returns the schedule θ(t) + ``by``."""

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which θ̈ or one of its derivatives jumps; θ̇ must not. The integrator ends steps at
        them.

        By default, those at which the trace of ``__call__`` compares the time with something else.
        """
        return kinks_seen(self, type(self).__call__)

    def prepare(self) -> "AbstractSchedule":
        """Returns the same schedule, ready to be evaluated many times."""
        return self

    def derivatives(self, t: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """Computes θ(t), θ̇(t) and θ̈(t), the rates by forward mode; at a kink, the rates of the later side."""
        return two_derivatives(self, t)

    def starting_at(self, theta: Numbers, t: Numbers) -> "AbstractSchedule":
        """Returns the schedule shifted by a constant so that it takes the value ``theta`` at time ``t``."""
        return self.shift(to_array(theta) - self.prepare()(to_array(t)))


class FunctionSchedule(OfFunction, AbstractSchedule):
    """θ(t) = theta + function(t, parameters), for any function that JAX can differentiate twice.

    ``function`` is compiled into programs: one that is written anew compiles again unless it only uses equal numbers.
    Give the times at which its second derivative jumps in ``kink_times``.

    **Arguments:**

    - ``function``: of (t, parameters), to an angle in rad, or a length in a tube.
    - ``parameters``: arrays, in any PyTree, passed to it; they can be swept and differentiated.
    - ``theta``: a constant added to it, in the same unit.
    - ``kink_times``: the times at which its second derivative jumps or has a kink, shape (kinks,).

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import FunctionSchedule
    >>> def settling(t, rate):
    ...     return 1.0 - jnp.exp(-rate * t)
    >>> theta, rate, acceleration = FunctionSchedule(settling, 2.0).derivatives(jnp.array(0.0))
    >>> float(theta), float(rate), float(acceleration)
    (0.0, 2.0, -4.0)
    """

    theta: Float[Array, "*group"] = eqx.field(converter=number(ANGLE), default=0.0)
    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=number(TIME), default=())

    def __check_init__(self):
        require_function("function", self.function, (), t=a_number(), parameters=self.parameters)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.theta + call_with(self.function, t, parameters=self.parameters)

    def shift(self, by: Float[Array, ""]) -> "FunctionSchedule":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return kinks_of_function(self)


class ConstantRate(AbstractSchedule):
    """θ(t) = theta + rate t; with ``rate`` zero, the mass is held in place.

    **Arguments:**

    - ``theta``: θ at time 0, rad. In a tube or along a slider θ is a length.
    - ``rate``: θ̇, rad/time; 0 if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import ConstantRate
    >>> float(ConstantRate(0.5, rate=2.0)(jnp.array(3.0)))
    6.5
    """

    theta: Float[Array, "*group"] = eqx.field(converter=number(ANGLE))
    rate: Float[Array, "*group"] = eqx.field(converter=number(RATE), default=0.0)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.theta + self.rate * t

    def shift(self, by: Float[Array, ""]) -> "ConstantRate":
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)


class Sinusoids(AbstractSchedule):
    """θ(t) = theta + rate t + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``theta``: the constant part of θ, rad. In a tube or along a slider θ is a length.
    - ``amplitude``: one for each sinusoid, rad, shape (terms,); no sinusoids if not given.
    - ``frequency``: one for each sinusoid, rad/time, shape (terms,).
    - ``phase``: one for each sinusoid, rad, shape (terms,); zero if not given.
    - ``rate``: the constant part of θ̇, rad/time.

    **Raises:** ``ValueError`` when ``amplitude``, ``frequency`` and ``phase`` differ in length.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Sinusoids
    >>> theta, rate, _ = Sinusoids(1.0, amplitude=[0.5], frequency=[2.0]).derivatives(jnp.array(0.0))
    >>> float(theta), float(rate)
    (1.0, 1.0)
    """

    series: HarmonicSeries
    rate: Float[Array, "*group"]

    def __init__(
        self,
        theta: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
        rate: Numbers = 0.0,
    ):
        self.series = HarmonicSeries(theta, amplitude, frequency, phase)
        self.rate = numbers("rate")(rate)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.series(t) + self.rate * t

    def shift(self, by: Float[Array, ""]) -> "Sinusoids":
        return eqx.tree_at(lambda s: s.series.constant, self, self.series.constant + jnp.asarray(by))


class PiecewiseSchedule(AbstractSchedule):
    """A schedule that is a piecewise polynomial already."""

    curve: PiecewisePolynomial

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.curve(t)

    def shift(self, by: Float[Array, ""]) -> "PiecewiseSchedule":
        return eqx.tree_at(lambda s: s.curve.coefficients, self, self.curve.coefficients.at[..., 0].add(by))

    def kinks(self) -> Float[Array, " kinks"]:
        return self.curve.breaks


class AbstractPiecewise(AbstractSchedule):
    """A schedule that becomes a piecewise polynomial, with values, or a first one, ``theta``."""

    @abc.abstractmethod
    def prepare(self) -> PiecewiseSchedule:
        """Returns the polynomials of the schedule."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def shift(self: AnyPiecewise, by: Float[Array, ""]) -> AnyPiecewise:
        return eqx.tree_at(lambda s: s.theta, self, self.theta + by)  # pyright: ignore[reportAttributeAccessIssue]


class PiecewiseAcceleration(AbstractPiecewise):
    """θ̈(t) as a piecewise polynomial, integrated twice exactly.

    On times[j] ≤ t < times[j + 1], θ̈ = Σ_k accelerations[j, k] (t − times[j])ᵏ; before the first
    time and after the last, θ̈ = 0. The paper's pulse is times (0, .1, .2) and accelerations
    ((1, 0), (1, −10)).

    **Arguments:**

    - ``theta``: θ at ``times[0]``, rad. In a tube or along a slider θ is a length.
    - ``rate``: θ̇ at ``times[0]``, rad/time.
    - ``times``: the ends of the intervals, increasing, shape (n + 1,).
    - ``accelerations``: a row for each interval, the coefficients of θ̈ as a polynomial in t − ``times[j]``, the
      constant first, each in the unit of the one before it over time, rad/time², shape (n, k).

    **Raises:** ``ValueError`` when ``accelerations`` does not have one row for each interval, and for ``times`` that do
    not increase.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import PiecewiseAcceleration
    >>> schedule = PiecewiseAcceleration(0.0, times=[0.0, 1.0, 2.0], accelerations=[[1.0], [-1.0]])
    >>> float(schedule(jnp.array(2.0)))  # sped up for one unit of time, then slowed down
    1.0
    """

    theta: Float[Array, "*group"] = eqx.field(converter=number(ANGLE))
    times: Float[Array, "*group n_plus_one"] = eqx.field(converter=number(TIME, INCREASING))
    accelerations: Float[Array, "*group n k"] = eqx.field(converter=number(ACCELERATION))
    rate: Float[Array, "*group"] = eqx.field(converter=number(RATE), default=0.0)

    def __check_init__(self):
        times, rows = self.times.shape, self.accelerations.shape
        if len(rows) < 2 or len(times) < 1 or times[-1] != rows[-2] + 1:
            raise ValueError(
                "Argument `accelerations` must have the shape (n, k), a row for each of the n "
                f"intervals between the n + 1 `times`, but the shapes are {rows} and {times}."
            )
        require_increasing(self.times, SORT_INTERVALS)

    def prepare(self) -> PiecewiseSchedule:
        k = self.accelerations.shape[1]
        power = jnp.arange(k, dtype=self.accelerations.dtype)
        bends = self.accelerations / ((power + 1) * (power + 2))[None]
        h = jnp.diff(self.times)[:, None]
        # Sums over the intervals, not a loop over them, which takes long to compile where there are many.
        changes = jnp.sum(bends * (power + 2)[None] * h ** (power + 1)[None], axis=1)
        rate = self.rate + jnp.concatenate([jnp.zeros_like(self.rate)[None], jnp.cumsum(changes)])
        changes = rate[:-1] * h[:, 0] + jnp.sum(bends * h ** (power + 2)[None], axis=1)
        theta = self.theta + jnp.concatenate([jnp.zeros_like(self.theta)[None], jnp.cumsum(changes)])
        # One piece for each interval and one after the last, where θ̈ = 0; another goes before the first.
        line = jnp.stack([theta, rate], axis=1)
        bends = jnp.concatenate([bends, jnp.zeros((1, k), dtype=bends.dtype)])
        pieces = jnp.concatenate([line, bends], axis=1)
        first = jnp.concatenate([pieces[:1, :2], jnp.zeros((1, k), dtype=bends.dtype)], axis=1)
        return PiecewiseSchedule(
            PiecewisePolynomial(
                breaks=self.times,
                origins=jnp.concatenate([self.times[:1], self.times]),
                coefficients=jnp.concatenate([first, pieces]),
            )
        )

    def kinks(self) -> Float[Array, " kinks"]:
        return self.times


class Pulse(AbstractPiecewise):
    """θ̈ = height until ``hold``, then falling linearly to zero at ``end``; zero before ``start``.

    The defaults are ``eq_prescribed_u_ball``: u = 1 on [0, .1] and 2 − 10 t on [.1, .2]. Section 4
    gives the disk's odd masses ``height`` −1, ``eq_prescribed_u_disk``.

    **Arguments:**

    - ``theta``: θ at ``start``, rad. In a tube or along a slider θ is a length.
    - ``rate``: θ̇ at ``start``, rad/time.
    - ``height``: θ̈ from ``start`` to ``hold``, rad/time².
    - ``start``: when θ̈ begins, a time.
    - ``hold``: when θ̈ begins to fall, not before ``start``, a time.
    - ``end``: when θ̈ is 0 again, after ``hold``, a time.

    **Raises:** ``ValueError`` when ``hold`` is before ``start``, or ``end`` is not after ``hold``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Pulse
    >>> theta, rate, acceleration = Pulse(0.0, height=2.0).derivatives(jnp.array(0.1))
    >>> round(float(theta), 6), round(float(rate), 6), round(float(acceleration), 6)
    (0.01, 0.2, 2.0)
    """

    theta: Float[Array, "*group"] = eqx.field(converter=number(ANGLE))
    height: Float[Array, "*group"] = eqx.field(converter=number(ACCELERATION), default=1.0)
    rate: Float[Array, "*group"] = eqx.field(converter=number(RATE), default=0.0)
    start: Float[Array, "*group"] = eqx.field(converter=number(TIME), default=0.0)
    hold: Float[Array, "*group"] = eqx.field(converter=number(TIME), default=0.1)
    end: Float[Array, "*group"] = eqx.field(converter=number(TIME), default=0.2)

    def __check_init__(self):
        if is_traced(self.start) or is_traced(self.hold) or is_traced(self.end):
            return
        start, hold, end = np.asarray(self.start), np.asarray(self.hold), np.asarray(self.end)
        remedy = "a pulse that starts later needs all three"
        if np.any(hold < start):
            raise ValueError(f"Argument `hold` must be not before `start` = {start}, but it is {hold}; {remedy}.")
        if np.any(end <= hold):
            raise ValueError(f"Argument `end` must be later than `hold` = {hold}, but it is {end}; {remedy}.")

    def prepare(self) -> PiecewiseSchedule:
        u = self.height
        falling = -u / (self.end - self.hold)
        accelerations = jnp.stack([u, jnp.zeros_like(u), u, falling]).reshape(2, 2)
        return PiecewiseAcceleration(self.theta, self.kinks(), accelerations, self.rate).prepare()

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.stack([self.start, self.hold, self.end])


class Waypoints(AbstractPiecewise):
    """The smooth schedule that takes ``theta`` at ``times``: a cubic spline with θ̈ continuous.

    Before the first waypoint and after the last, the mass moves at the constant rate ``end_rates`` (by default at
    rest).

    **Arguments:**

    - ``times``: the times of the waypoints, two or more, increasing, shape (n,).
    - ``theta``: θ at these times, rad, shape (n,). In a tube or along a slider θ is a length.
    - ``end_rates``: θ̇ at the first and the last time, rad/time, shape (2,).

    **Raises:** ``ValueError`` unless ``times`` increase, and ``times`` and ``theta`` have the same length, two or more.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Waypoints
    >>> schedule = Waypoints(times=[0.0, 1.0, 2.0], theta=[0.0, 0.5, 0.0])
    >>> round(float(schedule(jnp.array(1.0))), 6)
    0.5
    """

    times: Float[Array, "*group n"] = eqx.field(converter=number(TIME, INCREASING))
    theta: Float[Array, "*group n"] = eqx.field(converter=number(ANGLE))
    end_rates: Float[Array, "*group 2"] = eqx.field(converter=number(RATE), default=(0.0, 0.0))

    def __check_init__(self):
        if self.times.shape != self.theta.shape or self.times.ndim < 1 or self.times.shape[-1] < 2:
            raise ValueError(
                "Arguments `times` and `theta` must have the same length, two or more, but their shapes "
                f"are {self.times.shape} and {self.theta.shape}."
            )
        require_increasing(self.times, "sort the waypoints, and keep one of those with equal times")

    def prepare(self) -> PiecewiseSchedule:
        inner = cubic_spline_with_slopes(self.times, self.theta, self.end_rates)
        still = jnp.zeros((2,), dtype=self.theta.dtype)
        first = jnp.concatenate([jnp.stack([self.theta[0], self.end_rates[0]]), still])
        last = jnp.concatenate([jnp.stack([self.theta[-1], self.end_rates[1]]), still])
        return PiecewiseSchedule(
            PiecewisePolynomial(
                breaks=self.times,
                origins=jnp.concatenate([self.times[:1], self.times]),
                coefficients=jnp.concatenate([first[None], inner, last[None]]),
            )
        )

    def kinks(self) -> Float[Array, " kinks"]:
        return self.times
