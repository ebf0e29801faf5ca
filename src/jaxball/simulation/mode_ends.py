"""The search for the step that ends where a mode does: at the first zero of a guard.

Guards are positive while a mode lasts. A step within which one falls to zero is rejected, and steps of other lengths
follow until one ends there. They are steps of the solver itself, and not of its interpolation, so that the state is as
exact as any other. Where two of them end close to each other, the next one is that of the secant method; before, a step
of Newton's method follows one that ended ahead of the zero, and one that ended behind it is shortened, so that the
quartic through the guard's values within the step is more exact than the last one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..numerics.arrays import select_tree
from ..numerics.roots import Sample, next_point, other_end
from ..physics.hybrid import NONE, entry
from ..solvers.dense.steps import sampling

NEAR_ZERO = 1e-10  # of the length of a step: where it ends so close to a zero of a guard, one step of Newton's is exact
ONE_EVENT = 1e-6  # of the length of a step: zeros of guards this close to each other are one event
MOST_TRIES = 40
LEAST_LENGTH = 8  # the length of a step, in units of rounding of the time
ROOT_STEPS = 8  # of the Illinois method, to the zero of a quartic
POWERS = sampling().powers.tolist()
END_SLOPE = (np.arange(len(POWERS)) @ sampling().powers).tolist()  # of a quartic at the end of a step, by its samples
ADJACENT = 0.1  # of the length of a step: between ends this close to each other, a guard is nearly linear


class RootBracket(NamedTuple):
    """A zero of guard ``which``, that the next step is to meet at ``target``.

    It was positive at ``low``, and is presumably zero before ``high``, but certainly before ``below``, where a step has
    ended below zero; that is infinite where none has.

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
    x: Float[Array, ""]
    f: Float[Array, ""]
    size: Float[Array, ""]
    tries: Int[Array, ""]

    @classmethod
    def none(cls, t: Float[Array, ""]) -> "RootBracket":
        """Returns the bracket without a zero."""
        no, first, zero = jnp.zeros_like(t, bool), jnp.zeros_like(t, int), jnp.zeros_like(t)
        return cls(no, first, t, t, t, t, t, t, zero, zero, first)

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


def bracket_zero(
    bracket: RootBracket, start: Float[Array, ""], end: Float[Array, ""], guards: Float[Array, "k nodes"]
) -> tuple[Bool[Array, ""], RootBracket]:
    """Returns whether a step is rejected because it goes beyond a zero of a guard, and the bracket of that zero."""
    none = RootBracket.none(end)
    if guards.shape[0] == 0:
        return jnp.zeros_like(end, bool), none
    at_target = bracket.on & (end == bracket.target)
    samples = entry(bracket.which, guards)
    value, length = samples[-1], end - start
    # Where the guard falls to zero: by the secant through the last two ends, or else by the slope of the quartic here.
    adjacent = (bracket.tries > 0) & (end != bracket.x) & (jnp.abs(end - bracket.x) < ADJACENT * length)
    secant = (value - bracket.f) / jnp.where(adjacent, end - bracket.x, 1.0)
    tangent = sum(part * sample for part, sample in zip(END_SLOPE, samples, strict=True)) / length
    slope = jnp.where(adjacent, secant, tangent)
    next_end = end - value / jnp.where(slope == 0, 1.0, slope)
    width = jnp.maximum(NEAR_ZERO * length, 4 * float(jnp.finfo(end.dtype).eps) * jnp.abs(end))
    met = (jnp.abs(next_end - end) <= width) & (slope != 0) | (value == 0)
    # Still positive behind the presumed zero, and never seen below it: the zero was one of the polynomial alone. The
    # search ends, with a guard that has not fallen.
    met |= (value > 0) & (end >= bracket.high) & jnp.isinf(bracket.below)
    # The guard may have fallen below zero and risen again before the end of the step.
    earlier = jnp.any(samples[1:-1] < 0)
    met = met & ~earlier | (bracket.tries >= MOST_TRIES) | (end <= bracket.earliest)
    # A step that ends far behind the zero holds it: the quartic in that step, which is shorter than the first, is a
    # better guide than a tangent from behind. Close to it the secant is.
    behind = at_target & ~met & (earlier | ~adjacent & (value < 0))
    first = _first_zero(start, end, guards, jnp.where(at_target & ~behind, bracket.which, NONE))
    # Two guards may fall to zero together; then either will do.
    another = ~at_target | (first.which != bracket.which) & (first.target < end - ONE_EVENT * length)
    # The quartics may have spurious zeros, and then, in a shorter step, others.
    tries = jnp.where(at_target, bracket.tries + 1, 0)
    new_zero = first.on & another & (tries < MOST_TRIES)
    again = first._replace(x=end, f=value, size=bracket.size, tries=tries)
    searched = select_tree(behind, again, bracket.narrow(start, end, value, next_end))
    rejected = new_zero | at_target & ~met
    return rejected, select_tree(rejected, select_tree(new_zero, first._replace(tries=tries), searched), none)


