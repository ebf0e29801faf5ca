"""Derivatives along a curve, its point furthest from the origin, and derivatives for results found without them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..programs.identity.closures import put_captures, take_captures

REFINEMENTS, POINTS_EACH_SIDE = 4, 8  # to a 4096th of the spacing
Curve = Callable[[Float[Array, ""]], Float[Array, "..."]]


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
    # Arrays that the function has from outside become operands, because only operands have tangents in a rule.
    (function, arguments), captures = take_captures((function, arguments))

    def of_captures(captures: list[Any], *arguments: Any) -> Any:
        whole, others = put_captures((function, arguments), captures)
        return whole(*others)

    return _with_derivatives(value, of_captures, captures, *arguments)


@eqx.filter_custom_jvp
def _with_derivatives(value: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    return value


@_with_derivatives.def_jvp
def _derivatives(primals: Any, tangents: Any) -> tuple[Any, Any]:
    value, function, *arguments = primals
    _, function_tangent, *argument_tangents = tangents
    _, slopes = eqx.filter_jvp(lambda f, *x: f(*x), (function, *arguments), (function_tangent, *argument_tangents))
    return value, slopes


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
