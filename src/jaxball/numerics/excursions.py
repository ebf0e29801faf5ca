"""Finds when functions of time first rise above zero in a run, as where a mass in prescribed motion leaves the shell.

The run is cut into pieces that end at kinks, and a piece is halved until it is certain of each function that it has no
zero there, or is monotone. As what is looked for may be short, and the functions tell nothing but their values, the
samples lie closer than those of a step, and the last terms of their series, by which anything short shows, count for
much more. No state is needed, so that nothing depends on the steps of a solve.

An excursion that is as long as a bell exp(−(t/w)²) with w 1/1000 of the run is found, wherever it is, by the samples
that meet its flanks; between kinks one of any length.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..programs.batches import fill_vectors
from .pieces import LONGER_PIECE, LONGEST_PIECE, Cut, Piece, nodes_between

SAMPLES = 16  # of a piece
DOUBT = 64.0  # the weight of the last terms of a series, relative to that within a step
SMALLEST_STRETCH = 2.0**-20  # the width of a piece that is not cut any more
HALVINGS = 52

Time = Float[Array, ""]


class Excursion(NamedTuple):
    """When a function first rises above zero, and a time soon after that at which it is above its margin; infinite
    where none does.
    """

    begin: Time
    seen: Time


class _Look(NamedTuple):
    """The piece that is looked at next, and the last time before an excursion and the first within it that are seen."""

    cut: Cut
    before: Time
    seen: Time


def first_excursion(
    functions: Callable[[Time], Float[Array, " k"]],
    margins: Float[Array, " k"] | Time,
    times: Float[Array, " T"],
    kinks: Float[Array, " kinks"],
) -> Excursion:
    """Finds the first excursion of k functions of time above zero, between the first and the last of ``times``.

    - ``margins``: of each function, above which its value is more than rounding.
    - ``kinks``: times at which functions are continuous but not smooth; infinite ones have no effect.

    It has no derivatives. A function that is not finite is not above anything.
    """
    start, length = times[0], times[-1] - times[0]
    places = (kinks.astype(start.dtype) - start) / jnp.where(length > 0, length, 1.0)

    def find_end(place: Array) -> Array:
        """Returns where the longest piece ends that begins at a place."""
        ahead = jnp.min(jnp.where(places > place, places, 1.0), initial=1.0)
        return jnp.minimum(place + LONGEST_PIECE, ahead)

    def look(state: _Look) -> _Look:
        cut = state.cut
        instants = start + nodes_between(cut.start, cut.end, SAMPLES) * length
        samples = fill_vectors(functions, instants) - margins
        piece, above = Piece.of(samples, doubt=DOUBT), jnp.any(samples > 0, axis=1)
        certain = jnp.all(piece.clear | piece.monotone | ~jnp.all(jnp.isfinite(samples), axis=0))
        passes = certain | (cut.width <= SMALLEST_STRETCH) | cut.is_last
        seen = jnp.min(jnp.where(above, instants, jnp.inf))

        def go_on(_) -> _Look:
            return _Look(cut.go_on(LONGER_PIECE * cut.width, find_end(cut.end)), instants[0], seen)

        return jax.lax.cond(passes, go_on, lambda _: state._replace(cut=cut.shorten()), None)

    def goes_on(state: _Look) -> Bool[Array, ""]:
        return (state.cut.start < 1) & jnp.isinf(state.seen)

    def halve(_, bracket: tuple[Time, Time]) -> tuple[Time, Time]:
        low, high = bracket
        middle = (low + high) / 2
        above = jnp.any(functions(middle) > 0)
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    place = jnp.zeros_like(start)
    first = Cut.first(place, place + LONGEST_PIECE, find_end(place))
    last = jax.lax.while_loop(goes_on, look, _Look(first, start, place + jnp.inf))
    # Most spans have none, and need no bisection.
    begin = jax.lax.cond(
        jnp.isfinite(last.seen),
        lambda: jax.lax.fori_loop(0, HALVINGS, halve, (last.before, last.seen))[1],
        lambda: last.seen,
    )
    return Excursion(begin, last.seen)
