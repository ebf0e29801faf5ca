"""Looks for events in each step of a solve, ends the run at those that end it, and gathers when they happened.

``simulate`` makes a ``Watch`` for a run with events, and ``loop`` asks it in each step.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.calculus import move, move_to_zero, rates_along, with_derivatives, with_second_derivatives
from ..numerics.pieces import Span
from ..physics.packing import Packing
from ..programs.derivatives.differentiation import keep_if_known, keep_known_rows, without_derivatives
from ..programs.derivatives.reverse_rules import put_while
from .events import AbstractEvent, Occurrences
from .solvers.dense.crossings import Glance, Kinds, Log, glance, scan
from .solvers.dense.steps import last_within

Functions = Callable[[Float[Array, " n"], Float[Array, "n size"], Any], Float[Array, "n k"]]
Index = Int[Array, ""]
Field = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, " size"]]


class Watched(NamedTuple):
    """What a solve carries from step to step: the log of crossings, and the time and the state of each as one row.

    The rows have derivatives, which the log has not; those that are not used are NaN.
    """

    log: Log
    rows: Float[Array, "capacity width"]

    @property
    def buffers(self) -> Any:
        """What a step writes rows of, and reads none but those."""
        return self.log.times, self.log.places, self.rows


class Watch:
    """Looks for events in each step of a run.

    - ``functions``: from times, vectors and the parameters of the solve to the values of the events' functions.
    - ``field``: the rate of the vector, as the solve has it; ``state``: the state of a vector, as one array.
    """

    def __init__(self, events: Mapping[str, AbstractEvent], functions: Functions, field: Field, state: Field):
        self._functions, self._field, self._state = functions, field, state
        self._kinds = _kinds(events)

    def begin(self, t0: Float[Array, ""], x: Float[Array, " size"], parameters: Any) -> Watched:
        """Returns what is carried before the first step, from ``x`` at ``t0``."""
        width = 1 + jax.eval_shape(self._state, t0, x, parameters).size
        rows = jnp.full((self._kinds.capacity, width), jnp.nan, x.dtype)
        return Watched(Log.empty(self._kinds, jax.lax.stop_gradient(t0)), rows)

    def glance(self, watched: Watched, step: "Within", parameters: Any) -> Glance:
        """Looks by a sketch of a step whether it may hold an event."""
        return glance(*self._without_derivatives(step, parameters), watched.log)

    def record(
        self, watched: Watched, seen: Glance, step: "Within", parameters: Any, kept: Bool[Array, ""], *, reverse: bool
    ) -> Watched:
        """Records the events of a step that is known as accurately as possible, if it was ``kept``.

        ``reverse``: as for :func:`put_while`.
        """
        functions, span = self._without_derivatives(step, parameters)
        log = scan(functions, span, seen, self._kinds, watched.log, kept & ~seen.quiet)
        log = log._replace(piece=jnp.where(kept & seen.quiet, seen.piece, log.piece))
        # Extremes of the step in which the run ends may lie beyond its end, which the log has: its start alone counts.
        least, largest = (jnp.where(log.ended, seen.first, value) for value in (seen.least, seen.largest))
        log = log._replace(
            least=jnp.where(kept, jnp.fmin(log.least, least), log.least),
            largest=jnp.where(kept, jnp.fmax(log.largest, largest), log.largest),
        )

        def row_of(k: Int[Array, ""]) -> Float[Array, " width"]:
            which, t = self._kinds.which(log.places[k]), jax.lax.stop_gradient(log.times[k])
            x = step.vectors(t[None])[0]
            row = jax.lax.stop_gradient(jnp.concatenate([t[None], self._state(t, x, parameters)]))
            operands = which, t, step, parameters
            row = with_derivatives(row, self._row, *operands)
            return with_second_derivatives(row, "times and states of events", self._row, *operands, 2)

        rows, _ = put_while(
            lambda k: k < log.filled,
            row_of,
            watched.rows,
            watched.log.filled,
            reverse=reverse,
            place_of=lambda k: log.places[k],
        )
        return Watched(log, rows)

    @property
    def may_end_run(self) -> bool:
        """Whether any of the events ends it."""
        return any(self._kinds.terminal)

    def end(self, before: Watched, watched: Watched, step: "Within", parameters: Any) -> Float[Array, ""]:
        """Returns when a step ends, with derivatives: at the first event in it that ends the run, if there is one.

        ``before`` and ``watched`` are what is carried before and after the step.
        """
        log, kinds = watched.log, self._kinds

        def earlier(k: Index, first: tuple[Array, Array]) -> tuple[Array, Array]:
            time, which = log.times[k], kinds.which(log.places[k])
            comes = jnp.asarray(kinds.terminal)[which] & (time < first[0])
            return jnp.where(comes, time, first[0]), jnp.where(comes, which, first[1])

        none = jnp.full_like(log.times[0], jnp.inf), jnp.asarray(0)
        time, which = jax.lax.stop_gradient(jax.lax.fori_loop(before.log.filled, log.filled, earlier, none))
        ends = jnp.isfinite(time)
        t = jnp.where(ends, time, jax.lax.stop_gradient(step.start))
        exact = with_derivatives(t, lambda *arguments: self._row(*arguments)[0], which, t, step, parameters)
        return jnp.where(ends, exact, step.end)

    def _without_derivatives(self, step: "Within", parameters: Any) -> tuple[Callable[[Array], Array], Span]:
        """Returns the functions of times within a step, and its times."""
        step, parameters = without_derivatives((step, parameters))

        def functions(times: Float[Array, " n"]) -> Float[Array, "n k"]:
            # What a function has in its closure has derivatives still.
            return without_derivatives(self._functions(times, step.vectors(times), parameters))

        return functions, Span(step.start, last_within(step.start, step.end), step.run)

    def _row(
        self, which: Int[Array, ""], t: Float[Array, ""], step: "Within", parameters: Any, order: int = 1
    ) -> Float[Array, " width"]:
        """Computes the time of a crossing and the state there, with derivatives up to an ``order`` of 1 or 2: those of
        the zero by the implicit function theorem, and where the function jumps as a step begins, those of the start of
        the step.
        """
        jumps = t <= jax.lax.stop_gradient(step.start)
        t = jnp.where(jumps, step.start, t)
        x = step.vectors(t[None])[0]

        def field(t: Array, x: Array) -> Array:
            return self._field(t, x, parameters)

        def value(t: Array, x: Array) -> Array:
            return self._functions(t[None], x[None], parameters)[0, which]

        rate = jax.lax.stop_gradient(field(t, x))
        level, slope = rates_along(value, t, x, rate)
        slope = jnp.where(jumps, 0.0, jax.lax.stop_gradient(slope))
        if order == 1:
            change = jnp.where(slope == 0, 0.0, -level / jnp.where(slope == 0, 1.0, slope))
            t, x = move(t, x, rate, change)
        else:
            t, x = move_to_zero(field, value, t, x, slope, jnp.zeros_like(t))
        return jnp.concatenate([t[None], self._state(t, x, parameters)])


class Within(NamedTuple):
    """A step from ``start`` to ``end``, the vectors at times within it, and the times between which the run is."""

    start: Float[Array, ""]
    end: Float[Array, ""]
    vectors: Callable[[Float[Array, " n"]], Float[Array, "n size"]]
    run: tuple[Float[Array, ""], Float[Array, ""]]


def _kinds(events: Mapping[str, AbstractEvent]) -> Kinds:
    each = list(events.values())
    return Kinds(
        tuple(event.direction for event in each),
        tuple(event.from_start for event in each),
        tuple(event.terminal for event in each),
        tuple(event.capacity for event in each),
    )


def values_of(
    packing: Packing[Any, Any], events: Mapping[str, AbstractEvent], t: Float[Array, ""], x: Float[Array, " size"]
) -> Float[Array, " k"]:
    """Evaluates the functions of all events at a vector."""
    state = packing.unpack(t, x)
    return jnp.stack([event.value_in_solve(packing.system, t, state) for event in events.values()])


def occurrences_of(
    watched: Watched,
    events: Mapping[str, AbstractEvent],
    unravel: Callable[[Float[Array, " size"]], Any],
    started: Bool[Array, ""],
) -> dict[str, Occurrences]:
    """Gathers the occurrences of each event, of a run that has ``started``; ``unravel`` makes a state of an array."""
    log, rows = watched.log, watched.rows
    occurrences = {}
    for k, ((name, event), part) in enumerate(zip(events.items(), _kinds(events).parts, strict=True)):
        mask = (jnp.arange(event.capacity) < log.total[k]) & started
        event_rows = rows[part]
        occurrences[name] = Occurrences(
            count=jnp.where(started, log.total[k], 0),
            times=keep_if_known(mask, event_rows[:, 0]),
            state=jax.tree.map(functools.partial(keep_known_rows, mask), jax.vmap(unravel)(event_rows[:, 1:])),
            least=log.least[k],
            largest=log.largest[k],
            unresolved=log.unresolved[k],
        )
    return occurrences


def end_by_events(
    occurrences: Mapping[str, Occurrences],
    events: Mapping[str, AbstractEvent],
    reached: Float[Array, ""],
    status: Int[Array, ""],
) -> tuple[Float[Array, ""], Int[Array, ""]]:
    """Tells when a run ended, and its status, in view of its events: at the first of all that end it."""
    # Of events at the same time, the first by name gives its status: a program has dictionaries in that order.
    first = jnp.full_like(reached, jnp.inf)
    for name, event in events.items():
        if event.terminal:
            time = jnp.where(occurrences[name].count > 0, occurrences[name].times[0], jnp.inf)
            status = jnp.where(time < first, int(event.status), status)
            first = jnp.where(time < first, time, first)
    # Not a minimum, whose derivative would take in that of the other.
    return jnp.where(jnp.isfinite(first), first, reached), status
