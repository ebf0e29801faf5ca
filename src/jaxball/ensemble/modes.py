"""Lanes that switch between modes: where their steps end, and how they continue.

The rules are those of ``simulation.switching``. Guard functions are evaluated in every step of every lane. The
transition to the next mode is a long program that few lanes need at a time: it is computed for one after the other,
which takes as long as for several at once, and compiles in a third less time.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..interface.status import Status
from ..numerics.pieces import separately
from ..physics.body_on_plane import Heading
from ..physics.modes import Mode
from ..physics.packing import Packing
from ..simulation.switching import NONE, Course, Ended, Judged, Kept, Switching, looked, passed_by, share
from ..solvers.dense.sampling import sampling
from .control import Limits, Verdict
from .parameters import Prepared
from .runge_kutta import Between, Step

FIRST = 3  # of a record: time, cause, whether it grazes; then the vectors before and after


class Given(NamedTuple):
    """What the programs of a lane are given, and the limits of its steps; the lanes are the last axis."""

    heading: Any
    guards: Any
    ended: Any
    t0: Float[Array, " lanes"]
    t1: Float[Array, " lanes"]
    limits: Limits


class Lanes(NamedTuple):
    """The variables of lanes that change at a switch of modes."""

    row: Int[Array, " lanes"]
    running: Bool[Array, " lanes"]
    start: Float[Array, " lanes"]
    end: Float[Array, " lanes"]
    x: Float[Array, "size lanes"]
    fresh: Bool[Array, " lanes"]
    course: Course


class Modes(NamedTuple):
    """The modes of the systems of rows.

    - ``heading``, ``guards``, ``ended``: the methods of ``Switching``, in lanes.
    - ``packing``: of each row, with the rows as leading axis; of all of them where ``shared``.
    - ``room``: for switches of each row.
    - ``order``: that of the errors that the method sees.
    """

    heading: Prepared
    guards: Prepared
    ended: Prepared
    between: Between
    packing: Packing
    shared: bool
    room: int
    order: Any

    @classmethod
    def of(
        cls,
        prepared: Callable[..., Prepared],
        between: Between,
        packing: Packing,
        shared: bool,
        order: Any,
    ) -> "Modes":
        """``prepared`` takes a function of (system, t, vector) and numbers to its program for all rows."""
        room, unravel = packing.system.contact.room, packing.unravel

        def heading(system, t, x, rtol, atol):
            return _switching(rtol, atol, room, order).heading(t, x, Packing(system.prepare(), unravel)).as_numbers()

        def guards(system, t, x, *heading):
            along = Heading.of_numbers(jnp.stack(heading))
            return _switching(t, t, room, order).guards(t, x, along, Packing(system.prepare(), unravel))

        def ended(system, t, x, rtol, atol, *heading):
            along = Heading.of_numbers(jnp.stack(heading))
            end = _switching(rtol, atol, room, order).ended(t, x, along, Packing(system.prepare(), unravel))
            return end._replace(window=end.window.astype(x.dtype), slow=end.slow.astype(x.dtype))

        programs = prepared(heading, 2), prepared(guards, 4), prepared(ended, 6)
        return cls(*programs, between, packing, shared, room, order)

    def record(self, rows: int, size: int, dtype: Any) -> Float[Array, "rows room numbers"]:
        """Room for the switches of all rows: NaN, before there are any."""
        return jnp.full((rows, self.room, FIRST + 2 * size), jnp.nan, dtype)

    def begin(self, t0: Float[Array, " lanes"], x: Float[Array, "size lanes"], end: Float[Array, " lanes"]) -> Course:
        """The courses of lanes before their first step."""
        course = jax.vmap(Course.start, in_axes=-1, out_axes=-1)(t0, x, end - t0)
        return course._replace(guards=jnp.ones((3, *t0.shape), t0.dtype))

    def latest_end(self, t: Float[Array, " lanes"], x: Float[Array, "size lanes"]) -> Float[Array, " lanes"]:
        """The time at which a step must end because the direction of a slip is prescribed until then."""

        def end(t: Array, y: Array) -> Array:
            return _switching(t, t, self.room, self.order).latest_end(t, y, self.packing)

        return jax.vmap(end, in_axes=-1)(t, x)

    def judged(
        self, course: Course, given: Given, step: Step, fresh: Bool[Array, " lanes"], verdict: Verdict, memory: Any
    ) -> tuple[Verdict, Course]:
        """The fate of a step after the controller's verdict: the new verdict, and the courses.

        ``memory`` is what the controller remembered before. Steps are ``fresh`` that begin with another field than the
        last one ended with.
        """
        start, end, limits = jax.lax.stop_gradient((step.start, step.end, given.limits))
        heading = self.heading(given.heading, *jax.lax.stop_gradient((step.start, step.x)), limits.rtol, limits.atol)
        before = self._before_end(course, given, step, heading, fresh)
        course = course._replace(guards=before[:, 0])
        y = jax.lax.stop_gradient(step.y)
        at_end = self.ended(given.ended, end, y, limits.rtol, limits.atol, heading)
        longest = share(float(self.order), jnp.maximum(limits.rtol, limits.atol))
        judged = _judged(course, start, end, before, at_end, longest, verdict.kept)
        retried, kept = judged.retried, verdict.kept & ~judged.retried
        following = jnp.minimum(verdict.end, verdict.start + judged.longest)
        verdict = verdict._replace(
            kept=kept,
            start=jnp.where(retried, step.start, verdict.start),
            end=jnp.where(retried, judged.target, following),
            memory=_where(retried, memory, verdict.memory),
        )
        return verdict, judged.course

    def _before_end(
        self,
        course: Course,
        given: Given,
        step: Step,
        heading: Float[Array, "4 lanes"],
        fresh: Bool[Array, " lanes"],
    ) -> Float[Array, "3 inner lanes"]:
        """The guards at the nodes in a step before its last; at the first, only fresh lanes look for them."""
        assert course.guards is not None
        own, step, known = jax.lax.stop_gradient((given.guards, step, course.guards))
        nodes = jnp.asarray(sampling().nodes[:-1], step.x.dtype)
        # The speed of a slip is seen along the heading of each step.
        forward = Heading.of_numbers(heading).speed - Heading.of_numbers(heading).least
        slides = self._slides(step.x)
        known = known.at[0].set(jnp.where(slides, forward, known[0]))

        def one(i, samples):
            t = step.start + nodes[i] * (step.end - step.start)
            seen = self.guards(own, t, self.between(step, t), heading)
            return samples.at[i].set(jnp.where((i > 0) | fresh, seen, known))

        samples = jnp.zeros((nodes.size, 3, step.start.size), step.x.dtype).at[0].set(known)
        samples = jax.lax.fori_loop(jnp.where(jnp.any(fresh), 0, 1), nodes.size, one, samples)
        return jnp.moveaxis(samples, 0, 1)

    def _slides(self, x: Float[Array, "size lanes"]) -> Bool[Array, " lanes"]:
        unravel = self.packing.unravel
        return jax.vmap(lambda vector: unravel(vector).is_in(Mode.SLIDING), in_axes=-1)(x)

    def settled(
        self, lanes: Lanes, given: Given, record: Float[Array, "rows room numbers"]
    ) -> tuple[Lanes, Float[Array, "rows room numbers"]]:
        """Lanes in the modes that follow ended ones, and the record of these switches; one lane after the other."""
        index = jnp.arange(lanes.row.shape[0])

        def waits(lanes: Lanes) -> Bool[Array, " lanes"]:
            return lanes.running & (lanes.course.pending != NONE)

        def due(carry: tuple[Lanes, Array]) -> Bool[Array, ""]:
            return jnp.any(waits(carry[0]))

        def serve(carry: tuple[Lanes, Array]) -> tuple[Lanes, Array]:
            lanes, record = carry
            lane = jnp.min(jnp.where(waits(lanes), index, index.size - 1))
            one, t0, t1, limits = jax.tree.map(lambda leaf: leaf[..., lane], (lanes, given.t0, given.t1, given.limits))
            packing = self.packing if self.shared else jax.tree.map(lambda leaf: leaf[one.row], self.packing)
            switching = _switching(limits.rtol, limits.atol, self.room, self.order)
            done, place, kept = switching.followed(one.course, one.start, one.x, t1 - t0, packing)
            after = one._replace(
                running=(done.course.status == int(Status.SUCCESS)) & (done.t < t1),
                start=done.t,
                end=jnp.minimum(jnp.maximum(one.end, done.end), t1),
                x=done.y,
                fresh=jnp.asarray(True),
                course=done.course,
            )
            record = record.at[one.row, place].set(_as_numbers(kept), mode="drop")
            return jax.tree.map(lambda old, new: old.at[..., lane].set(new), lanes, after), record

        return jax.lax.while_loop(due, serve, (lanes, record))


def switches_of(record: Float[Array, "rows room numbers"]) -> Kept:
    """The kept switches of rows, with the rows as leading axis."""
    size = (record.shape[-1] - FIRST) // 2
    times, causes, grazing = (record[..., k] for k in range(FIRST))
    known = jnp.isfinite(times)
    before, after = record[..., FIRST : FIRST + size], record[..., FIRST + size :]
    return Kept(times, jnp.where(known, causes, 0.0).astype(int), before, after, known & (grazing != 0))


def _as_numbers(kept: Kept) -> Float[Array, " numbers"]:
    """A switch, as it is kept in a record."""
    parts = (kept.times[None], kept.causes[None], kept.grazing[None], kept.before, kept.after)
    return jnp.concatenate([part.astype(kept.before.dtype) for part in parts])


def _judged(
    course: Course,
    start: Float[Array, " lanes"],
    end: Float[Array, " lanes"],
    before: Float[Array, "3 inner lanes"],
    at_end: Float[Array, "numbers lanes"],
    longest: Float[Array, " lanes"],
    kept: Bool[Array, " lanes"],
) -> Judged:
    """The fate of the steps, some of which are rejected anyway."""
    mode, window, slow, least = at_end[:4]
    ended = Ended(mode, window != 0, slow != 0, least, at_end[4:])
    seen = looked(course, start, end, before, ended, longest)

    def choose(a: Array, b: Array) -> Array:
        return separately(jnp.where(kept.reshape((1,) * (a.ndim - 1) + (-1,)), a, b))

    return jax.tree.map(choose, seen, passed_by(course, end))


def _switching(rtol: Float[Array, ""], atol: Float[Array, ""], room: int, order: Any) -> Switching:
    """The modes of a system whose packing replaces its parameters."""
    return Switching(rtol, atol, _itself, room, float(order))


def _itself(packing: Packing) -> tuple[Packing]:
    return (packing,)


def _where(condition: Bool[Array, "*lanes"], first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
