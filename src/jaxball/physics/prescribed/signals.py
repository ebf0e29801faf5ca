"""Signals: numbers prescribed as functions of time, which may jump, such as the torque of a motor."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import refusal
from ...interface.printing import Printed
from ...numerics.arrays import Numbers, numbers, require_not_nan, to_array
from ...numerics.declare import ANGLE, INCREASING, TIME, number
from ...numerics.kinks import kinks_seen
from .schedules import SORT_INTERVALS, AbstractSchedule, PiecewiseAcceleration, require_increasing


class AbstractSignal(Printed):
    """A prescribed number s(t), which may jump at its kinks."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Computes s(t); at a jump, the value of the later side."""

    def kinks(self) -> Float[Array, " kinks"]:
        """Returns the times at which s or one of its derivatives jumps.

        By default, those at which the trace of ``__call__`` compares the time with something else.
        """
        return kinks_seen(self, type(self).__call__)

    def prepare(self) -> "AbstractSignal":
        """Returns the same signal, ready to be evaluated many times."""
        return self


class AbstractIntegrableSignal(AbstractSignal):
    """A signal whose integral is known in closed form.

    Derivatives of a solve with respect to the times of jumps of a motor's signal are then right for each motor, even
    when several jump at once.
    """

    @abc.abstractmethod
    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Computes the integral of s up to t."""

    def limit(self, limit: Float[Array, ""]) -> "AbstractIntegrableSignal | None":
        """Limits the signal to ±limit, if its class stays the same; else None, because its pieces would change."""
        return None


class ConstantSignal(AbstractSignal):
    """s(t) = value.

    **Arguments:**

    - ``value``: a number.

    **Example:**

    >>> from jaxball import Motor
    >>> Motor(0.5).signal
    ConstantSignal(value=0.5)
    """

    value: Float[Array, "*group"] = eqx.field(converter=number())

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.value


class PiecewiseSignal(AbstractIntegrableSignal):
    """s(t) as a piecewise polynomial: steps, if there is one number per piece.

    On times[j] ≤ t < times[j + 1], s = Σ_k values[j, k] (t − times[j])ᵏ; before the first time and after the last, 0.

    **Arguments:**

    - ``times``: the ends of the intervals, increasing, shape (n + 1,).
    - ``values``: a row for each interval, the coefficients of a polynomial in t − ``times[j]``, the constant first,
      each in the unit of the one before it over time, shape (n, k). Numbers of shape (n,) are steps.

    **Raises:** ``ValueError`` when ``values`` does not have one row for each interval, and for ``times`` that do not
    increase.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import PiecewiseSignal
    >>> steps = PiecewiseSignal(times=[0.0, 1.0, 2.0], values=[0.5, -0.5])
    >>> [float(steps(jnp.array(t))) for t in (0.0, 1.0, 2.0)]
    [0.5, -0.5, 0.0]
    """

    times: Float[Array, "*group n_plus_one"] = eqx.field(converter=number(TIME, INCREASING))
    # The dimension is that of what the signal drives, for which an angle stands here.
    values: Float[Array, "*group n k"] = eqx.field(converter=number(ANGLE, by_size=True))

    def __init__(self, times: Numbers, values: Numbers):
        self.times = numbers("times", ("n_plus_one",))(times)
        rows = to_array(values, "values")
        self.values = rows[:, None] if rows.ndim == 1 else rows
        if self.values.ndim != 2 or self.times.shape[0] != self.values.shape[0] + 1:
            raise ValueError(
                "Argument `values` must have the shape (n,) or (n, k), a row for each of the n intervals between the "
                f"n + 1 `times`, but the shapes are {self.values.shape} and {self.times.shape}."
            )
        require_increasing(self.times, SORT_INTERVALS)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare().impulse(t)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.times

    def limit(self, limit: Float[Array, ""]) -> "PiecewiseSignal | None":
        if self.values.shape[-1] > 1:
            return None
        return eqx.tree_at(lambda signal: signal.values, self, jnp.clip(self.values, -limit, limit))

    def prepare(self) -> "IntegratedSignal":
        zero = jnp.zeros_like(self.times[0])
        return IntegratedSignal(PiecewiseAcceleration(zero, self.times, self.values, zero).prepare())


class IntegratedSignal(AbstractIntegrableSignal):
    """The second derivative of a schedule, whose first is its integral."""

    schedule: AbstractSchedule

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.schedule.derivatives(t)[2]

    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.schedule.derivatives(t)[1]

    def kinks(self) -> Float[Array, " kinks"]:
        return self.schedule.kinks()


def as_signal(name: str, given: Any) -> AbstractSignal | AbstractSchedule:
    """Returns a signal, a schedule, or a number as a constant signal.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` for NaN.
    """
    if isinstance(given, AbstractSignal | AbstractSchedule):
        return given
    try:
        number = numbers(name)(given)
    except TypeError:
        raise refusal(name, "a number, a signal such as PiecewiseSignal(...), or a schedule", given) from None
    require_not_nan(name, number)
    return ConstantSignal(number)


class ToSignal:
    """The converter of a field that is a signal, by :func:`as_signal`."""

    name = "signal"

    def belong_to(self, name: str, annotation: Any) -> None:
        """Takes the name of the field."""
        self.name = name

    def __call__(self, given: AbstractSignal | AbstractSchedule | Numbers) -> AbstractSignal | AbstractSchedule:
        return as_signal(self.name, given)
