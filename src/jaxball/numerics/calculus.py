"""Derivatives along curves and flows, and derivatives for results found without them.

Along a curve, with its point furthest from the origin. Along a flow ẋ = f(t, x), with the motion for next to no time,
as to a zero of a function; a state is a PyTree, whose integers do not flow.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..programs.derivatives.differentiation import no_further, without_derivatives
from ..programs.identity.closures import put_captures, take_captures

REFINEMENTS, POINTS_EACH_SIDE = 4, 8  # to a 4096th of the spacing
NEXT_TO_NOTHING = 1e-3  # of a step: the zero of a rate is known far better, and is no further away where it has jumped
Curve = Callable[[Float[Array, ""]], Float[Array, "..."]]
Time = Float[Array, ""]


def two_derivatives(
    curve: Curve, x: Float[Array, ""]
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """Computes the value of ``curve`` at ``x`` with its first and second derivatives."""
    x = jnp.asarray(x)
    unit = jnp.ones_like(x)

    def value_and_slope(x):
        return jax.jvp(curve, (x,), (unit,))

    (value, slope), (_, curvature) = jax.jvp(value_and_slope, (x,), (unit,))
    return value, slope, curvature


def with_derivatives(value: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    """Returns ``value``, with the derivatives of ``function(*arguments)``, which has the same value up to rounding.

    Where nothing is differentiated, the function is not evaluated.
    """
    call = _with_captures(function, arguments)
    return _with_derivatives(_in_rows_of(call, value), *call)


def _with_captures(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Returns a function with its arguments, the first of which is what the given one has from outside.

    Only operands have tangents in a rule.
    """
    (function, arguments), captures = take_captures((function, arguments))

    def of_captures(captures: list[Any], *arguments: Any) -> Any:
        whole, others = put_captures((function, arguments), captures)
        return whole(*others)

    return of_captures, captures, *arguments


