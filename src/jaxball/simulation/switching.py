"""Where in a solve the mode of a system ends, and how the solve continues.

Each step is checked as soon as it is taken. Where one of the guard functions, which are positive while the mode lasts,
falls to zero within it, the step is rejected, and steps of other lengths follow until one ends there: by the secant
method, on steps of the solver itself and not on its interpolation, so that the state is as exact as any other. The next
step begins in the mode that follows.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..interface.status import Status
from ..numerics.bracketing import Sample, between, other_end
from ..numerics.kinks import before_kink
from ..physics.body_on_plane import Heading
from ..physics.modes import CAUSES, Cause, Mode
from ..physics.packing import Packing
from ..solvers.base import APPROACH
from ..solvers.dense.sampling import sampling
from .rows import put

NONE = -1  # no cause
WINDOW = -2  # no cause either: the end of the time for which the direction of a slip was known beforehand
NEAR = 1e-10  # of the length of a step: where it ends so close to the end of a mode, one step of Newton's is exact
TOGETHER = 1e-6  # of the length of a step: what ends a mode at nearly the same time as something else
MOST_TRIES = 40
LEAST = 8  # the length of a step, in units of rounding of the time
ROOT_STEPS = 8  # of the Illinois method, to the zero of a quartic
POWERS = sampling().powers.tolist()
REAL = 1e-6  # a value not below this part of its size in a step is not a zero
NOTHING = 1e-9  # a normal force below this part of its size in a step counts as zero
GRAZING = 1e-6  # a function that falls by less than this part of its size in a step touches zero
CLOSE = 1e-9  # switches closer to each other than this part of a run are counted as crowded
TOO_MANY = 64  # crowded switches
NEARLY = 3  # times the least speed of a slip: one that is slower than that may end in the next step
SAME = 1e-9  # of a speed: what rounding may change
PAST = 0.5  # of the least speed: a step is to end no slower than that
TRUNCATED = 2e5  # tolerances: the most of a step's error beside the speed of a slip that ends, for its derivatives


class Aim(NamedTuple):
    """The end of a mode that steps are to meet, at ``target``: function ``which`` is zero between ``low`` and ``high``.

    ``x``, ``f`` and ``slope`` are those of the function where it was last seen, and ``size`` its size in the step.
    """

    on: Bool[Array, "*lanes"]
    which: Int[Array, "*lanes"]
    low: Float[Array, "*lanes"]
    high: Float[Array, "*lanes"]
    target: Float[Array, "*lanes"]
    x: Float[Array, "*lanes"]
    f: Float[Array, "*lanes"]
    slope: Float[Array, "*lanes"]
    size: Float[Array, "*lanes"]
    tries: Int[Array, "*lanes"]

    @classmethod
    def none(cls, t: Float[Array, "*lanes"]) -> "Aim":
        """No aim."""
        no, first, zero = jnp.zeros_like(t, bool), jnp.zeros_like(t, int), jnp.zeros_like(t)
        return cls(no, first, t, t, t, t, zero, zero, zero, first)

    def nearer(self, x: Float[Array, "*lanes"], f: Float[Array, "*lanes"]) -> "Aim":
        """The aim after a step to ``x`` that found ``f`` there; halfway where a secant leads outside."""
        low, high = jnp.where(f > 0, x, self.low), jnp.where(f > 0, self.high, x)
        again = (self.tries > 0) & (x != self.x)
        slope = jnp.where(again, (f - self.f) / jnp.where(again, x - self.x, 1.0), self.slope)
        target = x - f / jnp.where(slope == 0, 1.0, slope)
        inside = (target >= low) & (target <= high) & (slope != 0)
        target = jnp.where(inside, target, 0.5 * (low + high))
        return self._replace(low=low, high=high, target=target, x=x, f=f, slope=slope, tries=self.tries + 1)


class Kept(NamedTuple):
    """The kept switches: the first ones, as many as there is room for, in the order of time; or a single one."""

    times: Float[Array, "*room"]
    causes: Int[Array, "*room"]
    before: Float[Array, "*room size"]
    after: Float[Array, "*room size"]
    grazing: Bool[Array, "*room"]

    @classmethod
    def empty(cls, room: int, y: Float[Array, " size"]) -> "Kept":
        """Room for so many of them."""
        rows = jnp.zeros((room, y.size), y.dtype)
        times, grazing = jnp.full(room, jnp.nan, y.dtype), jnp.zeros(room, bool)
        return cls(times, jnp.zeros(room, int), rows, rows, grazing)

    def having(self, place: Int[Array, ""], switch: "Kept") -> "Kept":
        """The kept switches with one more, if there is room."""
        there = place < self.times.shape[0]
        return Kept(*(put(kept, place, new, there) for kept, new in zip(self, switch, strict=True)))


class Course(NamedTuple):
    """The state that a solve carries from mode to mode.

    - ``pending``: the :class:`Cause` with which a mode has just ended, ``WINDOW``, or ``NONE``.
    - ``length``: of the longest step that no end of a mode cut short, with which what follows a slip begins.
    - ``guards``: the functions that say that the mode lasts, as the step begins; None where each step looks.
    - ``begun``: the vector with which the first mode began.
    - ``switches``: how many there have been.
    - ``crowd``: how many in a row were too near to each other, ``last`` the time of the last.
    - ``status``: not ``SUCCESS`` where no mode can follow.
    - ``kept``: what is kept of the switches; None where that is elsewhere.
    """

    aim: Aim
    pending: Int[Array, "*lanes"]
    length: Float[Array, "*lanes"]
    guards: Float[Array, "3 *lanes"] | None
    begun: Float[Array, "size *lanes"]
    switches: Int[Array, "*lanes"]
    crowd: Int[Array, "*lanes"]
    last: Float[Array, "*lanes"]
    status: Int[Array, "*lanes"]
    kept: Kept | None

    @classmethod
    def start(
        cls, t0: Float[Array, "*lanes"], y0: Float[Array, "size *lanes"], length: Float[Array, "*lanes"]
    ) -> "Course":
        """The course of a solve before its first step, of ``length``."""
        none, success = jnp.asarray(0), jnp.asarray(int(Status.SUCCESS))
        return cls(Aim.none(t0), jnp.asarray(int(Cause.START)), length, None, y0, none, none, t0, success, None)


class Ended(NamedTuple):
    """A step's end, if its mode lasts: the mode, whether a window ends, whether a slip may be at its end, the ``least``
    speed of a heading, and the guards of a ``Course``.
    """

    mode: Float[Array, "*lanes"]
    window: Bool[Array, "*lanes"]
    slow: Bool[Array, "*lanes"]
    least: Float[Array, "*lanes"]
    guards: Float[Array, "3 *lanes"]


class Judged(NamedTuple):
    """The fate of a step that the controller would accept: it is kept, or ``retried`` with an end at ``target``.

    ``longest`` is the longest next step.
    """

    retried: Bool[Array, "*lanes"]
    target: Float[Array, "*lanes"]
    longest: Float[Array, "*lanes"]
    course: Course


class Settled(NamedTuple):
    """Where the next step begins, and the ``end`` that it has at the earliest."""

    t: Float[Array, ""]
    y: Float[Array, " size"]
    end: Float[Array, ""]
    course: Course


class Followed(NamedTuple):
    """The same after a switch, with what is to be kept of it at which ``place``."""

    settled: Settled
    place: Int[Array, ""]
    switch: Kept


class Switching(eqx.Module):
    """The modes of the system of a solve; ``unpack`` takes its parameters apart, the first of which is a packing.

    ``room`` is how many switches are kept, ``rtol``, ``atol`` are the tolerances of the solve, and ``order`` is that of
    the errors that its method sees. A step takes at most the part ``approach`` of the time until a slip ends.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    unpack: Any = eqx.field(static=True)
    room: int = eqx.field(static=True)
    order: float = eqx.field(static=True)
    approach: float = eqx.field(static=True, default=APPROACH)

    def begin(self, t0: Float[Array, ""], y0: Float[Array, " size"], length: Float[Array, ""]) -> Course:
        """The course of a solve before its first step."""
        return Course.start(t0, y0, length)._replace(kept=Kept.empty(self.room, y0))

    def latest_end(self, t: Float[Array, ""], y: Float[Array, " size"], parameters: Any) -> Float[Array, ""]:
        """The time after ``t`` at which a step must end because a window does."""
        state = self._packing(parameters).unravel(y)
        ends = state.is_in(Mode.SLIDING) & (state.begun.until > t)
        return jnp.where(ends, state.begun.until, jnp.inf)

    def settled(
        self, course: Course, t: Float[Array, ""], y: Float[Array, " size"], run: Float[Array, ""], parameters: Any
    ) -> Settled:
        """What follows a mode that has ended at ``t``, in a run of the length ``run``; before a step."""

        def follow(course: Course) -> Followed:
            return self.followed(course, t, y, run, parameters)

        def pass_by(course: Course) -> Followed:
            nothing = Kept(t, course.pending, y, y, jnp.asarray(False))
            return Followed(Settled(t, y, t, course), jnp.asarray(self.room), nothing)

        kept, course = course.kept, course._replace(kept=None)
        settled, place, switch = jax.lax.cond(course.pending == NONE, pass_by, follow, course)
        kept = None if kept is None else kept.having(place, switch)
        return settled._replace(course=settled.course._replace(kept=kept))

    def judged(
        self,
        course: Course,
        start: Float[Array, ""],
        end: Float[Array, ""],
        y: Float[Array, " size"],
        interpolation: Any,
        kept: Bool[Array, ""],
        parameters: Any,
    ) -> Judged:
        """Checks a step from ``start`` to ``end``, which led to ``y``."""

        def look(course: Course) -> Judged:
            fixed = jax.lax.stop_gradient((start, end))
            times = sampling().times(*fixed, sampling().nodes)
            inner, constants = jax.lax.stop_gradient((jax.vmap(interpolation.evaluate)(times[:-1]), parameters))
            heading = self.heading(fixed[0], inner[0], constants)
            guards = jax.lax.map(lambda at: self.guards(at[0], at[1], heading, constants), (times[:-1], inner))
            ended = self.ended(fixed[1], jax.lax.stop_gradient(y), heading, constants)
            return looked(course, *fixed, guards.T, ended, self.share())

        def pass_by(course: Course) -> Judged:
            return passed_by(course, end)

        judged = jax.lax.cond(kept, look, pass_by, course._replace(kept=None))
        return judged._replace(course=judged.course._replace(kept=course.kept))

    def share(self) -> Float[Array, ""]:
        """The longest step of a slip that ends, over the time until its end."""
        return share(self.order, self._tolerance(), self.approach)

    def _tolerance(self) -> Float[Array, ""]:
        return jnp.maximum(self.rtol, self.atol)

    def _packing(self, parameters: Any) -> Packing:
        return self.unpack(parameters)[0]

    def heading(self, t: Float[Array, ""], y: Float[Array, " size"], parameters: Any) -> Heading:
        """The heading of a slip as a step begins."""
        packing = self._packing(parameters)
        return packing.system.heading(t, packing.unpack(t, y), self.rtol, self.atol)

    def guards(self, t: Float[Array, ""], y: Float[Array, " size"], heading: Heading, parameters: Any) -> Array:
        """The three functions that are positive while the mode lasts."""
        packing = self._packing(parameters)
        return packing.system.guards(t, packing.unpack(t, y), heading)

    def ended(self, t: Float[Array, ""], y: Float[Array, " size"], heading: Heading, parameters: Any) -> Ended:
        """The end of a step."""
        packing = self._packing(parameters)
        system, state = packing.system, packing.unpack(t, y)
        slow = system.is_slow(t, state, heading, self.rtol, self.atol)
        window = state.is_in(Mode.SLIDING) & (state.begun.until == t)
        return Ended(state.mode, window, slow, heading.least, system.guards(t, state, heading))

    def followed(
        self, course: Course, t: Float[Array, ""], y: Float[Array, " size"], run: Float[Array, ""], parameters: Any
    ) -> Followed:
        """The state that follows the mode that has ended."""
        packing, cause = self._packing(parameters), course.pending
        system, starts = packing.system, cause == int(Cause.START)
        kinks = jax.lax.stop_gradient(system.driving_kinks())

        state = packing.unpack(t, y)
        heading = jax.lax.stop_gradient(system.heading(t, state, self.rtol, self.atol))
        heading = heading._replace(least=heading.speed)
        rates = jax.lax.stop_gradient(system.field(t, state))
        values, slopes = jax.jvp(
            lambda t, state: system.guards(t, state, heading), (t, state), (jnp.ones_like(t), rates)
        )
        which = jnp.argmax(jnp.asarray(CAUSES)[state.mode.astype(int)] == cause)
        slope = jax.lax.stop_gradient(slopes[which])
        sloping = (cause > int(Cause.START)) & (slope != 0)
        # By this the time moves by next to nothing, and gets its derivatives: those of the zero of the function.
        shift = jnp.where(sloping, -values[which] / jnp.where(sloping, slope, 1.0), 0.0)
        t, before = t + shift, jax.tree.map(lambda x, rate: x + shift * rate, state, rates)
        t, before, state, ends, lands = system.followed(t, before, cause, kinks, self._tolerance())
        after, switches = packing.pack(t, state), jnp.where(starts, lands, ends & (cause != WINDOW))
        fixed = jax.lax.stop_gradient(t)
        crowded = switches & (cause != int(Cause.LANDS)) & (fixed - course.last <= CLOSE * run)
        crowd = jnp.where(crowded, course.crowd + 1, jnp.where(switches, 0, course.crowd))
        status = jnp.where(crowd > TOO_MANY, int(Status.CHATTERED), course.status)
        status = jnp.where(cause == int(Cause.JAMS), int(Status.JAMMED), status)
        place = jnp.where(switches, course.switches, self.room)
        course = course._replace(
            pending=jnp.asarray(NONE),
            begun=jnp.where(starts, after, course.begun),
            switches=course.switches + jnp.where(switches, 1, 0),
            crowd=crowd,
            last=jnp.where(switches, fixed, course.last),
            status=status,
            kept=None,
        )
        grazing = (cause > int(Cause.START)) & (jnp.abs(slope) * course.length <= GRAZING * course.aim.size)
        kind = jnp.where(starts, int(Cause.LANDS), cause)
        switch = Kept(t, kind, packing.pack(t, before), after, grazing)
        # A slip has ended in ever shorter steps, whose length is no guide for what follows.
        least = LEAST * float(jnp.finfo(fixed.dtype).eps) * jnp.abs(fixed)
        length = jnp.where((cause == int(Cause.STOPS)) & ends, course.length, least)
        return Followed(Settled(t, after, before_kink(kinks, fixed, fixed + length), course), place, switch)


