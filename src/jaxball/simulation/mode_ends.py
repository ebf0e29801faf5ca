"""The search for the step that ends where a mode does: at the first zero of a guard.

Guards are positive while a mode lasts. In each step they are looked at as the functions of events are (``crossings``).
A step within which one falls to zero is rejected, and steps of other lengths follow until one ends there. They are
steps of the solver itself, and not of its interpolation, so that the state is as exact as any other. The first of them
ends where the interpolation has its zero; from there on, steps follow by the slope of the guard, and then by the
secants through their ends.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.arrays import entry, select_tree
from ..numerics.pieces import Span
from ..physics.hybrid import NONE
from .solvers.dense.crossings import Falling, FirstZero, Functions, glance

NEAR_ZERO = 1e-10  # of the length of a step: where it ends so close to a zero of a guard, one step of Newton's is exact
ONE_EVENT = 1e-6  # of the length of a step: zeros of guards this close to each other are one event
MOST_TRIES = 40
LEAST_LENGTH = 8  # the length of a step, in units of rounding of the time
# Of the length of a step: between ends this close to each other, a guard is nearly linear, ...
ADJACENT = 0.1
# ... and a step that ends as close to a zero as this is much the same as the longer one in which that was found.
SAME_STEP = 1e-5
# A step in which a guard changes too quickly to be followed is taken again, shorter, but not below a part of the run.
SHORTER, SHORTEST = 1 / 64, 1 / 4096


class RootBracket(NamedTuple):
    """A zero of guard ``which``, that the next step is to meet at ``target``.

    It was positive at ``low``, and is presumably zero before ``high``, but certainly before ``below``, where a step has
    ended below zero; that is infinite where none has. ``slope`` is its rate at the zero. No guard fell to zero before
    ``zero`` in the step in which it was found.

    A guard that is zero as a step begins, and falls, has its event at the ``earliest`` end of a step. It was ``f`` at
    ``x``, where the last step of the search ended; ``size`` is its size in the first.
    """

    on: Bool[Array, ""]
    which: Int[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]
    below: Float[Array, ""]
    target: Float[Array, ""]
    earliest: Float[Array, ""]
    slope: Float[Array, ""]
    zero: Float[Array, ""]
    x: Float[Array, ""]
    f: Float[Array, ""]
    size: Float[Array, ""]
    tries: Int[Array, ""]

    @classmethod
    def none(cls, t: Float[Array, ""]) -> "RootBracket":
        """Returns the bracket without a zero."""
        no, first, zero = jnp.zeros_like(t, bool), jnp.zeros_like(t, int), jnp.zeros_like(t)
        return cls(no, first, t, t, t, t, t, zero, t, t, zero, zero, first)

    @classmethod
    def of(cls, start: Float[Array, ""], end: Float[Array, ""], look: "Look") -> "RootBracket":
        """Returns the bracket of the first zero in a step, which the next one is to meet."""
        zero = look.zero
        # A step has some length, even if a guard was below zero by rounding at its start.
        rounding = float(jnp.finfo(end.dtype).eps) * jnp.maximum(jnp.abs(start), jnp.abs(end))
        earliest = start + LEAST_LENGTH * rounding
        value = entry(zero.which, look.last)
        return cls(
            on=zero.exists,
            which=zero.which,
            low=start,
            high=jnp.minimum(zero.until, end),
            below=jnp.where(value <= 0, end, jnp.inf),
            target=jnp.minimum(jnp.maximum(zero.time, earliest), end),
            earliest=earliest,
            slope=zero.slope,
            zero=zero.time,
            x=end,
            f=value,
            size=entry(zero.which, look.size),
            tries=jnp.zeros_like(zero.which),
        )

    def agrees(self, span: Span, last: Float[Array, " k"]) -> Bool[Array, ""]:
        """Returns whether a step that was to meet the zero, after which the guards are ``last``, has come so close to
        it that the step in which it was found tells of this one.
        """
        near = jnp.abs(entry(self.which, last)) <= SAME_STEP * span.length * jnp.abs(self.slope)
        return self.on & (span.last == self.target) & near & (span.last <= self.zero + ONE_EVENT * span.length)

    def narrow(
        self, start: Float[Array, ""], x: Float[Array, ""], f: Float[Array, ""], target: Float[Array, ""]
    ) -> "RootBracket":
        """Narrows the bracket after a step to ``x`` that found ``f`` there, to a new ``target`` if that is inside.

        If not, it is halfway where the guard was below zero, else the presumed end; and behind that the mean, by orders
        of magnitude of the lengths of steps, to where the guard certainly is below zero.
        """
        positive = f > 0
        low, below = jnp.where(positive, x, self.low), jnp.where(positive, self.below, x)
        high = jnp.where(positive & (x < self.high), self.high, below)
        between = start + jnp.sqrt((x - start) * (below - start))
        outside = jnp.where(positive, jnp.where(high < below, high, between), 0.5 * (low + high))
        target = jnp.where((target >= low) & (target <= high), target, outside)
        target = jnp.maximum(target, self.earliest)
        return self._replace(low=low, high=high, below=below, target=target, x=x, f=f, tries=self.tries + 1)


class Look(NamedTuple):
    """What a step shows of the guards.

    - ``zero``: the first one.
    - ``first``, ``last``: the values at the ends of the step, and ``size``: the largest within it.
    - ``piece``: the length of the piece in which the look at it ended.
    """

    zero: FirstZero
    first: Float[Array, " k"]
    last: Float[Array, " k"]
    size: Float[Array, " k"]
    piece: Float[Array, ""]


def look_at(
    sketch: Functions,
    exact: Callable[[Bool[Array, ""]], Functions],
    span: Span,
    bracket: RootBracket,
    piece: Float[Array, ""],
    count: int,
    *,
    whole: bool = False,
) -> Look:
    """Looks for the first zero of ``count`` guards in a step.

    - ``sketch``: the guards at times in the step, less accurate than it is; ``exact``: as accurate, if asked for.
    - ``bracket``: the zero that is sought, if any.
    - ``piece``: the length of the piece in which the look at the step before ended.
    - ``whole``: whether ``sketch`` may be looked at in whole steps, however long they are.
    """
    if not count:
        none, nothing = jnp.zeros((0,), piece.dtype), jnp.zeros_like(piece)
        no = jnp.asarray(False)
        return Look(FirstZero(no, jnp.asarray(NONE), nothing, nothing, nothing, no, piece), none, none, none, piece)
    falling = Falling(count)
    log = falling.log(span.start, piece)
    seen = glance(sketch, span, log, whole=whole)
    asked = ~(seen.quiet | bracket.agrees(span, seen.last))
    zero = falling.first(exact(asked), span, seen, log, asked)
    return Look(zero, seen.first, seen.last, seen.size, jnp.where(asked, zero.piece, seen.piece))


def bracket_zero(
    bracket: RootBracket, start: Float[Array, ""], end: Float[Array, ""], look: Look
) -> tuple[Bool[Array, ""], RootBracket]:
    """Returns whether a step is rejected because it goes beyond a zero of a guard, and the bracket of that zero."""
    none, zero = RootBracket.none(end), look.zero
    at_target = bracket.on & (end == bracket.target)
    value, length = entry(bracket.which, look.last), end - start
    # Where the guard falls to zero: by the secant through the last two ends, or else by its slope.
    adjacent = (bracket.tries > 0) & (end != bracket.x) & (jnp.abs(end - bracket.x) < ADJACENT * length)
    secant = (value - bracket.f) / jnp.where(adjacent, end - bracket.x, 1.0)
    slope = jnp.where(adjacent, secant, bracket.slope)
    next_end = end - value / jnp.where(slope == 0, 1.0, slope)
    width = jnp.maximum(NEAR_ZERO * length, 4 * float(jnp.finfo(end.dtype).eps) * jnp.abs(end))
    met = (jnp.abs(next_end - end) <= width) & (slope != 0) | (value == 0)
    # Still positive behind the presumed zero, and never seen below it: the zero was one of the interpolation alone. The
    # search ends, with a guard that has not fallen.
    met |= (value > 0) & (end >= bracket.high) & jnp.isinf(bracket.below)
    # The guard may have fallen below zero and risen again before the end of the step.
    same = zero.exists & (zero.which == bracket.which)
    earlier = same & ((value > 0) | (end - zero.time > ADJACENT * length))
    met = met & ~earlier | (bracket.tries >= MOST_TRIES) | (end <= bracket.earliest)
    # A step that ends far behind the zero holds it: there, the interpolation of that step, which is shorter than the
    # first, is a better guide than the slope. Close to it the secant is.
    behind = at_target & ~met & same & (earlier | ~adjacent)
    # Two guards may fall to zero together; then either will do.
    another = ~at_target | (zero.which != bracket.which) & (zero.time < end - ONE_EVENT * length)
    # In a shorter step the interpolation may have other zeros, or none.
    tries = jnp.where(at_target, bracket.tries + 1, 0)
    new_zero = zero.exists & another & (tries < MOST_TRIES)
    first = RootBracket.of(start, end, look)._replace(tries=tries)
    again = first._replace(size=bracket.size)
    searched = select_tree(behind, again, bracket.narrow(start, end, value, next_end))
    rejected = new_zero | at_target & ~met
    return rejected, select_tree(rejected, select_tree(new_zero, first, searched), none)


def is_too_quick(look: Look, span: Span) -> Bool[Array, ""]:
    """Returns whether a step is to be taken again, ``SHORTER``, because a guard changes too quickly in it."""
    return look.zero.unresolved & ~look.zero.exists & (span.length > SHORTEST * span.of_run)
