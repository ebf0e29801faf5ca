"""Times at which functions jump or have kinks: those seen in a function's trace, and the instants beside each.

A function that a user gives may compare the time with something, which is a kink that nobody has declared. Such times
are read off its trace, with their derivatives.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import call_with
from ..interface.printing import is_array
from ..interface.status import warn_of_kinks
from .arrays import default_dtype, join_arrays
from .time_comparisons import find_compared_times

CLOSE_KINKS = 100  # roundings within which two times are the same: a kink and the end of a run, or two kinks


class Traced(NamedTuple):
    """A function that a user gives, and how a part evaluates it: ``evaluate(part, t, *others)``."""

    function: Callable[..., Any]
    evaluate: Callable[..., Any]
    others: tuple[Any, ...]


def kinks_of_function(part: Any, *others: Any) -> Float[Array, " kinks"]:
    """Returns the kinks, declared in ``kink_times`` or seen, of a ``part`` with a ``function`` of (t, ``others``,
    parameters).

    A declared time that is also seen in the trace is taken from there, for its derivatives.
    """

    def evaluate(part: Any, t: Float[Array, ""], *others: Any) -> Any:
        return call_with(part.function, t, *others, parameters=part.parameters)

    return kinks_of_functions(part, [Traced(part.function, evaluate, others)], part.kink_times)


def kinks_of_functions(
    part: Any, functions: Sequence[Traced], declared: Float[Array, " declared"]
) -> Float[Array, " kinks"]:
    """Returns the kinks, declared or seen, of a ``part`` with several functions, whose ``kink_times`` are
    ``declared``.
    """
    remedy = None if declared.size else "give the times in `kink_times`"
    seen = join_arrays(
        [_times_seen(part, function.evaluate, function.others, function.function, remedy) for function in functions]
    )
    if not (seen.size and declared.size):
        return declared if declared.size else seen
    near = CLOSE_KINKS * jnp.finfo(seen.dtype).eps * jnp.abs(seen)
    # A time that never comes is infinite, and so is its `near`, within which every time would be.
    same = jnp.isfinite(seen)[None] & (jnp.abs(declared[:, None] - seen[None]) <= near[None])
    # An infinite time ends no step.
    return jnp.concatenate([jnp.where(jnp.any(same, axis=1), jnp.inf, declared), seen])


def kinks_seen(part: Any, evaluate: Callable[..., Any], *others: Any, method: str = "kinks") -> Float[Array, " kinks"]:
    """Returns the kinks of a ``part`` whose class declares none, from the trace of ``evaluate(part, t, *others)``.

    Classes of jaxball declare all that they have. ``method`` is the one in which a class of a user's does.
    """
    kind = type(part)
    if kind.__module__.partition(".")[0] == __name__.partition(".")[0]:
        return jnp.zeros((0,), default_dtype())
    return _times_seen(part, evaluate, others, kind, f"return the times from its method `{method}`")


def _times_seen(
    part: Any, evaluate: Callable[..., Any], others: tuple[Any, ...], of: Callable[..., Any], remedy: str | None
) -> Float[Array, " times"]:
    """Finds the times in a trace; with a ``remedy``, warns where there may be others."""
    parameters, static = eqx.partition(part, is_array)

    def function(t: Float[Array, ""], parameters: Any, *others: Any) -> Any:
        return evaluate(eqx.combine(parameters, static), t, *others)

    t = jnp.zeros((), default_dtype())
    try:
        program = jax.make_jaxpr(function)(t, parameters, *others)
    except Exception:  # what is wrong with a user's function is said where it is evaluated
        return jnp.zeros_like(t, shape=(0,))
    seen = find_compared_times(program, t, parameters)
    if seen.unresolved and remedy is not None:
        warn_of_kinks(of, seen.unresolved, remedy)
    return seen.times


def before_kink(kinks: Float[Array, " kinks"], t0: Float[Array, ""], t1: Float[Array, ""]) -> Float[Array, ""]:
    """Returns ``t1``, or the last time before the next kink after ``t0`` if that is earlier."""
    ends = before(kinks)
    return jnp.minimum(jnp.min(jnp.where(ends > t0, ends, jnp.inf), initial=jnp.inf), t1)


def just_before(kinks: Float[Array, " kinks"], end: Float[Array, "*times"]) -> Float[Array, "*times"]:
    """Returns the time at which to evaluate the end of a run: just before a kink there, otherwise ``end`` itself.

    A quantity that jumps there has, at the kink, the value of the later side, which is not part of the run. Of several
    ends, each is told alone.
    """
    if not kinks.size:
        return end
    near = CLOSE_KINKS * jnp.finfo(end.dtype).eps * jnp.abs(end)
    kinks, earliest = jnp.sort(jax.lax.stop_gradient(kinks).astype(end.dtype)), jax.lax.stop_gradient(end - near)
    kink = kinks[jnp.minimum(jnp.searchsorted(kinks, earliest), kinks.size - 1)]
    here = (kink >= earliest) & (kink <= end)
    # The derivative is that of `end`: the distance to the time before is rounding.
    return end + jnp.where(here, before(kink) - jax.lax.stop_gradient(end), 0.0)


def before(t: Float[Array, "..."]) -> Float[Array, "..."]:
    """Returns the floating-point number before ``t``, with the derivative of ``t``."""
    return _neighbour(t, -1.0)


def after(t: Float[Array, "..."]) -> Float[Array, "..."]:
    """Returns the floating-point number after ``t``, with the derivative of ``t``."""
    return _neighbour(t, 1.0)


def _neighbour(t: Float[Array, "..."], direction: float) -> Float[Array, "..."]:
    """Returns the floating-point number next to ``t``. XLA treats the neighbours of 0 as 0, so the smallest numbers
    that it distinguishes from 0 are used instead.
    """
    fixed = jax.lax.stop_gradient(t)
    distance = jnp.abs(jnp.nextafter(fixed, jnp.full_like(fixed, direction * jnp.inf)) - fixed)
    return t + direction * jnp.maximum(distance, jnp.finfo(fixed.dtype).tiny)