def looked(
    course: Course,
    start: Float[Array, "*lanes"],
    end: Float[Array, "*lanes"],
    before: Float[Array, "3 inner *lanes"],
    ended: Ended,
    share: Float[Array, "*lanes"],
) -> Judged:
    """The fate of a step, or of one in each lane, from the guards ``before`` its end, at nodes, and at its end."""
    aim, guards = course.aim, jnp.concatenate([before, ended.guards[:, None]], axis=1)
    at_aim = aim.on & (end == aim.target)
    first = _first_end(start, end, guards, jnp.where(at_aim, aim.which, NONE))
    # Two functions may fall to zero together; then either will do.
    earlier = ~at_aim | (first.target < end - TOGETHER * (end - start))
    # The quartics may have spurious zeros, and then, in a shorter step, others.
    tries = jnp.where(at_aim, aim.tries + 1, 0)
    first = first._replace(on=first.on & earlier & (tries < MOST_TRIES), tries=tries)
    value = _entry(aim.which, guards[:, -1])
    nearer = aim.nearer(end, value)
    width = jnp.maximum(NEAR * (end - start), 4 * float(jnp.finfo(end.dtype).eps) * jnp.abs(end))
    met = (jnp.abs(nearer.target - end) <= width) | (value == 0) | (aim.tries >= MOST_TRIES)
    retried = first.on | at_aim & ~met
    next_aim = _where(retried, _where(first.on, first, nearer), Aim.none(end))
    cause = _cause(ended.mode, aim.which)
    # Where friction gives way because the normal force vanishes, the body lifts off.
    lifts = (cause == int(Cause.GIVES_WAY)) & (guards[1, -1] <= NOTHING * jnp.max(jnp.abs(guards[1]), axis=0))
    cause = jnp.where(lifts, int(Cause.LIFTS), cause)
    real = jnp.where(cause == int(Cause.STOPS), ended.slow, jnp.abs(value) <= REAL * aim.size)
    switches = at_aim & ~retried & real
    lasts = ~(retried | switches)
    ends = jnp.where(ended.window, WINDOW, jnp.where(_nears_its_end(ended, guards[0]), int(Cause.STOPS), NONE))
    course = course._replace(
        aim=next_aim,
        pending=jnp.where(switches, cause, jnp.where(lasts, ends, NONE)),
        length=jnp.where(retried | at_aim, course.length, jnp.maximum(course.length, end - start)),
        guards=None if course.guards is None else jnp.where(lasts[None], ended.guards, course.guards),
    )
    longest = jnp.where(lasts, _longest(ended, start, end, guards[0], share), jnp.inf)
    return Judged(retried, next_aim.target, longest, course)


