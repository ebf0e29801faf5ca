"""Integrates functions of time over each step of a solve, in pieces that are short enough for each function.

A step is chosen for the state, and other functions may change more quickly within it, or have a kink, such as a speed
where a body turns back. So a step is cut into pieces. The rule of Gauss and Lobatto integrates a piece by the values at
eight nodes, and the Legendre series through them tells how exactly: where its terms decay, those left out are as much
smaller again. A piece that is not exact enough is halved.

A function that touches zero with a kink, as |v| does, has a square that is smooth, and this square has its minimum at
the kink. The series of the square finds it to many digits, so that the piece is cut right there.

Outer nodes lie a little inside of a piece, so that a value where it ends at a kink or a jump is that of its own side.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.polynomial import legendre

from ....numerics.arrays import select_tree
from ....numerics.pieces import Cut, longest_share
from ....programs.derivatives.reverse_rules import sum_while

NODES = 8  # as many as fill a vector
END_INSIDE = 0.6  # the power of the rounding unit that is the distance of the outer nodes from the ends of a piece
# Of the last two terms of a series, relative to the two before, where it decays and can be extrapolated.
DECAYED_INTEGRAND = 0.1
ROUNDINGS = 64  # of the values in a piece: an error below that is none
LEAST_INTEGRAND = 1e-3  # of the absolute tolerance, to which a function that is next to zero is integrated
GROWTH = 4.0  # the longest piece, relative to the one before it in the step
SMALLEST_WIDTH = 64  # the width of a piece that is not cut any more, in rounding units of a step
WINDOW = 1 / 64  # of a piece, on each side of a minimum where it is sought again
STEPS_TO_MINIMUM = 6

Functions = Callable[[Float[Array, " n"]], Float[Array, "n k"]]


class Running(NamedTuple):
    """The integrals of k functions so far, which have derivatives, and those of their absolute values."""

    total: Float[Array, " k"]
    size: Float[Array, " k"]

    @classmethod
    def none(cls, count: int, like: Array) -> "Running":
        """Returns the integrals before the first step."""
        zero = jnp.zeros(count, like.dtype)
        return cls(zero, zero)


class Accuracy(NamedTuple):
    """The tolerances, and the lengths from which follows how exactly a piece is integrated.

    - ``lengths``: of the pause before a step, and of the step; ``before``: of the run before both; ``run``: of the
      whole run.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    lengths: Float[Array, "2"]
    before: Float[Array, ""]
    run: Float[Array, ""]

    def length(self, place: Float[Array, ""]) -> Float[Array, ""]:
        """Returns the length of the range that a place lies in: 0 to 1 is the pause before a step, 1 to 2 the step."""
        return jnp.where(place < 1, self.lengths[0], self.lengths[1])

    def longest(self, place: Float[Array, ""]) -> Float[Array, ""]:
        """Returns how wide a piece that begins at a place may be."""
        return jnp.where(place < 1, 1.0, longest_share(self.lengths[1], self.run))

    def until(self, place: Float[Array, ""]) -> Float[Array, ""]:
        """Returns the length of the run up to a place."""
        pause, step = self.lengths
        return self.before + jnp.where(place < 1, place * pause, pause + (place - 1) * step)


class _Rule(NamedTuple):
    """The nodes of a piece from 0 to 1, their weights, and what takes the values there to two series.

    ``series`` gives that in Legendre polynomials on −1 to 1, ``powers`` that in powers.
    """

    nodes: np.ndarray
    weights: np.ndarray
    series: np.ndarray
    powers: np.ndarray


@cache
def _rule(dtype: np.dtype) -> _Rule:
    inner = np.real(legendre.Legendre.basis(NODES - 1).deriv().roots())
    end = 1 - 2 * float(np.finfo(dtype).eps) ** END_INSIDE
    x = np.concatenate([[-end], np.sort(inner), [end]])
    series = np.linalg.inv(legendre.legvander(x, NODES - 1))
    # The constant term is the mean over the piece.
    return _Rule((1 + x) / 2, series[0], series, np.linalg.inv(np.vander(x, increasing=True)))


