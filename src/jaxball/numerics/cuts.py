"""Cuts a step of a solve, or a run, into pieces that are short enough for what is asked of functions of time within it.

``integrals`` integrates them, ``peaks`` finds where they are largest, and ``excursions`` when they are first beyond
something. A piece that is not good enough is halved. The halves are looked at from left to right, so that nothing need
be kept of the others.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .pieces import LONGEST_PIECE, MOST_FIRST_PIECES

MOST_PIECES_TRIED = 4096  # in a step, after which the rest of it is one piece


class Cut(NamedTuple):
    """The piece of a step that is tried next, in fractions of the step, or of a longer range of places.

    - ``limit``: the end of the last piece that was not good enough, if that lies beyond ``start``.
    - ``trials``: how many pieces have been tried.
    """

    start: Float[Array, ""]
    end: Float[Array, ""]
    limit: Float[Array, ""]
    trials: Int[Array, ""]

    @classmethod
    def first(cls, start: Float[Array, ""], longest: Float[Array, ""], last: Float[Array, ""] | float) -> "Cut":
        """Returns the first piece, from ``start``."""
        return cls(start, jnp.minimum(start + longest, last), start, jnp.asarray(0))

    @property
    def width(self) -> Float[Array, ""]:
        """The width of the piece."""
        return self.end - self.start

    @property
    def is_last(self) -> Bool[Array, ""]:
        """Whether no piece is cut any more, because too many have been."""
        return self.trials >= MOST_PIECES_TRIED

    def shorten(self, end: Float[Array, ""] | None = None) -> "Cut":
        """Returns the piece up to an ``end``, or half of it, to be tried next."""
        end = self.start + 0.5 * self.width if end is None else end
        return self._replace(end=end, limit=self.end, trials=self.trials + 1)

    def go_on(self, longest: Float[Array, ""], last: Float[Array, ""] | float) -> "Cut":
        """Returns the piece behind this one: the rest of one that was not good enough, or one as long as
        ``longest``, up to ``last``.
        """
        start, trials = self.end, self.trials + 1
        end = jnp.where(trials < MOST_PIECES_TRIED, jnp.minimum(start + longest, last), last)
        return Cut(start, jnp.where(start < self.limit, self.limit, end), self.limit, trials)


def longest_share(length: Float[Array, ""], run: Float[Array, ""]) -> Float[Array, ""]:
    """Returns the largest share of a step of a ``length`` that is one piece at first, in a run of the length ``run``.

    Where the state rests a step may be as long as the run, and functions may swing many times within it.
    """
    share = LONGEST_PIECE * run / jnp.where(length > 0, length, run)
    return jnp.clip(share, 1 / MOST_FIRST_PIECES, 1.0)