def passed_by(course: Course, end: Float[Array, "*lanes"]) -> Judged:
    """A step that is not kept anyway."""
    return Judged(jnp.zeros_like(end, bool), end, jnp.full_like(end, jnp.inf), course._replace(aim=Aim.none(end)))


def share(order: float, tolerance: Float[Array, "*lanes"], approach: float = APPROACH) -> Float[Array, "*lanes"]:
    """The longest step of a slip that ends, over the time until its end, where the direction turns ever faster."""
    return jnp.minimum((TRUNCATED * tolerance) ** (1 / (order + 1)), approach)


def _nears_its_end(ended: Ended, forward: Float[Array, "nodes *lanes"]) -> Bool[Array, "*lanes"]:
    """Whether a step has slowed down a slip that was slow when it began, so that its end may have come.

    Where friction is hardly needed to hold the body, the direction of a slow slip returns to that in which it ends much
    faster than the slip slows down. Steps are then too short to halve its speed, and would never meet a zero of the
    guard.
    """
    before, after = forward[0] + ended.least, forward[-1] + ended.least
    was_slow = before <= (2 + SAME) * ended.least
    return (ended.mode == int(Mode.SLIDING)) & ended.slow & was_slow & (after < before)


def _longest(
    ended: Ended,
    start: Float[Array, "*lanes"],
    end: Float[Array, "*lanes"],
    forward: Float[Array, "nodes *lanes"],
    share: Float[Array, "*lanes"],
) -> Float[Array, "*lanes"]:
    """The longest next step: infinite, except where a slip slows down.

    It is a fraction of the time until the end of the slip, and goes beyond the least speed at most half way to the end,
    because the stages of a step across the end pull in both directions, which a low-order method may not notice as an
    error.
    """
    before, after = forward[0] + ended.least, forward[-1] + ended.least
    slows = (ended.mode == int(Mode.SLIDING)) & (after > 0) & (before > after)
    until_end = after * (end - start) / jnp.where(slows, before - after, 1.0)
    safe = 1 - PAST * ended.least / jnp.where(slows, after, 1.0)
    longest = until_end * jnp.where(after > NEARLY * ended.least, jnp.minimum(share, safe), safe)
    return jnp.where(slows & (longest > 0), longest, jnp.inf)


