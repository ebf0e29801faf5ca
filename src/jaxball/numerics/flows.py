"""Motion along a flow ẋ = f(t, x) for next to no time, as to a zero of a function, and rates along it.

A state is a PyTree, whose integers do not flow.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..programs.derivatives.differentiation import without_derivatives

NEXT_TO_NOTHING = 1e-3  # of a step: the zero of a rate is known far better, and is no further away where it has jumped

Time = Float[Array, ""]


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