class _Trial(NamedTuple):
    """The piece that is tried next, between places as in :class:`Accuracy`, or the window in which its end is sought.

    - ``seeks``: whether a minimum is sought in ``window``; ``at_minimum``: whether the piece ends at one.
    - ``size``: the integrals of the absolute values so far.
    """

    cut: Cut
    seeks: Bool[Array, ""]
    window: Float[Array, "2"]
    at_minimum: Bool[Array, ""]
    size: Float[Array, " k"]
    accuracy: Accuracy

    @classmethod
    def first(cls, start: Float[Array, ""], size: Float[Array, " k"], accuracy: Accuracy) -> "_Trial":
        """Returns the first piece, from ``start``."""
        no, cut = jnp.asarray(False), Cut.first(start, accuracy.longest(start), _find_end(start))
        return cls(cut, no, jnp.stack([start, start]), no, size, accuracy)

    @property
    def goes_on(self) -> Bool[Array, ""]:
        """Whether anything of the step is left."""
        return self.cut.start < 2

    @property
    def ends(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Between which places the functions are asked for."""
        low, high = self.window
        return jnp.where(self.seeks, low, self.cut.start), jnp.where(self.seeks, high, self.cut.end)

    @property
    def places(self) -> Float[Array, " nodes"]:
        """The places at which they are."""
        low, high = self.ends
        return low + jnp.asarray(_rule(low.dtype).nodes, low.dtype) * (high - low)

    def advance(self, values: Float[Array, "nodes k"]) -> tuple["_Trial", Float[Array, " nodes"]]:
        """Goes on with the values at ``places``; returns the weights with which they count."""
        dtype, width = values.dtype, self.cut.width
        weights = jnp.asarray(_rule(dtype).weights, dtype)
        size = self.size + width * jnp.sum(weights[:, None] * jnp.abs(values), axis=0)
        excess = _estimate_error(values) / self._allow_error(size, values)
        # Nothing is gained by cutting where there is no finite value, or where rounding leaves nothing to cut.
        smallest = width <= SMALLEST_WIDTH * float(jnp.finfo(dtype).eps)
        ends = smallest | self.cut.is_last | ~jnp.all(jnp.isfinite(values))
        passes = ~self.seeks & (ends | jnp.all(excess <= 1))

        def go_on(trial: "_Trial") -> "_Trial":
            start = trial.cut.end
            longest = jnp.minimum(GROWTH * width, trial.accuracy.longest(start))
            return trial._replace(
                cut=trial.cut.go_on(longest, _find_end(start)), size=size, at_minimum=jnp.asarray(False)
            )

        trial = jax.lax.cond(passes, go_on, lambda trial: trial._shorten(_pick_largest(excess, values)), self)
        return trial, jnp.where(passes, width * weights, 0.0)

    def _shorten(self, values: Float[Array, " nodes"]) -> "_Trial":
        """Goes on with a shorter piece, or with the search for the place where it is to end, by the values of the
        function that is least exact.
        """
        place, is_minimum = _find_least_square(values)
        cut, (low, high) = self.cut, self.ends
        minimum, aside = low + 0.5 * (1 + place) * (high - low), WINDOW * cut.width
        # Where a piece that ends at a minimum is not exact enough, there is something else to be found.
        looks, meets = is_minimum & ~self.seeks & ~self.at_minimum, is_minimum & self.seeks
        window = jnp.stack([jnp.maximum(cut.start, minimum - aside), jnp.minimum(cut.end, minimum + aside)])
        shorter = cut.shorten(jnp.where(meets, minimum, cut.start + 0.5 * cut.width))
        same = cut._replace(trials=cut.trials + 1)
        return self._replace(cut=select_tree(looks, same, shorter), seeks=looks, window=window, at_minimum=meets)

    def _allow_error(self, size: Float[Array, " k"], values: Float[Array, "nodes k"]) -> Float[Array, " k"]:
        """Returns the error that the mean of each function over a piece may have.

        It is relative to the mean of its size over the run so far, and so the same in all pieces. A piece with a kink
        is then so short that derivatives, which may jump there, are as exact.
        """
        rtol, atol, *_ = accuracy = self.accuracy
        until = accuracy.until(self.cut.end)
        mean = size / jnp.where(until > 0, until, 1.0)
        rounding = ROUNDINGS * float(jnp.finfo(values.dtype).eps) * jnp.max(jnp.abs(values), axis=0)
        tiny = float(jnp.finfo(values.dtype).tiny)
        return accuracy.length(self.cut.start) * (rtol * mean + LEAST_INTEGRAND * atol) + rounding + tiny


def integrate(
    functions: Functions, start: Float[Array, ""], running: Running, accuracy: Accuracy, *, reverse: bool
) -> Running:
    """Adds the integrals over a step to those that are ``running``.

    - ``functions``: of places, those whose integral over the places from ``start`` to 2 is sought; see
      :class:`Accuracy`.
    - ``reverse``: whether derivatives are those of reverse mode, or else those of forward mode.
    """
    first = _Trial.first(jax.lax.stop_gradient(start), running.size, accuracy)
    last, total = sum_while(
        lambda trial: trial.goes_on,
        lambda trial: trial.places,
        functions,
        _Trial.advance,
        first,
        running.total,
        reverse=reverse,
    )
    return Running(total, last.size)


def _find_end(place: Float[Array, ""]) -> Float[Array, ""]:
    """Returns the place where the pause ends that a place lies in, or else the step."""
    return jnp.where(place < 1, 1.0, 2.0)


def _estimate_error(values: Float[Array, "nodes k"]) -> Float[Array, " k"]:
    """Estimates the error of the mean of each function over a piece."""
    series = jnp.asarray(_rule(values.dtype).series[-4:], values.dtype)
    terms = jnp.abs(jnp.sum(series[..., None] * values[None], axis=1))
    last, before = terms[3] + terms[2], terms[1] + terms[0]
    ratio = last / jnp.where(before > 0, before, 1.0)
    return last * jnp.where(last <= DECAYED_INTEGRAND * before, ratio**2, 1.0)


def _pick_largest(excess: Float[Array, " k"], values: Float[Array, "nodes k"]) -> Float[Array, " nodes"]:
    """Returns the values of the function with the largest excess."""
    places = jnp.arange(excess.size)
    place = jnp.min(jnp.where(excess == jnp.max(excess), places, excess.size))
    return jnp.sum(jnp.where(places == place, values, 0.0), axis=1)


def _find_least_square(values: Float[Array, " nodes"]) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """Finds where between −1 and 1 the square of a function is least, and whether the function may touch zero there."""
    rule = _rule(values.dtype)
    scale = jnp.max(jnp.abs(values))
    square = (values / jnp.where(scale > 0, scale, 1.0)) ** 2
    a = jnp.sum(jnp.asarray(rule.powers, values.dtype) * square[None], axis=1)
    least = square == jnp.min(square)
    x = jnp.min(jnp.where(least, jnp.asarray(2 * rule.nodes - 1, values.dtype), 1.0))

    def newton(_, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, _, _ = carry
        slope, bend = jnp.zeros_like(x), jnp.zeros_like(x)
        for k in range(NODES - 1, 0, -1):
            bend = bend * x + slope
            slope = slope * x + k * a[k]
        change = jnp.clip(jnp.where(bend > 0, -slope / jnp.where(bend > 0, bend, 1.0), 0.0), -0.5, 0.5)
        return jnp.clip(x + change, -1.0, 1.0), change, bend

    none = jnp.zeros_like(x)
    x, change, bend = jax.lax.fori_loop(0, STEPS_TO_MINIMUM, newton, (x, none, none))
    same_sign = jnp.all(values >= 0) | jnp.all(values <= 0)
    near = float(jnp.finfo(values.dtype).eps) ** 0.5
    return x, same_sign & (bend > 0) & (jnp.abs(change) <= near) & (jnp.abs(x) < 1)
