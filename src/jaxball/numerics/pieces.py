"""Cuts a step of a solve, or a run, into pieces that are short enough for what is asked of functions of time within it.

``crossings`` looks for zeros in pieces of steps, and ``excursions`` in those of a whole run: the Chebyshev series of
the polynomial through a few samples of a piece tells whether a function has no zero there, and whether it is monotone.
``integrals`` integrates functions, and ``peaks`` finds where they are largest.

A piece that is not good enough is halved. The halves are looked at from left to right, so that nothing need be kept of
the others.
"""

from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import chebyshev

# As many samples of a piece as fill a vector, its ends among them.
SAMPLES = 8
# No piece is longer than this part of a run, as long as a step has at most MOST_PIECES: a long step, such as one of a
# body that rolls freely, would hide what a function does within it.
LONGEST_PIECE = 1 / 32
MOST_FIRST_PIECES = 32
LONGER_PIECE = 2.0  # the longest piece, relative to the one before it
# The weights of the last terms of a series: of random samples they are as large as the first.
TAIL = (16.0, 16.0, 64.0, 64.0)
SLOPE_TAIL = 64.0  # the same for the slope: the term of order n weighs n² as much
DECAYED = 0.1  # the last terms, relative to all but the constant one, of a series that is trusted
ROUNDINGS = 64  # of a function's size in a step: values below are zero
MOST_PIECES_TRIED = 4096  # in a step, after which the rest of it is one piece


class Span(NamedTuple):
    """The times of a step: its start, the last time within it, and the times at which the run starts and ends."""

    start: Float[Array, ""]
    last: Float[Array, ""]
    run: tuple[Float[Array, ""], Float[Array, ""]]

    def time(self, fraction: Float[Array, "..."]) -> Float[Array, "..."]:
        """Returns the time at a fraction of the step."""
        return jnp.where(fraction < 1, self.start + fraction * (self.last - self.start), self.last)

    @property
    def length(self) -> Float[Array, ""]:
        """The time from its start to the last time within it."""
        return self.last - self.start

    @property
    def of_run(self) -> Float[Array, ""]:
        """The length of the run."""
        return self.run[1] - self.run[0]

    @property
    def ends_run(self) -> Bool[Array, ""]:
        """Whether the run ends with the step."""
        _, last = self.run
        # ``last`` of a step is a little before its end, and so is never the end of the run itself.
        near = ROUNDINGS * float(jnp.finfo(last.dtype).eps) * jnp.maximum(jnp.abs(last), self.of_run)
        return last - self.last <= near

    @property
    def near_start(self) -> Float[Array, ""]:
        """The time up to which a crossing is at the start of the run."""
        first, last = self.run
        eps = float(jnp.finfo(last.dtype).eps)
        return first + ROUNDINGS**2 * eps * self.of_run + ROUNDINGS * eps * jnp.abs(first)


class _Matrices(NamedTuple):
    """The Chebyshev points of a piece, and what takes the values there to two series.

    ``value`` gives that of the polynomial through them, ``slope`` that of its slope.
    """

    nodes: np.ndarray
    value: np.ndarray
    slope: np.ndarray


@cache
def _matrices(count: int) -> _Matrices:
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    value = np.linalg.inv(chebyshev.chebvander(x, count - 1))
    nodes = (1 + x) / 2
    # Exactly, so that the end of a piece is the start of the next.
    nodes[0], nodes[-1] = 0.0, 1.0
    return _Matrices(nodes, value, chebyshev.chebder(value, axis=0))


def nodes_between(low: Float[Array, ""], high: Float[Array, ""], count: int = SAMPLES) -> Float[Array, " samples"]:
    """Returns the Chebyshev points between two numbers, which are the first and the last."""
    return low + jnp.asarray(_matrices(count).nodes, low.dtype) * (high - low)