@eqx.filter_custom_jvp
def _with_derivatives(value: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    return value


@_with_derivatives.def_jvp
def _derivatives(primals: Any, tangents: Any) -> tuple[Any, Any]:
    value, function, *arguments = primals
    _, function_tangent, *argument_tangents = tangents
    _, slopes = eqx.filter_jvp(lambda f, *x: f(*x), (function, *arguments), (function_tangent, *argument_tangents))
    return value, slopes


def with_second_derivatives(value: Any, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Returns ``value``, with its own first derivatives and with the second ones of ``function(*arguments)``.

    The function has the same value and the same first derivatives, up to rounding. It is evaluated only where second
    derivatives are asked for, so that it may cost more. They are those of forward mode over forward mode, as all second
    derivatives of runs are computed; reverse mode has the first ones alone. Third derivatives would be wrong: for
    these, a clear ``TypeError`` that names ``what`` the value is.
    """
    numbers, others = eqx.partition(value, eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(numbers)

    def results(*operands: Any) -> list[Array]:
        return jax.tree.leaves(eqx.filter(function(*operands), eqx.is_inexact_array))

    call = what, *_with_captures(results, arguments)
    return eqx.combine(structure.unflatten(_with_second_derivatives(_in_rows_of(call, leaves), *call)), others)


def _in_rows_of(operands: Any, values: Any) -> Any:
    """Returns the values unchanged, but with rows under ``jax.vmap`` wherever the operands have some.

    A rule for derivatives gives values and tangents rows together, and JAX takes the shapes of the values for those
    that they had without it.
    """
    numbers = filter(eqx.is_inexact_array, jax.tree.leaves(operands))
    nothing = sum((0 * jnp.sum(jnp.isnan(x)) for x in numbers), jnp.asarray(0))
    return jax.tree.map(lambda x: x + nothing.astype(x.dtype) if eqx.is_inexact_array(x) else x, values)


@eqx.filter_custom_jvp
def _with_second_derivatives(value: list[Array], what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    return value


@_with_second_derivatives.def_jvp
def _first_derivatives(primals: Any, tangents: Any) -> tuple[Any, Any]:
    value, what, *call = primals
    slopes, _, _, *argument_tangents = tangents
    slopes = [jnp.zeros_like(x) if slope is None else slope for x, slope in zip(value, slopes, strict=True)]
    call = what, *call
    value, slopes = _in_rows_of(call, value), _in_rows_of(call, slopes)
    return _with_second_derivatives(value, *call), _with_slopes(slopes, *call, tuple(argument_tangents))


@eqx.filter_custom_jvp
def _with_slopes(slopes: list[Array], what: str, function: Callable[..., Any], *operands: Any) -> Any:
    return slopes


@_with_slopes.def_jvp
def _second_derivatives(primals: Any, tangents: Any) -> tuple[Any, Any]:
    slopes, what, function, *operands = primals
    _, _, _, *changes = tangents

    def of_function(*operands: Any) -> list[Any]:
        *arguments, argument_tangents = operands
        return eqx.filter_jvp(function, tuple(arguments), argument_tangents)[1]

    _, curvatures = eqx.filter_jvp(of_function, operands, changes)
    slopes = _with_slopes(_in_rows_of(operands[:-1], slopes), what, function, *operands)
    return slopes, no_further(f"third derivatives of {what}", curvatures)


class Furthest(NamedTuple):
    """Where a curve is furthest from the origin, and how far it is there."""

    x: Float[Array, ""]
    distance: Float[Array, ""]


def furthest(curve: Curve, x: Float[Array, " n"], points: Float[Array, "n 3"]) -> Furthest:
    """Finds where a curve is furthest from the origin: at the best of its ``points`` at evenly spaced ``x``, or near
    it.

    The distance is that of a point of the curve, so it is never too large. Points where the curve is not finite are
    ignored.
    """
    shares = jnp.asarray(np.arange(-POINTS_EACH_SIDE, POINTS_EACH_SIDE + 1) / POINTS_EACH_SIDE, x.dtype)

    def best(x, points):
        squares = jnp.sum(points**2, axis=1)
        squares = jnp.where(jnp.all(jnp.isfinite(points), axis=1), squares, -1.0)
        largest = jnp.max(squares)
        # Without argmax, at which XLA's CPU compiler fails in some programs.
        return jnp.min(jnp.where(squares == largest, x, jnp.inf)), largest

    def nearer(_, carry):
        (place, _), spacing = carry
        x = place + spacing * shares
        return best(x, jax.vmap(curve)(x)), spacing / POINTS_EACH_SIDE

    (place, largest), _ = jax.lax.fori_loop(0, REFINEMENTS, nearer, (best(x, points), x[1] - x[0]))
    return Furthest(place, jnp.sqrt(largest))


def move(t: Time, x: Any, rates: Any, shift: Time) -> tuple[Time, Any]:
    """Returns a time that is later by ``shift``, and the state that has moved at these rates."""
    return t + shift, jax.tree.map(lambda leaf, rate: leaf + shift * rate if _flows(leaf) else leaf, x, rates)


def move_to_zero(
    field: Callable[[Time, Any], Any],
    value: Callable[[Time, Any], Time],
    t: Time,
    x: Any,
    slope: Time,
    otherwise: Time,
) -> tuple[Time, Any]:
    """Computes the time and the state at the zero of ``value`` along the flow that is next to nothing away, with the
    first and the second derivatives of that zero.

    - ``slope``: the rate of the value along the flow, without derivatives. Where it is 0, the time moves by
      ``otherwise`` and not to a zero.
    """
    # With a fixed slope each step of Newton's method gains an order, where the state moves to that order, too.
    rates = field(t, x)
    # Their factor is the square of a time that is next to nothing, so that only their values matter.
    bends = without_derivatives(rates_along(field, t, x, rates)[1])

    def advance(shift: Time) -> tuple[Time, Any]:
        _, mean = move(t, rates, bends, 0.5 * shift)
        return move(t, x, mean, shift)

    def step(shift: Time) -> Time:
        return shift - value(*advance(shift)) / jnp.where(slope == 0, 1.0, slope)

    return advance(jnp.where(slope == 0, otherwise, step(step(jnp.zeros_like(t)))))


def move_to_peak(
    field: Callable[[Time, Any], Any], value: Callable[[Time, Any], Time], t: Time, x: Any, length: Time
) -> tuple[Time, Any]:
    """Computes the time and the state at which ``value`` is largest along the flow, next to nothing away in a step of
    this ``length``. There the value has right second derivatives.

    Where it is largest because the step ends, where it jumps or where it is constant, time and state are unchanged.
    """

    def rate(t: Time, x: Any) -> Time:
        return rates_along(value, t, x, field(t, x))[1]

    slope, bend = without_derivatives(rates_along(rate, t, x, field(t, x)))
    peaks = (bend < 0) & (jnp.abs(slope) < NEXT_TO_NOTHING * length * jnp.abs(bend))
    return move_to_zero(field, rate, t, x, jnp.where(peaks, bend, 0.0), jnp.zeros_like(t))


def rates_along(function: Callable[[Time, Any], Any], t: Time, x: Any, rates: Any) -> tuple[Any, Any]:
    """Computes a function of time and state, and its rate where the state moves at these rates."""
    # Tangents of integers have the type float0, or JAX refuses them.
    along = jax.tree.map(
        lambda leaf, rate: rate if _flows(leaf) else np.zeros(jnp.shape(leaf), jax.dtypes.float0), x, rates
    )
    return jax.jvp(function, (t, x), (jnp.ones_like(t), along))


def _flows(leaf: Any) -> bool:
    """Returns whether a part of a state is a number with a rate; integers only change at events."""
    return jnp.issubdtype(jnp.result_type(leaf), jnp.inexact)