def _first_zero(
    start: Float[Array, ""], end: Float[Array, ""], guards: Float[Array, "k nodes"], but: Int[Array, ""]
) -> RootBracket:
    """Finds the first place in a step where a guard is not positive, ``but`` for one; before the start all were.

    Guards are evaluated at a few nodes, and the quartics through these values at 35 points. Everything is written with
    whole arrays without argmax, which XLA's CPU compiler turns into slow loops.
    """
    grid = sampling()
    last, count = grid.fractions.size - 1, guards.shape[0]
    fractions = jnp.asarray(grid.fractions, guards.dtype)
    index = jnp.arange(last + 1)
    fine = sum(column * values[:, None] for column, values in zip(_columns(guards.dtype), guards.T, strict=True))
    other = jnp.arange(count) != but
    # At the start of a step a guard may be zero by rounding, as after a reset.
    over = (fine <= 0) & other[:, None] & (index > 0)[None]
    places = jnp.min(jnp.where(over, index[None], last + 1), axis=1)
    place = jnp.min(places)
    which = jnp.min(jnp.where(places == place, jnp.arange(count), count))
    samples = entry(which, guards)

    def fraction(k: Int[Array, ""]) -> Float[Array, ""]:
        return jnp.sum(jnp.where(index == jnp.clip(k, 0, last), fractions, 0.0))

    root = _root(samples, fraction(place - 1), fraction(place))
    length = end - start
    # A step has some length, even if a guard was below zero by rounding at its start.
    earliest = start + LEAST_LENGTH * float(jnp.finfo(end.dtype).eps) * jnp.maximum(jnp.abs(start), jnp.abs(end))
    return RootBracket(
        on=place <= last,
        which=which,
        low=start,
        # One point further, because the quartic's zero may lie a little before the function's.
        high=jnp.minimum(start + fraction(place + 1) * length, end),
        below=jnp.where(samples[-1] <= 0, end, jnp.inf),
        target=jnp.minimum(jnp.maximum(start + root * length, earliest), end),
        earliest=earliest,
        x=start,
        f=jnp.zeros_like(end),
        size=jnp.max(jnp.abs(samples)),
        tries=jnp.zeros_like(which),
    )


def _columns(dtype: Any) -> Float[Array, "nodes 1 fractions"]:
    """Computes for each node the polynomial that is 1 there and 0 at the others, at the fractions of a step."""
    return jnp.asarray(sampling().matrix, dtype).T[:, None, :]


def _root(samples: Float[Array, " nodes"], low: Float[Array, ""], high: Float[Array, ""]) -> Float[Array, ""]:
    """Finds where the quartic through the samples falls to zero between two fractions of a step."""
    a0, a1, a2, a3, a4 = (sum(power * sample for power, sample in zip(row, samples, strict=True)) for row in POWERS)

    def at(u: Float[Array, ""]) -> Sample:
        return Sample(u, a0 + u * (a1 + u * (a2 + u * (a3 + u * a4))))

    def narrow(_, bracket: tuple[Sample, Sample]) -> tuple[Sample, Sample]:
        newest = at(next_point(*bracket))
        return other_end(*bracket, newest), newest

    return jax.lax.fori_loop(0, ROOT_STEPS, narrow, (at(low), at(high)))[1].x