class Piece(NamedTuple):
    """Of each function in a piece: the values, and what is certain about them.

    ``clear``: no zero, ``monotone``: one at most, ``decayed``: whether the series is trusted.
    """

    samples: Float[Array, "samples k"]
    clear: Bool[Array, " k"]
    monotone: Bool[Array, " k"]
    decayed: Bool[Array, " k"]

    @classmethod
    def of(cls, samples: Float[Array, "samples k"], clearance: float = 1.0, doubt: float = 1.0) -> "Piece":
        """Examines the samples of a piece. Comparisons with NaN are false: nothing is certain then.

        - ``clearance``: by which the constant term has to outweigh the others, above 1 where samples are less accurate.
        - ``doubt``: how many times more the last terms count, which tell what the samples miss.
        """
        matrices = _matrices(len(samples))
        value, slope = (_sizes(matrix, samples) for matrix in (matrices.value, matrices.slope))
        others, last, tail = jnp.sum(value[1:], axis=0), value[-1], doubt * jnp.asarray(TAIL, samples.dtype)
        return cls(
            samples,
            clear=value[0] > clearance * others + jnp.sum(tail[:, None] * value[-tail.size :], axis=0),
            monotone=slope[0] > clearance * jnp.sum(slope[1:], axis=0) + doubt * SLOPE_TAIL * last,
            decayed=last + value[-2] <= DECAYED * others,
        )


def _sizes(matrix: np.ndarray, samples: Float[Array, "samples k"]) -> Float[Array, "terms k"]:
    """Computes the sizes of the terms of a series."""
    return jnp.abs(jnp.sum(jnp.asarray(matrix, samples.dtype)[..., None] * samples[None], axis=1))


class Pieces(NamedTuple):
    """The pieces of steps, in units of the smallest one: ``unit`` of them are a step.

    A step is halved, and its halves are, so that the pieces are leaves of a tree: one begins at a multiple of its
    width. ``whole`` says that a piece may be a whole step, however long that is.
    """

    unit: int
    whole: bool = False

    @classmethod
    def of(cls, dtype: Any, whole: bool = False) -> "Pieces":
        """Chooses the smallest piece for a type of numbers, in which the ends of all pieces are exact."""
        return cls(1 << (44 if jnp.finfo(dtype).bits == 64 else 18), whole)

    def longest(self, span: Span) -> Int[Array, ""]:
        """Returns the width of the longest pieces of a step."""
        return jnp.asarray(self.unit) if self.whole else self.shortest(span)

    def shortest(self, span: Span) -> Int[Array, ""]:
        """Returns the width of the pieces of a step in which all that varies with time alone is looked at."""
        halvings = [
            span.length > LONGEST_PIECE * 2.0**k * span.of_run for k in range(MOST_FIRST_PIECES.bit_length() - 1)
        ]
        return jnp.asarray(self.unit) >> sum(jnp.where(halve, 1, 0) for halve in halvings)

    def first(self, span: Span, before: Float[Array, ""]) -> Int[Array, ""]:
        """Returns the width of the piece with which a step is begun, after one of the length ``before``."""
        longest = self.longest(span)
        length, most = self.length(span, longest), LONGER_PIECE * before
        share = jnp.where(length > most, length / jnp.where(most > 0, most, length), 1.0)
        halvings = jnp.minimum(jnp.ceil(jnp.log2(share)), self.unit.bit_length() - 1)
        return jnp.maximum(longest >> halvings.astype(longest.dtype), 1)

    def next(self, span: Span, end: Int[Array, ""], width: Int[Array, ""]) -> Int[Array, ""]:
        """Returns the width of the piece that comes after one which ends at ``end``: twice as long, if such a piece
        begins here.
        """
        doubles = (width < self.longest(span)) & (end & (2 * width - 1) == 0)
        return jnp.where(doubles, 2 * width, width)

    def length(self, span: Span, width: Int[Array, ""]) -> Float[Array, ""]:
        """Returns the length of a piece in time."""
        return span.length * (width.astype(span.start.dtype) / float(self.unit))

    def times(self, span: Span, place: Int[Array, ""], width: Int[Array, ""]) -> Float[Array, " samples"]:
        """Returns the times of the Chebyshev points of a piece."""
        nodes = jnp.asarray(_matrices(SAMPLES).nodes, span.start.dtype)
        return span.time((place.astype(nodes.dtype) + nodes * width.astype(nodes.dtype)) / float(self.unit))


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
