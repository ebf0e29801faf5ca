"""Logs: signals and schedules by their values at recorded times, up to hundreds of thousands, interpolated."""

import abc
import functools
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...interface.arguments import refusal
from ...interface.compat import is_traced
from ...interface.printing import Printed
from ...interface.wording import one_of, tell_numbers_apart
from ...numerics.arrays import AnyArray
from ...numerics.declare import number
from ...numerics.functions import PiecewisePolynomial, not_a_knot_cubic_spline
from ...numerics.kinks import CLOSE_KINKS
from ..conditions import ExplainedCondition, Problem
from .schedules import AbstractSchedule, PiecewiseSchedule, require_increasing
from .signals import AbstractIntegrableSignal

Interpolation: TypeAlias = Literal["previous", "linear", "spline"]
OutsideOfSignal: TypeAlias = Literal["refuse", "hold", "zero"]
OutsideOfSchedule: TypeAlias = Literal["refuse", "continue"]

MOST_KINKS = 256  # of a log: a step ends at each of them, which costs less than finding more of them by the error
# In a longer log, a jump or a corner is a kink where it exceeds the mean of all by this factor, which those of a smooth
# signal and of noise do not: a sinusoid's are up to 1.6 times the mean, of 10⁵ Gaussian numbers up to 6.
OUTSTANDING = 8.0