def _first_end(
    start: Float[Array, "*lanes"],
    end: Float[Array, "*lanes"],
    seen: Float[Array, "3 nodes *lanes"],
    but: Int[Array, "*lanes"],
) -> Aim:
    """The first place in a step where a function is not positive, ``but`` for one; before the start all were.

    Functions are evaluated at a few nodes, and the quartics through these values at 35 points. Everything is written
    with whole arrays without argmax, which XLA's CPU compiler turns into slow loops.
    """
    at, ones = sampling(), (1,) * start.ndim
    last = at.fractions.size - 1
    fractions = jnp.asarray(at.fractions, seen.dtype).reshape(-1, *ones)
    index = jnp.arange(last + 1).reshape(-1, *ones)
    columns = jnp.asarray(at.matrix, seen.dtype).T.reshape(at.nodes.size, 1, -1, *ones)
    fine = sum(column * values[:, None] for column, values in zip(columns, jnp.moveaxis(seen, 1, 0), strict=True))
    other = jnp.arange(3).reshape(-1, *ones) != but[None]
    over = (fine <= 0) & other[:, None] & (index > 0)[None]
    places = jnp.min(jnp.where(over, index[None], last + 1), axis=1)
    place = jnp.min(places, axis=0)
    which = jnp.where(places[0] == place, 0, jnp.where(places[1] == place, 1, 2))
    samples = _entry(which[None], seen)

    def fraction(k: Int[Array, "*lanes"]) -> Float[Array, "*lanes"]:
        return jnp.sum(jnp.where(index == jnp.clip(k, 0, last)[None], fractions, 0.0), axis=0)

    low, high = fraction(place - 2), fraction(place + 1)
    root, slope = _root(samples, fraction(place - 1), fraction(place))
    # A step has some length, even if a function was below zero by rounding at its start.
    length = end - start
    least = start + LEAST * float(jnp.finfo(end.dtype).eps) * jnp.maximum(jnp.abs(start), jnp.abs(end))
    return Aim(
        on=place <= last,
        which=which,
        low=start + low * length,
        high=jnp.minimum(start + high * length, end),
        target=jnp.minimum(jnp.maximum(start + root * length, least), end),
        x=start,
        f=jnp.zeros_like(end),
        slope=slope / length,
        size=jnp.max(jnp.abs(samples), axis=0),
        tries=jnp.zeros_like(which),
    )


