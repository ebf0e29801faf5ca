"""Zeros of functions of one number: found with derivatives of every order, or bracketed step by step.

The second is for callers that evaluate the function themselves, such as the search for the end of a mode. The next
point in their bracket follows by the Illinois method: the zero of the secant replaces the newer end. If the sign did
not change, the other end stays and its value is halved, so that both ends approach the zero (Dowell & Jarratt, *BIT* 11
(1971) 168–174).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..programs.derivatives.differentiation import without_derivatives
from ..programs.identity.closures import put_captures, take_captures

TRIALS = 60  # a factor of 1e18 in the distance from the guess, by steps that only double it
LONGER_STEPS = 4.0  # the most by which a step may be longer than the one before
Number = Float[Array, ""]


def find_rising_root(
    function: Callable[..., Number], guess: Number, lowest: Number | float, scale: Number, *arguments: Any
) -> Number:
    """Finds the x at which ``function(x, *arguments)`` rises through zero, next to ``guess`` and above ``lowest``.

    It is found by Newton's method, by halving where that leads out of a bracket, and by ever longer steps where there
    is no bracket yet; the first of them are as if the slope was 1. Where the function has no such zero, or none is
    found, the result is NaN. It has no derivatives; see :func:`with_derivatives_of_root`.

    - ``lowest``: a number at which the function is negative, or −∞.
    - ``scale``: x is as exact as rounding allows relative to this or to itself, whichever is greater.
    """
    (function, arguments), captures = take_captures((function, arguments))
    captures, arguments, guess, lowest, scale = without_derivatives((captures, arguments, guess, lowest, scale))
    function, arguments = put_captures((function, arguments), captures)

    def evaluate(x: Number) -> tuple[Number, Number]:
        return jax.jvp(lambda x: function(x, *arguments), (x,), (jnp.ones_like(x),))

    value, slope = evaluate(guess)
    low, high = jnp.full_like(guess, lowest), jnp.full_like(guess, jnp.inf)
    first = _Trial(guess, value, slope, low, high, jnp.zeros_like(guess), jnp.asarray(0), (value == 0) & (slope > 0))
    last = jax.lax.while_loop(lambda trial: trial.goes_on, lambda trial: trial.next(evaluate, scale), first)
    return jnp.where((last.done & (last.slope > 0)) | last.is_bracketed, last.x, jnp.nan)


def with_derivatives_of_root(x: Number, function: Callable[..., Number], *arguments: Any) -> Number:
    """Returns ``x``, at which ``function(x, *arguments)`` is zero, with the derivatives of this root: dx = −(∂f/∂a) da
    / (∂f/∂x).

    They are those of every order, by forward and reverse mode.
    """
    # Arrays that the function has from outside become operands, because only operands have tangents in a rule.
    (function, arguments), captures = take_captures((function, arguments))

    def of_captures(x: Number, captures: list[Any], *arguments: Any) -> Number:
        whole, others = put_captures((function, arguments), captures)
        return whole(x, *others)

    return _with_derivatives_of_root(jax.lax.stop_gradient(x), of_captures, captures, *arguments)


@eqx.filter_custom_jvp
def _with_derivatives_of_root(x: Number, function: Callable[..., Number], *arguments: Any) -> Number:
    return x


@_with_derivatives_of_root.def_jvp
def _derivatives_of_root(primals: Any, tangents: Any) -> tuple[Any, Any]:
    x, function, *arguments = primals
    _, function_tangent, *argument_tangents = tangents
    # The root within its own derivative has derivatives, too, so that those of every order are right.
    root = _with_derivatives_of_root(x, function, *arguments)
    _, slope = jax.jvp(lambda x: function(x, *arguments), (root,), (jnp.ones_like(root),))
    _, change = eqx.filter_jvp(
        lambda f, *a: f(root, *a), (function, *arguments), (function_tangent, *argument_tangents)
    )
    return root, None if change is None else -change / slope  # None where nothing that it depends on changes


class _Trial(NamedTuple):
    """A number, the value and the slope of a function there, its bracket, and the length of the last step."""

    x: Number
    value: Number
    slope: Number
    low: Number
    high: Number
    length: Number
    trials: Int[Array, ""]
    done: Bool[Array, ""]

    @property
    def goes_on(self) -> Bool[Array, ""]:
        return ~self.done & (self.trials < TRIALS)

    @property
    def is_bracketed(self) -> Bool[Array, ""]:
        return jnp.isfinite(self.low) & jnp.isfinite(self.high)

    def next(self, function: Callable[[Number], tuple[Number, Number]], scale: Number) -> "_Trial":
        """Returns the trial after one more step."""
        below = self.value < 0
        low, high = jnp.where(below, self.x, self.low), jnp.where(below, self.high, self.x)
        # A step of Newton's method that is no longer than this leaves only rounding to the next one.
        exact = float(jnp.finfo(self.x.dtype).eps) ** 0.5 * jnp.maximum(jnp.abs(self.x), scale)
        newton, longest = -self.value / self.slope, LONGER_STEPS * (self.length + jnp.abs(self.value)) + exact
        plain = (self.slope > 0) & (jnp.abs(newton) <= longest)
        step = jnp.where(plain, newton, jnp.where(below, longest, -longest))
        x = self.x + step
        within = (x >= low) & (x <= high)  # also at an end, from which rounding may leave no step
        # Where the step leads out of it, there is a bracket: without one, one of its ends is infinite.
        middle = 0.5 * (low + high)
        x, length = jnp.where(within, x, middle), jnp.abs(jnp.where(within, step, middle - self.x))
        arrives = plain & within & (length <= exact)
        value, slope = function(x)
        return _Trial(x, value, slope, low, high, length, self.trials + 1, arrives | ((value == 0) & (slope > 0)))


class Sample(NamedTuple):
    """An end of a bracket: a point x and the function's value f there, numbers or arrays."""

    x: Any
    f: Any


def next_point(old: Sample, new: Sample, xp: Any = None) -> Any:
    """Returns the next point: the zero of the secant, or the midpoint if that is not inside or an end is already a
    zero.

    With ``xp=numpy`` of NumPy's arrays.
    """
    xp = xp or jnp
    slope = new.f - old.f
    x = new.x - new.f * (new.x - old.x) / xp.where(slope == 0, 1.0, slope)
    inside = ((x - old.x) * (x - new.x) <= 0) & (old.f != 0) & (new.f != 0)
    return xp.where(inside, x, (old.x + new.x) / 2)


def other_end(old: Sample, new: Sample, newest: Sample, xp: Any = None) -> Sample:
    """Returns the end of the next bracket opposite to ``newest``, which lies between; at a zero, ``newest`` itself."""
    xp = xp or jnp
    crossed, is_zero = (newest.f > 0) != (new.f > 0), newest.f == 0
    x, f = xp.where(crossed, new.x, old.x), xp.where(crossed, new.f, old.f / 2)
    return Sample(xp.where(is_zero, newest.x, x), xp.where(is_zero, newest.f, f))