class AbstractRecorded(Printed):
    """What signals and schedules from a log have in common.

    **Arguments:** as :class:`RecordedSignal`.
    """

    times: eqx.AbstractVar[Float[Array, "*group n"]]
    values: eqx.AbstractVar[Float[Array, "*group n"]]
    choices_outside: ClassVar[tuple[str, ...]]

    @property
    @abc.abstractmethod
    def is_bounded(self) -> bool:
        """Whether a run must lie within the log."""

    @abc.abstractmethod
    def prepare(self) -> Any:
        """Returns the curve through the samples."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare()(t)

    def __check_init__(self):
        if self.times.shape != self.values.shape or self.times.shape[-1] < 2:
            raise ValueError(
                "Arguments `times` and `values` must have the same length, two or more, but their shapes are "
                f"{self.times.shape} and {self.values.shape}."
            )
        for name, array in (("times", self.times), ("values", self.values)):
            wrong = np.flatnonzero([] if is_traced(array) else ~np.isfinite(np.asarray(array)))
            if len(wrong):
                raise ValueError(
                    f"Argument `{name}[{wrong[0]}]` must be a finite number, but it is {array[wrong[0]]}; leave such "
                    "rows out, and the log is interpolated between those on both sides."
                )
        require_increasing(self.times, "sort the rows, and keep one of those with equal times")

    def covers(self, times: Float[AnyArray, " T"]) -> Any:
        """Returns whether the log lasts, up to rounding, from the first of ``times`` to the last, if it must, and
        increases.
        """
        log_times, start, end = jnp.asarray(self.times), times[0], times[-1]
        increases = jnp.all(log_times[1:] > log_times[:-1])
        if not self.is_bounded:
            return jnp.asarray(increases)
        rounding = CLOSE_KINKS * float(np.finfo(log_times.dtype).eps) * jnp.maximum(jnp.abs(start), jnp.abs(end))
        return increases & (log_times[0] <= start + rounding) & (log_times[-1] >= end - rounding)


def _require_one_of(name: str, value: Any, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise (ValueError if isinstance(value, str) else TypeError)(
            str(refusal(name, one_of([f'"{choice}"' for choice in choices]), value))
        )


class RecordedSignal(AbstractRecorded, AbstractIntegrableSignal):
    """s(t) from a log: its ``values`` at ``times``, and interpolated between them.

    Steps end at every sample of up to 258, and in a longer log where a jump (of "previous") or a corner (of "linear")
    is more than 8 times the mean of all, at up to 256 of these; otherwise they are as long as the tolerances allow. A
    gap in the log is an interval like any other.

    **Arguments:**

    - ``times``: increasing, shape (n,), with n two or more.
    - ``values``: s at these times, in the unit of the signal, shape (n,).
    - ``interpolation``: between the samples, "previous", the value of the last one, "linear", or "spline", the
      not-a-knot cubic spline. Its error is of the order h⁴, instead of h² and h, in the distance h of samples of a
      smooth signal.
    - ``outside``: before the first time and after the last, "hold" for the first and the last value, "zero" for 0, or
      "refuse" for a run that must not go beyond the log. It is then ``IMPOSSIBLE``.

    **Raises:** ``ValueError`` where ``times`` and ``values`` differ in length or have one entry, where times do not
    increase, and for numbers that are not finite, as far as they are known; for another word.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import RecordedSignal
    >>> signal = RecordedSignal(times=[0.0, 1.0, 2.0], values=[0.0, 1.0, 0.0])
    >>> float(signal(jnp.array(0.25)))
    0.25
    """

    choices_outside: ClassVar[tuple[str, ...]] = get_args(OutsideOfSignal)

    times: Float[Array, "*group n"] = eqx.field(converter=number())
    values: Float[Array, "*group n"] = eqx.field(converter=number())
    interpolation: Interpolation = eqx.field(static=True, default="linear")
    outside: OutsideOfSignal = eqx.field(static=True, default="refuse")

    def __check_init__(self):
        _require_one_of("interpolation", self.interpolation, get_args(Interpolation))
        _require_one_of("outside", self.outside, self.choices_outside)

    @property
    def is_bounded(self) -> bool:
        return self.outside == "refuse"

    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.prepare().impulse(t)

    def limit(self, limit: Float[Array, ""]) -> "RecordedSignal | None":
        if self.interpolation != "previous":
            return None
        return eqx.tree_at(lambda signal: signal.values, self, jnp.clip(self.values, -limit, limit))

    def kinks(self) -> Float[Array, " kinks"]:
        if self.interpolation == "spline":
            return _kinks(self.times, None)
        jumps = jnp.diff(self.values)
        return _kinks(self.times, jumps[:-1] if self.interpolation == "previous" else jnp.diff(self._slopes(jumps)))

    def prepare(self) -> "PreparedSignal":
        if self.interpolation == "spline":
            inner = not_a_knot_cubic_spline(self.times, self.values)
        elif self.interpolation == "linear":
            inner = jnp.stack([self.values[:-1], self._slopes(jnp.diff(self.values))], axis=1)
        else:
            inner = self.values[:-1, None]
        ends = jnp.zeros((2, inner.shape[1]), inner.dtype)
        if self.outside != "zero":
            ends = ends.at[:, 0].set(jnp.stack([self.values[0], self.values[-1]]))
        curve = _curve(self.times, ends[0], inner, ends[1])
        return PreparedSignal(curve, curve.integral(), self.kinks())

    def _slopes(self, jumps: Float[Array, " n_minus_one"]) -> Float[Array, " n_minus_one"]:
        return jumps / jnp.diff(self.times)


class PreparedSignal(AbstractIntegrableSignal):
    """A recorded signal as polynomials, with their integrals and its kinks."""

    curve: PiecewisePolynomial
    integral: PiecewisePolynomial
    kink_times: Float[Array, "*group kinks"]

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.curve(t)

    def impulse(self, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.integral(t)

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times


class RecordedSchedule(AbstractRecorded, AbstractSchedule):
    """θ(t) from a log: the not-a-knot cubic spline through its ``values`` at ``times``, with θ̇ and θ̈ continuous.

    Noise in θ is amplified in θ̈ by the inverse square of the distance of samples: filter a noisy log first. Steps end
    at the samples of a log of up to 258; in a longer one they are as long as the tolerances allow.

    **Arguments:**

    - ``times``: increasing, shape (n,), with n two or more.
    - ``values``: θ at these times, rad on a closed rail, without jumps by full turns, and length in a tube, shape (n,).
    - ``outside``: before the first time and after the last, "continue" for motion at the rate at that end, or "refuse"
      for a run that must not go beyond the log. It is then ``IMPOSSIBLE``.

    **Raises:** as :class:`RecordedSignal`.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import RecordedSchedule
    >>> times = jnp.linspace(0.0, 1.0, 101)
    >>> schedule = RecordedSchedule(times, times**3)
    >>> [round(float(rate), 6) for rate in schedule.derivatives(jnp.array(0.5))]
    [0.125, 0.75, 3.0]
    """

    choices_outside: ClassVar[tuple[str, ...]] = get_args(OutsideOfSchedule)
    interpolation: ClassVar[Interpolation] = "spline"  # the only one with θ̇ and θ̈

    times: Float[Array, "*group n"] = eqx.field(converter=number())
    values: Float[Array, "*group n"] = eqx.field(converter=number())
    outside: OutsideOfSchedule = eqx.field(static=True, default="refuse")

    def __check_init__(self):
        _require_one_of("outside", self.outside, self.choices_outside)

    @property
    def is_bounded(self) -> bool:
        return self.outside == "refuse"

    def shift(self, by: Float[Array, ""]) -> "RecordedSchedule":
        return eqx.tree_at(lambda s: s.values, self, self.values + by)

    def kinks(self) -> Float[Array, " kinks"]:
        return _kinks(self.times, None)

    def prepare(self) -> "PreparedSchedule":
        inner = not_a_knot_cubic_spline(self.times, self.values)
        h = self.times[-1] - self.times[-2]
        # The last piece, expanded about the last time, goes on beyond it.
        _, slope, half_bend, third = inner[-1]
        end = [
            self.values[-1],
            slope + h * (2 * half_bend + 3 * h * third),
            half_bend + 3 * h * third,
            third,
        ]
        first, last = inner[0], jnp.stack(end)
        if self.outside == "continue":
            first, last = first.at[2:].set(0.0), last.at[2:].set(0.0)
        return PreparedSchedule(_curve(self.times, first, inner, last), self.kinks())


class PreparedSchedule(PiecewiseSchedule):
    """A recorded schedule as polynomials, with its kinks."""

    kink_times: Float[Array, "*group kinks"]

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times


def _curve(
    times: Float[Array, " n"],
    first: Float[Array, " k"],
    inner: Float[Array, "n_minus_one k"],
    last: Float[Array, " k"],
) -> PiecewisePolynomial:
    origins = jnp.concatenate([times[:1], times])
    return PiecewisePolynomial(times, origins, jnp.concatenate([first[None], inner, last[None]]))


def _kinks(times: Float[Array, " n"], changes: Float[Array, " n_minus_two"] | None) -> Float[Array, " kinks"]:
    """Returns both ends of a log, and the samples between them at which steps must end; infinite ones fill the array.

    ``changes`` says how much what is interpolated jumps or bends at each of these, None for a spline.
    """
    inner = times[1:-1]
    if inner.shape[0] <= MOST_KINKS:
        inner = inner if changes is None else jnp.where(changes != 0, inner, jnp.inf)
    elif changes is None:
        inner = inner[:0]
    else:
        sizes = jnp.abs(jax.lax.stop_gradient(changes))
        outstanding = sizes > OUTSTANDING * jnp.mean(sizes)
        # A traced array has a fixed size: places that are left over lead to the infinite entry at the end.
        (places,) = jnp.nonzero(outstanding, size=MOST_KINKS, fill_value=inner.shape[0])
        inner = jnp.concatenate([inner, jnp.full((1,), jnp.inf, inner.dtype)])[places]
    return jnp.concatenate([times[:1], inner, times[-1:]])


def coverages(arguments: Any, times: Float[AnyArray, " T"]) -> Iterator[ExplainedCondition]:
    """Yields the condition, on each log within the ``arguments`` of a system, that it lasts as long as a run;
    traceable.
    """
    for (argument, *path), log in jax.tree_util.tree_leaves_with_path(arguments, is_leaf=is_recorded):
        if is_recorded(log):
            name = argument.key + jax.tree_util.keystr(tuple(path))
            yield ExplainedCondition(log.covers(times), functools.partial(_too_short, name, log, times))


def _too_short(name: str, log: AbstractRecorded, times: Float[AnyArray, " T"]) -> Problem:
    start, end, first, last = tell_numbers_apart(
        *(float(t) for t in (times[0], times[-1], log.times[0], log.times[-1]))
    )
    others = one_of([f'"{choice}"' for choice in log.choices_outside if choice != "refuse"])
    return Problem(
        name,
        f"be a log that lasts as long as the run, from t = {start} to t = {end}",
        f"it lasts from t = {first} to t = {last}; change the times of the run, or give `outside`, {others}",
    )


def is_recorded(part: Any) -> bool:
    """Returns whether this is a signal or a schedule from a log."""
    return isinstance(part, AbstractRecorded)
