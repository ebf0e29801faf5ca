"""Finds all times within a step of a solve at which functions of time cross zero, from left to right.

``watch`` finds events by it, and ``mode_ends`` the first zero of a guard. A step is cut into pieces, and pieces are
halved, until of each function one thing is certain in a piece:

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
is at most twice as long as the one before it, in the same step or the one before, however long the steps are: where
swings are resolved, the next ones are looked at in pieces that resolve them, so that this chance is taken once in a run
and not in each piece. A function that begins to swing within a step takes it again, and what it hides is missed without
a word.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ....numerics.arrays import entry, select_tree
from ....numerics.pieces import ROUNDINGS, Piece, Pieces, Span, nodes_between
from ....programs.derivatives.reverse_rules import put

CLEARANCE = 1.1  # by which a term of a series outweighs the others, where the states are less accurate
SMALLEST_LEVEL = 12  # halvings of a step down to which a function is resolved
# The part of a bracket on each side of the zero's estimate in which it is sought next: at most, and at least.
WIDEST, NARROWEST = 0.25, 1e-4
SECANT = 1e-5  # of a step: a secant as short as that is off by a 1e-10th of it, or less
FROM_ZERO = 1e-6  # of its value at the end of the first piece: a smaller one at the start of a step is rounding
SLOPE_GAP = 1e-6  # of the whole: in a window shorter than that a slope is not to be had
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
    - ``piece``: the length of the piece in which the last step ended, infinite before the first.
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
    piece: Float[Array, ""]

    @classmethod
    def empty(cls, kinds: Kinds, start: Float[Array, ""]) -> "Log":
        """Makes the log before the first step; where a start beyond zero counts, the sign before is the other one."""
        none = jnp.zeros(len(kinds.capacities), int)
        before = [-direction if early else 0 for direction, early in zip(*kinds[:2], strict=True)]
        signs = Signs(jnp.asarray(before, start.dtype), jnp.full(none.shape, start))
        extremes = jnp.full(none.shape, jnp.inf, start.dtype)
        times = jnp.full(kinds.capacity, jnp.inf, start.dtype)
        nothing, places, no = jnp.asarray(0), jnp.zeros(kinds.capacity, int), jnp.asarray(False)
        never = jnp.full_like(start, jnp.inf)
        return cls(signs, none, none, extremes, -extremes, nothing, times, places, no, never)


class Glance(NamedTuple):
    """What a step looks like.

    - ``quiet``: whether it is certain that no function crosses zero.
    - ``size``, ``least``, ``largest``: of each function, at the samples.
    - ``first``, ``last``: the values at the ends of the step.
    - ``piece``: the length of the piece in which it ends.
    """

    quiet: Bool[Array, ""]
    size: Float[Array, " k"]
    least: Float[Array, " k"]
    largest: Float[Array, " k"]
    first: Float[Array, " k"]
    last: Float[Array, " k"]
    piece: Float[Array, ""]


def glance(functions: Functions, span: Span, log: Log, *, whole: bool = False) -> Glance:
    """Looks at a step by ``functions`` that may be less accurate than it is, in the longest pieces that it may have.

    ``whole``: these may be whole steps, which are halved where a function may have a zero.
    """
    pieces, signs = Pieces.of(span.start.dtype, whole), log.signs
    nothing = jnp.zeros_like(signs.since)

    def look(carry: tuple[Array, Array, Glance]) -> tuple[Array, Array, Glance]:
        place, width, seen = carry
        piece = Piece.of(functions(pieces.times(span, place, width)), CLEARANCE)
        samples, end = piece.samples, place + width
        finite = jnp.isfinite(samples)
        # A function that is monotone from one sign to the same one has no zero between.
        same = jnp.all((signs.sign != 0) & (signs.sign * samples[-1] > 0) & (piece.clear | piece.monotone))
        halves = ~same & (width > pieces.shortest(span)) if whole else False
        seen = Glance(
            seen.quiet & (same | halves),
            jnp.maximum(seen.size, jnp.max(jnp.where(finite, jnp.abs(samples), 0.0), axis=0)),
            jnp.minimum(seen.least, jnp.min(jnp.where(finite, samples, jnp.inf), axis=0)),
            jnp.maximum(seen.largest, jnp.max(jnp.where(finite, samples, -jnp.inf), axis=0)),
            jnp.where(place == 0, samples[0], seen.first),
            samples[-1],
            pieces.length(span, width),
        )
        if not whole:
            return end, pieces.next(span, end, width), seen
        return jnp.where(halves, place, end), jnp.where(halves, width >> 1, pieces.next(span, end, width)), seen

    unknown = Glance(jnp.asarray(True), nothing, nothing + jnp.inf, nothing - jnp.inf, nothing, nothing, log.piece)
    begin = jnp.asarray(0), pieces.first(span, log.piece), unknown
    return jax.lax.while_loop(lambda carry: carry[0] < pieces.unit, look, begin)[2]


class _Search(NamedTuple):
    """The zeros that are sought, one after the other.

    - ``pending``: of which functions, ``roots``: those found, infinite where none is sought, and ``slopes`` there.
    - ``low``: where each function is known to have its old ``sign``, negated; ``high`` where all have the new one.
    - ``bracket``: the two ends between which the zero of the first pending one lies, and ``window`` those between which
      it is sought next; ``tries``: how many windows there were.
    """

    pending: Bool[Array, " k"]
    roots: Float[Array, " k"]
    slopes: Float[Array, " k"]
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
        unknown, none = jnp.full_like(low, jnp.inf), jnp.zeros_like(low)
        search = cls(crosses, unknown, none, sign, low, high, bracket, bracket, jnp.asarray(0))
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

    def narrow(
        self, times: Float[Array, " samples"], samples: Float[Array, "samples k"], close: Float[Array, ""] | float
    ) -> "_Search":
        """Narrows the bracket by the values in the window, to the two samples between which the sign changes.

        ``close``: if they are, the zero of the secant is exact enough.
        """
        values = self.of_first(samples) * self.of_first(self.sign)
        has_sign, place = values >= 0, jnp.arange(times.size)
        after = jnp.min(jnp.where(has_sign, place, times.size))

        low = jnp.where(after > 0, entry(after - 1, times), self.bracket[0])
        high = jnp.where(after < times.size, entry(after, times), self.bracket[1])
        before, beyond = entry(after - 1, values), entry(after, values)
        between = (after > 0) & (after < times.size)
        share = jnp.where(between & (beyond > before), -before / jnp.where(beyond > before, beyond - before, 1.0), 0.5)
        gap, whole = high - low, self.high - self.of_first(self.low)
        root = low + share * gap
        # Where a function is smooth, the secant is off by the square of the gap; after a miss, all is searched.
        aside = gap * jnp.clip(gap / jnp.where(whole > 0, whole, 1.0), NARROWEST, WIDEST)
        near = jnp.stack([jnp.maximum(low, root - aside), jnp.minimum(high, root + aside)])
        bracket, eps = jnp.stack([low, high]), float(jnp.finfo(gap.dtype).eps)
        # Closer to the zero, the difference of two values is rounding.
        tells = between & self._is_first & (gap > SLOPE_GAP * whole)
        slope = self.of_first(self.sign) * (beyond - before) / jnp.where(gap > 0, gap, 1.0)
        slopes = jnp.where(tells | (self._is_first & (self.slopes == 0)), slope, self.slopes)
        window = jnp.where(between, near, bracket)
        search = self._replace(bracket=bracket, window=window, slopes=slopes, tries=self.tries + 1)
        done = (gap <= 2 * eps * jnp.maximum(jnp.abs(root), whole)) | (search.tries >= MOST_WINDOWS)
        done |= between & (gap <= close)
        return select_tree(done, self._enter(root), search)

    def _enter(self, root: Float[Array, ""]) -> "_Search":
        """Enters the zero of the first pending function, and begins the search for the next one."""
        is_first = self._is_first
        search = self._replace(pending=self.pending & ~is_first, roots=jnp.where(is_first, root, self.roots))
        return search._begin()


class _Scan(NamedTuple):
    """The piece of a step that comes next, and the log up to there. ``enters`` before the first one.

    ``search``: for the zeros in the last piece, which come first.
    """

    place: Int[Array, ""]
    width: Int[Array, ""]
    enters: Bool[Array, ""]
    log: Log
    search: _Search


def scan(functions: Functions, span: Span, seen: Glance, kinds: Kinds, log: Log, asked: Bool[Array, ""]) -> Log:
    """Adds the crossings of a step to the log, if that is ``asked`` for; up to the first terminal one.

    ``functions`` are as accurate as the step. They are called in one place, because they may be long.
    """
    # A jump at the start of the step comes before all pieces: the first time, only the start is passed.
    return _scan(functions, span, seen, kinds, log, asked, enters=True, close=0.0).log


class FirstZero(NamedTuple):
    """The first of the zeros in a step to which functions fall that are positive at its start.

    - ``exists``: whether there is one.
    - ``which``: the index of its function.
    - ``time``, ``slope``: when it is, and the rate of the function there.
    - ``until``: a time from which the function certainly is not positive.
    - ``unresolved``: whether a function changed too quickly to be followed.
    - ``piece``: the length of the piece in which the search ended.
    """

    exists: Bool[Array, ""]
    which: Int[Array, ""]
    time: Float[Array, ""]
    slope: Float[Array, ""]
    until: Float[Array, ""]
    unresolved: Bool[Array, ""]
    piece: Float[Array, ""]


class Falling(NamedTuple):
    """Finds the first zero of functions that are positive as a step begins, where they may be zero by rounding.

    ``number``: how many there are. A zero is found as exactly as a secant over the part ``SECANT`` of a step is.
    """

    number: int

    def log(self, start: Float[Array, ""], piece: Float[Array, ""]) -> Log:
        """Returns the log as a step begins, after a ``piece`` of this length."""
        return Log.empty(self._kinds, start)._replace(piece=piece)

    def first(self, functions: Functions, span: Span, seen: Glance, log: Log, asked: Bool[Array, ""]) -> FirstZero:
        """Finds it, as :func:`scan` does, if that is ``asked`` for."""
        # The start is not looked at: below zero there by rounding, a function may rise.
        close = SECANT * span.length
        done = _scan(functions, span, seen, self._kinds, log, asked, enters=False, close=close)
        which = done.log.places[0]
        return FirstZero(
            exists=done.log.ended,
            which=which,
            time=done.log.times[0],
            slope=entry(which, done.search.slopes),
            until=entry(which, done.log.signs.since),
            unresolved=jnp.any(done.log.unresolved > 0),
            piece=done.log.piece,
        )

    @property
    def _kinds(self) -> Kinds:
        yes = (True,) * self.number
        return Kinds((-1,) * self.number, yes, yes, (1,) * self.number)


def _scan(
    functions: Functions,
    span: Span,
    seen: Glance,
    kinds: Kinds,
    log: Log,
    asked: Bool[Array, ""],
    *,
    enters: bool,
    close: Float[Array, ""] | float,
) -> _Scan:
    pieces = Pieces.of(span.start.dtype)
    noise = ROUNDINGS * float(jnp.finfo(span.start.dtype).eps) * seen.size

    def goes_on(scan: _Scan) -> Bool[Array, ""]:
        return (scan.place < pieces.unit) & ~scan.log.ended | scan.search.goes_on

    def look(scan: _Scan) -> _Scan:
        seeks, window = scan.search.goes_on, nodes_between(*scan.search.window)
        times = jnp.where(seeks, window, pieces.times(span, scan.place, scan.width))
        samples = functions(times)

        def seek(scan: _Scan) -> _Scan:
            search = scan.search.narrow(times, samples, close)
            noted = _add_zeros(scan.log, kinds, span, search.roots, (times, samples))
            return scan._replace(search=search, log=select_tree(search.goes_on, scan.log, noted))

        return jax.lax.cond(seeks, seek, lambda scan: go_on(scan, times, samples), scan)

    def go_on(scan: _Scan, times: Array, samples: Array) -> _Scan:
        piece = Piece.of(samples)
        # Zero throughout, to rounding, and without a finite value there is nothing to be found.
        simple = piece.clear | piece.monotone | jnp.all(jnp.abs(samples) <= noise[None], axis=0)
        simple |= ~jnp.any(jnp.isfinite(samples), axis=0)
        if not enters:
            # As the square of the time from a reset on, which no piece, however short, shows to be monotone.
            rises = jnp.all(jnp.diff(samples, axis=0) > 0, axis=0) & (jnp.abs(samples[0]) <= FROM_ZERO * samples[-1])
            simple |= (scan.place == 0) & piece.decayed & rises
        # A series that is trusted has two zeros close to each other, or touches zero: smaller pieces tell.
        smallest = jnp.where(piece.decayed, 1, pieces.unit >> min(SMALLEST_LEVEL, pieces.unit.bit_length() - 1))
        width = scan.width
        passes = scan.enters | jnp.all(simple | (width <= smallest))
        place = scan.place + jnp.where(scan.enters, 0, width)
        end = jnp.where(scan.enters, 0, -1)
        log, search = _pass_piece(span, piece, (times[end], samples[end]), simple | scan.enters, noise, kinds, scan.log)
        log = log._replace(piece=jnp.where(scan.enters, log.piece, pieces.length(span, width)))
        following = jnp.where(scan.enters, width, pieces.next(span, place, width))
        passed = _Scan(place, following, jnp.asarray(False), log, search)
        return select_tree(passes, passed, scan._replace(width=width >> 1))

    signs = log.signs._replace(since=jnp.maximum(log.signs.since, span.start))
    none = jnp.zeros(signs.sign.shape, bool)
    search, log = _Search.of(none, signs.sign, signs.since, span.start), log._replace(signs=signs)
    place, first = jnp.where(asked, 0, pieces.unit), pieces.first(span, log.piece)
    return jax.lax.while_loop(goes_on, look, _Scan(place, first, asked & enters, log, search))


def _pass_piece(
    span: Span,
    piece: Piece,
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


def _add_zeros(
    log: Log,
    kinds: Kinds,
    span: Span,
    roots: Float[Array, " k"],
    window: tuple[Float[Array, " samples"], Float[Array, "samples k"]],
) -> Log:
    """Adds the zeros of a piece to the log: up to the first terminal one, and as many as there is room for.

    ``window``: the times and samples by which the last zero was found, of which those up to the terminal one count
    among the extreme values: they are of the end of the run.
    """
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
    ended, (at, samples) = jnp.any(jnp.isfinite(terminal)), window
    counts = ended & (at <= jnp.min(terminal))[:, None] & jnp.isfinite(samples)
    least = jnp.minimum(log.least, jnp.min(jnp.where(counts, samples, jnp.inf), axis=0))
    largest = jnp.maximum(log.largest, jnp.max(jnp.where(counts, samples, -jnp.inf), axis=0))
    return Log(log.signs, total, log.unresolved, least, largest, filled, times, places, ended, log.piece)