def _root(
    samples: Float[Array, "nodes *lanes"], low: Float[Array, "*lanes"], high: Float[Array, "*lanes"]
) -> tuple[Float[Array, "*lanes"], Float[Array, "*lanes"]]:
    """Where the quartic through the samples falls to zero between two fractions of a step, and its slope there."""
    a0, a1, a2, a3, a4 = (sum(power * sample for power, sample in zip(row, samples, strict=True)) for row in POWERS)

    def at(u: Float[Array, "*lanes"]) -> Sample:
        return Sample(u, a0 + u * (a1 + u * (a2 + u * (a3 + u * a4))))

    def narrowed(_, bracket: tuple[Sample, Sample]) -> tuple[Sample, Sample]:
        newest = at(between(*bracket))
        return other_end(*bracket, newest), newest

    u = jax.lax.fori_loop(0, ROOT_STEPS, narrowed, (at(low), at(high)))[1].x
    return u, a1 + u * (2 * a2 + u * (3 * a3 + u * 4 * a4))


def _entry(which: Int[Array, "*#lanes"], rows: Float[Array, "3 *lanes"]) -> Float[Array, "*lanes"]:
    return jnp.where(which == 0, rows[0], jnp.where(which == 1, rows[1], rows[2]))


def _cause(mode: Float[Array, "*lanes"], which: Int[Array, "*lanes"]) -> Int[Array, "*lanes"]:
    """The cause that a guard of a mode stands for."""
    cause = jnp.full_like(which, int(Cause.START))
    for of_mode, causes in enumerate(CAUSES):
        for k, one in enumerate(causes):
            cause = jnp.where((mode == of_mode) & (which == k), int(one), cause)
    return cause


def _where(condition: Bool[Array, "*lanes"], first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
