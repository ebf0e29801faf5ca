"""Finds all times within a step of a solve at which functions of time cross zero, from left to right, for events.

A step is cut into pieces, and pieces are halved, until of each function one thing is certain in a piece:

- it has no zero there, because the constant term of its Chebyshev series outweighs all others;
- or it is monotone, because the constant term of the series of its slope does, so that it has one zero at most, which
  the signs at the ends of the piece tell;
- or it is zero throughout, to rounding, as where it touches zero: its sign is then that of before.

So two zeros that are near each other are told apart by pieces that are smaller than their distance. The series is that
of the polynomial through a few Chebyshev points; it is trusted as far as its last terms have decayed. A function that
changes within a 4096th of a step as it did within the whole is not resolved: there, only changes of sign from one end
of the smallest pieces to the other are found.

The samples of a piece in which a function swings many times are as good as random. Random samples look like those of a
function without a zero in one of 30,000 pieces, because the later a term of the series, the smaller it must be. A piece
is at most twice as long as the one before it, in the same step or the one before: where swings are resolved, the next
ones are looked at in pieces that resolve them, so that this chance is taken once in a run and not in each piece. A
function that begins to swing within a step takes it again, and what it hides is missed without a word.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import chebyshev

from ...numerics.arrays import select_tree
from ...programs.derivatives.reverse_rules import put

# As many samples of a piece as fill a vector, its ends among them.
SAMPLES_OF_PIECE = 8
# No piece is longer than this part of a run, as long as a step has at most MOST_PIECES: a long step, such as one of a
# body that rolls freely, would hide what a function does within it.
LONGEST_PIECE = 1 / 32
MOST_FIRST_PIECES = 32
SMALLEST_LEVEL = 12  # halvings of a step down to which a function is resolved
# The weights of the last terms of a series: of random samples they are as large as the first.
TAIL = (16.0, 16.0, 64.0, 64.0)
SLOPE_TAIL = 64.0  # the same for the slope: the term of order n weighs n² as much
DECAYED = 0.1  # the last terms, relative to all but the constant one, of a series that is trusted
CLEARANCE = 1.1  # by which the constant term outweighs the others, where the states are less accurate
ROUNDINGS = 64  # of a function's size in a step: values below are zero

# The part of a bracket on each side of the zero's estimate in which it is sought next: at most, and at least.
WIDEST, NARROWEST = 0.25, 1e-4
MOST_WINDOWS = 60

Functions = Callable[[Float[Array, " samples"]], Float[Array, "samples k"]]


class Kinds(NamedTuple):
    """Which crossings of each of k functions to find; a program is compiled for them.

    - ``directions``: upwards (1), downwards (−1) or both (0).
    - ``from_start``: whether a run that starts beyond zero has crossed it at its start.
    - ``terminal``: whether nothing is sought beyond the first one.
    - ``capacities``: how many are kept.
    """

    directions: tuple[int, ...]
    from_start: tuple[bool, ...]
    terminal: tuple[bool, ...]
    capacities: tuple[int, ...]

    @property
    def capacity(self) -> int:
        """How many crossings are kept of all functions together."""
        return sum(self.capacities)

    @property
    def parts(self) -> list[slice]:
        """The places of those of each function."""
        ends = np.cumsum(self.capacities)
        return [slice(int(end) - capacity, int(end)) for end, capacity in zip(ends, self.capacities, strict=True)]

    def which(self, place: Int[Array, ""]) -> Int[Array, ""]:
        """Returns the index of the function whose crossings have a place."""
        return jnp.sum(place >= np.cumsum(self.capacities))


class Signs(NamedTuple):
    """The signs of k functions up to some time: 1, −1, or 0 where none is known, and ``since`` when it is certain."""

    sign: Float[Array, " k"]
    since: Float[Array, " k"]


class Log(NamedTuple):
    """Holds the crossings of k functions so far, in the order in which they were found.

    - ``signs``: the signs at the end of the last step.
    - ``total``, ``unresolved``: how many crossings, and pieces that were not resolved, each function had.
    - ``least``, ``largest``: its extreme values at the samples.
    - ``filled``: how many crossings are kept, in the order in which they were found; ``times``: when each was;
      ``places``: the place of each among all that can be kept, first those of the first function.
    - ``ended``: whether a terminal one is among them.
    - ``halvings``: of the longest pieces, down to the one in which the last step ended.
    """

    signs: Signs
    total: Int[Array, " k"]
    unresolved: Int[Array, " k"]
    least: Float[Array, " k"]
    largest: Float[Array, " k"]
    filled: Int[Array, ""]
    times: Float[Array, " capacity"]
    places: Int[Array, " capacity"]
    ended: Bool[Array, ""]
    halvings: Int[Array, ""]

    @classmethod
    def empty(cls, kinds: Kinds, start: Float[Array, ""]) -> "Log":
        """Makes the log before the first step; where a start beyond zero counts, the sign before is the other one."""
        none = jnp.zeros(len(kinds.capacities), int)
        before = [-direction if early else 0 for direction, early in zip(*kinds[:2], strict=True)]
        signs = Signs(jnp.asarray(before, start.dtype), jnp.full(none.shape, start))
        extremes = jnp.full(none.shape, jnp.inf, start.dtype)
        times = jnp.full(kinds.capacity, jnp.inf, start.dtype)
        nothing, places = jnp.asarray(0), jnp.zeros(kinds.capacity, int)
        return cls(signs, none, none, extremes, -extremes, nothing, times, places, jnp.asarray(False), nothing)

    @property
    def first_halvings(self) -> Int[Array, ""]:
        """The halvings of the longest pieces with which the next step is begun."""
        return jnp.maximum(self.halvings - 1, 0)


class Span(NamedTuple):
    """The times of a step: its start, the last time within it, and the times at which the run starts and ends."""

    start: Float[Array, ""]
    last: Float[Array, ""]
    run: tuple[Float[Array, ""], Float[Array, ""]]

    def time(self, fraction: Float[Array, "..."]) -> Float[Array, "..."]:
        """Returns the time at a fraction of the step."""
        return jnp.where(fraction < 1, self.start + fraction * (self.last - self.start), self.last)

    @property
    def ends_run(self) -> Bool[Array, ""]:
        """Whether the run ends with the step."""
        first, last = self.run
        # ``last`` of a step is a little before its end, and so is never the end of the run itself.
        near = ROUNDINGS * float(jnp.finfo(last.dtype).eps) * jnp.maximum(jnp.abs(last), last - first)
        return last - self.last <= near

    @property
    def near_start(self) -> Float[Array, ""]:
        """The time up to which a crossing is at the start of the run."""
        first, last = self.run
        eps = float(jnp.finfo(last.dtype).eps)
        return first + ROUNDINGS**2 * eps * (last - first) + ROUNDINGS * eps * jnp.abs(first)


class _Matrices(NamedTuple):
    """The Chebyshev points of a piece, and what takes the values there to two series.

    ``value`` gives that of the polynomial through them, ``slope`` that of its slope.
    """

    nodes: np.ndarray
    value: np.ndarray
    slope: np.ndarray


@cache
def _matrices() -> _Matrices:
    x = -np.cos(np.pi * np.arange(SAMPLES_OF_PIECE) / (SAMPLES_OF_PIECE - 1))
    value = np.linalg.inv(chebyshev.chebvander(x, SAMPLES_OF_PIECE - 1))
    nodes = (1 + x) / 2
    # Exactly, so that the end of a piece is the start of the next.
    nodes[0], nodes[-1] = 0.0, 1.0
    return _Matrices(nodes, value, chebyshev.chebder(value, axis=0))


class _Piece(NamedTuple):
    """Of each function in a piece: the values, and what is certain about them.

    ``clear``: no zero, ``monotone``: one at most, ``decayed``: whether the series is trusted.
    """

    samples: Float[Array, "samples k"]
    clear: Bool[Array, " k"]
    monotone: Bool[Array, " k"]
    decayed: Bool[Array, " k"]

    @classmethod
    def of(cls, samples: Float[Array, "samples k"]) -> "_Piece":
        """Examines the samples of a piece. Comparisons with NaN are false: nothing is certain then."""
        value, slope = (_sizes(matrix, samples) for matrix in (_matrices().value, _matrices().slope))
        others, tail = jnp.sum(value[1:], axis=0), value[-1] + value[-2]
        return cls(
            samples,
            clear=_is_clear(value),
            monotone=slope[0] > jnp.sum(slope[1:], axis=0) + SLOPE_TAIL * value[-1],
            decayed=tail <= DECAYED * others,
        )


def _sizes(matrix: np.ndarray, samples: Float[Array, "samples k"]) -> Float[Array, "terms k"]:
    """Computes the sizes of the terms of a series."""
    return jnp.abs(jnp.sum(jnp.asarray(matrix, samples.dtype)[..., None] * samples[None], axis=1))


def _is_clear(terms: Float[Array, "terms k"], clearance: float = 1.0) -> Bool[Array, " k"]:
    """Tells whether a function has no zero, by the sizes of the terms of its series."""
    tail = jnp.asarray(TAIL, terms.dtype)
    return terms[0] > clearance * jnp.sum(terms[1:], axis=0) + jnp.sum(tail[:, None] * terms[-tail.size :], axis=0)


class _Pieces(NamedTuple):
    """The pieces of steps, in units of the smallest one: ``unit`` of them are a step."""

    unit: int

    @classmethod
    def of(cls, dtype: Any) -> "_Pieces":
        """Chooses the smallest piece for a type of numbers, in which the ends of all pieces are exact."""
        return cls(1 << (44 if jnp.finfo(dtype).bits == 64 else 18))

    def longest(self, span: Span) -> Int[Array, ""]:
        """Returns the length of the pieces with which a step is begun."""
        length, run = span.last - span.start, span.run[1] - span.run[0]
        halvings = [length > LONGEST_PIECE * 2.0**k * run for k in range(MOST_FIRST_PIECES.bit_length() - 1)]
        return jnp.asarray(self.unit) >> sum(jnp.where(halve, 1, 0) for halve in halvings)

    def times(self, span: Span, place: Int[Array, ""], width: Int[Array, ""]) -> Float[Array, " samples"]:
        """Returns the times of the Chebyshev points of a piece."""
        nodes = jnp.asarray(_matrices().nodes, span.start.dtype)
        return span.time((place.astype(nodes.dtype) + nodes * width.astype(nodes.dtype)) / float(self.unit))


class Glance(NamedTuple):
    """What a step looks like: whether it is certain that no function crosses zero, and the size of each function."""

    quiet: Bool[Array, ""]
    size: Float[Array, " k"]
    least: Float[Array, " k"]
    largest: Float[Array, " k"]


def glance(functions: Functions, span: Span, log: Log) -> Glance:
    """Looks at a step by ``functions`` that may be less accurate than it is, in its longest pieces alone."""
    pieces, signs = _Pieces.of(span.start.dtype), log.signs
    width, nothing = pieces.longest(span), jnp.zeros_like(signs.since)

    def look(carry: tuple[Array, Glance]) -> tuple[Array, Glance]:
        place, seen = carry
        samples = functions(pieces.times(span, place, width))
        same = (signs.sign != 0) & ((signs.sign > 0) == (samples[-1] > 0))
        clear = same & _is_clear(_sizes(_matrices().value, samples), CLEARANCE)
        finite = jnp.isfinite(samples)
        return place + width, Glance(
            seen.quiet & jnp.all(clear),
            jnp.maximum(seen.size, jnp.max(jnp.where(finite, jnp.abs(samples), 0.0), axis=0)),
            jnp.minimum(seen.least, jnp.min(jnp.where(finite, samples, jnp.inf), axis=0)),
            jnp.maximum(seen.largest, jnp.max(jnp.where(finite, samples, -jnp.inf), axis=0)),
        )

    # Where the last step ended in short pieces, a look at the longest ones proves nothing.
    begin = Glance(log.first_halvings == 0, nothing, nothing + jnp.inf, nothing - jnp.inf)
    return jax.lax.while_loop(lambda carry: carry[0] < pieces.unit, look, (jnp.asarray(0), begin))[1]


class _Search(NamedTuple):
    """The zeros that are sought, one after the other.

    - ``pending``: of which functions, ``roots``: those found, infinite where none is sought.
    - ``low``: where each function is known to have its old ``sign``, negated; ``high`` where all have the new one.
    - ``bracket``: the two ends between which the zero of the first pending one lies, and ``window`` those between which
      it is sought next; ``tries``: how many windows there were.
    """

    pending: Bool[Array, " k"]
    roots: Float[Array, " k"]
    sign: Float[Array, " k"]
    low: Float[Array, " k"]
    high: Float[Array, ""]
    bracket: Float[Array, "2"]
    window: Float[Array, "2"]
    tries: Int[Array, ""]

    @classmethod
    def of(
        cls, crosses: Bool[Array, " k"], sign: Float[Array, " k"], low: Float[Array, " k"], high: Array
    ) -> "_Search":
        """Begins the search for a zero of each function that ``crosses`` it."""
        bracket = jnp.zeros(2, low.dtype)
        search = cls(crosses, jnp.full_like(low, jnp.inf), sign, low, high, bracket, bracket, jnp.asarray(0))
        return search._begin()

    @property
    def goes_on(self) -> Bool[Array, ""]:
        """Whether a zero is still to be found."""
        return jnp.any(self.pending)

    def of_first(self, values: Array) -> Array:
        """Picks the entry of the first pending function, along the last axis."""
        is_first = jnp.broadcast_to(self._is_first, values.shape)
        return jnp.sum(jnp.where(is_first, values, 0.0), axis=-1)

    @property
    def _is_first(self) -> Bool[Array, " k"]:
        place = jnp.arange(self.pending.size)
        return place == jnp.min(jnp.where(self.pending, place, self.pending.size))

    def _begin(self) -> "_Search":
        bracket = jnp.stack([self.of_first(self.low), self.high])
        return self._replace(bracket=bracket, window=bracket, tries=jnp.asarray(0))

    def narrow(self, times: Float[Array, " samples"], samples: Float[Array, "samples k"]) -> "_Search":
        """Narrows the bracket by the values in the window, to the two samples between which the sign changes."""
        values = self.of_first(samples) * self.of_first(self.sign)
        has_sign, place = values >= 0, jnp.arange(times.size)
        after = jnp.min(jnp.where(has_sign, place, times.size))

        def entry(x: Array, k: Array, otherwise: Array) -> Array:
            return jnp.where((k >= 0) & (k < times.size), jnp.sum(jnp.where(place == k, x, 0.0)), otherwise)

        low, high = entry(times, after - 1, self.bracket[0]), entry(times, after, self.bracket[1])
        before, beyond = entry(values, after - 1, jnp.zeros_like(low)), entry(values, after, jnp.zeros_like(low))
        between = (after > 0) & (after < times.size)
        share = jnp.where(between & (beyond > before), -before / jnp.where(beyond > before, beyond - before, 1.0), 0.5)
        gap, whole = high - low, self.high - self.of_first(self.low)
        root = low + share * gap
        # Where a function is smooth, the secant is off by the square of the gap; after a miss, all is searched.
        aside = gap * jnp.clip(gap / jnp.where(whole > 0, whole, 1.0), NARROWEST, WIDEST)
        near = jnp.stack([jnp.maximum(low, root - aside), jnp.minimum(high, root + aside)])
        bracket = jnp.stack([low, high])
        search = self._replace(bracket=bracket, window=jnp.where(between, near, bracket), tries=self.tries + 1)
        eps = float(jnp.finfo(gap.dtype).eps)
        done = (gap <= 2 * eps * jnp.maximum(jnp.abs(root), whole)) | (search.tries >= MOST_WINDOWS)
        return select_tree(done, self._enter(root), search)

    def _enter(self, root: Float[Array, ""]) -> "_Search":
        """Enters the zero of the first pending function, and begins the search for the next one."""
        is_first = self._is_first
        search = self._replace(pending=self.pending & ~is_first, roots=jnp.where(is_first, root, self.roots))
        return search._begin()


class _Scan(NamedTuple):
    """The piece of a step that comes next, and the log up to there. ``enters`` before the first one.

    The log's ``halvings`` are those of the piece. ``search``: for the zeros in the last piece, which come first.
    """

    place: Int[Array, ""]
    enters: Bool[Array, ""]
    log: Log
    search: _Search


def scan(functions: Functions, span: Span, seen: Glance, kinds: Kinds, log: Log, asked: Bool[Array, ""]) -> Log:
    """Adds the crossings of a step to the log, if that is ``asked`` for; up to the first terminal one.

    ``functions`` are as accurate as the step. They are called in one place, because they may be long.
    """
    pieces = _Pieces.of(span.start.dtype)
    longest = pieces.longest(span)
    noise = ROUNDINGS * float(jnp.finfo(span.start.dtype).eps) * seen.size

    def goes_on(scan: _Scan) -> Bool[Array, ""]:
        return (scan.place < pieces.unit) & ~scan.log.ended | scan.search.goes_on

    def look(scan: _Scan) -> _Scan:
        seeks, (first, last) = scan.search.goes_on, scan.search.window
        window = first + jnp.asarray(_matrices().nodes, first.dtype) * (last - first)
        times = jnp.where(seeks, window, pieces.times(span, scan.place, longest >> scan.log.halvings))
        samples = functions(times)

        def seek(scan: _Scan) -> _Scan:
            search = scan.search.narrow(times, samples)
            noted = _add_zeros(scan.log, kinds, span, search.roots)
            return scan._replace(search=search, log=select_tree(search.goes_on, scan.log, noted))

        return jax.lax.cond(seeks, seek, lambda scan: go_on(scan, times, samples), scan)

    def go_on(scan: _Scan, times: Array, samples: Array) -> _Scan:
        piece = _Piece.of(samples)
        # Zero throughout, to rounding, and without a finite value there is nothing to be found.
        simple = piece.clear | piece.monotone | jnp.all(jnp.abs(samples) <= noise[None], axis=0)
        simple |= ~jnp.any(jnp.isfinite(samples), axis=0)
        # A series that is trusted has two zeros close to each other, or touches zero: smaller pieces tell.
        smallest = jnp.where(piece.decayed, 1, pieces.unit >> min(SMALLEST_LEVEL, pieces.unit.bit_length() - 1))
        halvings, width = scan.log.halvings, longest >> scan.log.halvings
        passes = scan.enters | jnp.all(simple | (width <= smallest))
        # A jump at the start of the step comes before all pieces: the first time, only the start is passed.
        place = scan.place + jnp.where(scan.enters, 0, width)
        end = jnp.where(scan.enters, 0, -1)
        log, search = _pass_piece(span, piece, (times[end], samples[end]), simple | scan.enters, noise, kinds, scan.log)
        # The next piece is twice as long, if one of that length begins here in the tree of halves.
        doubles = ~scan.enters & (halvings > 0) & (place & (2 * width - 1) == 0)
        passed = _Scan(place, jnp.asarray(False), log._replace(halvings=halvings - jnp.where(doubles, 1, 0)), search)
        return select_tree(passes, passed, scan._replace(log=scan.log._replace(halvings=halvings + 1)))

    signs = log.signs._replace(since=jnp.maximum(log.signs.since, span.start))
    none = jnp.zeros(signs.sign.shape, bool)
    search = _Search.of(none, signs.sign, signs.since, span.start)
    log = log._replace(signs=signs, halvings=jnp.where(asked, log.first_halvings, log.halvings))
    begin = _Scan(jnp.where(asked, 0, pieces.unit), asked, log, search)
    return jax.lax.while_loop(goes_on, look, begin).log


def _pass_piece(
    span: Span,
    piece: _Piece,
    end: tuple[Float[Array, ""], Float[Array, " k"]],
    simple: Bool[Array, " k"],
    noise: Float[Array, " k"],
    kinds: Kinds,
    log: Log,
) -> tuple[Log, _Search]:
    """Notes the signs at the end of a piece in which each changes once at most, and begins the search for these zeros.

    ``end``: the end of the piece with the values there; ``simple``: whether the piece is certain to be so.
    """
    old, (t, values) = log.signs, end
    # A function that has fallen to zero, to rounding, as the run ends has crossed it.
    falls = span.ends_run & (t >= span.last) & piece.monotone & (old.sign != 0) & (jnp.abs(values) <= noise)
    certain = (jnp.abs(values) > noise) | falls
    new = jnp.where(falls, -old.sign, jnp.where(values > 0, 1.0, -1.0))
    sign = jnp.where(jnp.isnan(values), 0.0, jnp.where(certain, new, old.sign))
    directions = jnp.asarray(kinds.directions, sign.dtype)
    crosses = (old.sign * sign < 0) & ((directions == 0) | (directions == sign))
    steps = jnp.diff(piece.samples, axis=0)
    in_order = jnp.all(steps >= 0, axis=0) | jnp.all(steps <= 0, axis=0)
    missed = ~simple & ~in_order & jnp.all(jnp.isfinite(piece.samples), axis=0)
    log = log._replace(
        signs=Signs(sign, jnp.where(certain, t, old.since)), unresolved=log.unresolved + jnp.where(missed, 1, 0)
    )
    return log, _Search.of(crosses, sign, old.since, t)


def _add_zeros(log: Log, kinds: Kinds, span: Span, roots: Float[Array, " k"]) -> Log:
    """Adds the zeros of a piece to the log: up to the first terminal one, and as many as there is room for."""
    crosses = jnp.isfinite(roots) & (jnp.asarray(kinds.from_start) | (roots > span.near_start))
    terminal = jnp.where(crosses & jnp.asarray(kinds.terminal), roots, jnp.inf)
    # Two functions that cross zero together, to rounding, both do.
    together = ROUNDINGS * float(jnp.finfo(roots.dtype).eps) * jnp.maximum(jnp.abs(span.start), jnp.abs(span.last))
    crosses &= roots <= jnp.min(terminal) + together
    filled, times, places = log.filled, log.times, log.places
    for k, part in enumerate(kinds.parts):
        place = part.start + log.total[k]
        keeps = crosses[k] & (place < part.stop)
        times, places = put(times, filled, roots[k], keeps), put(places, filled, place, keeps)
        filled += jnp.where(keeps, 1, 0)
    total = log.total + jnp.where(crosses, 1, 0)
    return log._replace(filled=filled, times=times, places=places, total=total, ended=jnp.any(jnp.isfinite(terminal)))
