"""Many initial-value problems of the same form, solved a few at a time in lanes that do not wait for each other.

A lane whose problem is finished takes the next. Lanes are refilled when an eighth of them is idle, because refilling
costs about as much as a stage.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..simulation.switching import NONE, Course
from ..solvers.dense.continuous import ContinuousMethod
from .control import Controller, Limits, begin, judge
from .modes import Given, Lanes as SwitchingLanes, Modes
from .observers import AbstractObserver
from .runge_kutta import step

IDLE = 8


class Rows(NamedTuple):
    """The problems, in the last axis of each array: the rows.

    - ``parameters``: the arguments of the field, besides time and state, that differ between rows.
    - ``t0``, ``t1``: start and end. A row for which they are equal costs nothing.
    - ``x``: the state at the start.
    - ``observers``: the parameters of each observer, by name.
    - ``modes``: the parameters of the programs of modes, None where there is one mode.
    """

    parameters: Float[Array, "parameters rows"]
    t0: Float[Array, " rows"]
    t1: Float[Array, " rows"]
    x: Float[Array, "size rows"]
    limits: Limits
    observers: Mapping[str, Any]
    modes: Given | None = None

    def take(self, rows: Int[Array, " lanes"]) -> "Rows":
        """Some of the rows."""
        return jax.tree.map(lambda leaf: jnp.take(leaf, rows, axis=-1, mode="clip"), self)


class Solved(NamedTuple):
    """How each row ended: its last time and state, whether the field was finite, and how many steps it took.

    ``executed`` counts the steps of all lanes, idle ones included. ``course`` and ``switches`` are None where there is
    one mode: the vector with which the first mode began, the number of switches, the status, and the record of them.
    """

    t: Float[Array, " rows"]
    x: Float[Array, "size rows"]
    finite: Bool[Array, " rows"]
    steps: Int[Array, " rows"]
    rejected: Int[Array, " rows"]
    observed: dict[str, Any]
    executed: Int[Array, ""]
    course: Any
    switches: Float[Array, "rows room numbers"] | None


class _Lanes(NamedTuple):
    """The state of the lanes, which are the last axis."""

    row: Int[Array, " lanes"]  # the number of rows where a lane is idle
    running: Bool[Array, " lanes"]
    problem: Rows | None
    start: Float[Array, " lanes"]
    end: Float[Array, " lanes"]
    x: Float[Array, "size lanes"]
    slope: Float[Array, "size lanes"]
    fresh: Bool[Array, " lanes"]  # whether the slope is yet to be computed
    memory: Any
    steps: Int[Array, " lanes"]
    rejected: Int[Array, " lanes"]
    finite: Bool[Array, " lanes"]
    observed: dict[str, Any]
    course: Course | None


Field = Callable[[Any, Float[Array, " lanes"], Float[Array, "size lanes"]], Array]


class Method(NamedTuple):
    """How rows are solved: the field, the tableau and the order of its error, the controller, the most steps, modes.

    ``within`` is what states within steps need, None where no observer asks for them.
    """

    field: Field
    tableau: diffrax.ButcherTableau
    error_order: Any
    controller: Controller
    max_steps: int
    modes: Modes | None = None
    within: ContinuousMethod | None = None


def solve_rows(method: Method, rows: Rows, lanes: int, observers: Mapping[str, AbstractObserver]) -> Solved:
    """Every row from its start to its end, ``lanes`` side by side."""
    count = rows.t0.shape[-1]
    idle = jax.eval_shape(lambda: _take(method, rows, jnp.full(lanes, count, jnp.int32), observers))
    idle = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), idle)
    idle = idle._replace(row=jnp.full(lanes, count, jnp.int32))
    unpack = _packing(_ended(idle))[1]
    results = jnp.zeros((_packing(_ended(idle))[0].shape[0], count), rows.x.dtype)
    zero = jnp.zeros((), jnp.int32)
    record = None if method.modes is None else method.modes.record(count, rows.x.shape[0], rows.x.dtype)

    def unfinished(carry):
        lanes, _, following, *_ = carry
        return jnp.any(lanes.running) | (following < count)

    def fill(carry):
        lanes, results, following, executed, record = carry
        results, free = _deliver(lanes, results), ~lanes.running
        row = jnp.where(free, jnp.minimum(following + jnp.cumsum(free, dtype=jnp.int32) - 1, count), lanes.row)
        fresh = _take(method, rows, row, observers)
        lanes = jax.tree.map(lambda old, new: jnp.where(free, new, old), lanes, fresh)
        following = jnp.minimum(following + jnp.sum(free, dtype=jnp.int32), count)
        lanes, executed, record = _advance_until_idle(method, lanes, observers, following < count, executed, record)
        return lanes, results, following, executed, record

    last, results, _, executed, record = jax.lax.while_loop(unfinished, fill, (idle, results, zero, zero, record))
    t, x, finite, steps, rejected, observed, course = unpack(_deliver(last, results))
    return Solved(t, x, finite, steps, rejected, observed, executed, course, record)


def _ended(lanes: _Lanes) -> tuple:
    """What is kept of a lane."""
    course = None if lanes.course is None else (lanes.course.begun, lanes.course.switches, lanes.course.status)
    return lanes.start, lanes.x, lanes.finite, lanes.steps, lanes.rejected, lanes.observed, course


def _packing(tree: Any) -> tuple[Float[Array, "numbers lanes"], Callable[[Array], Any]]:
    """A PyTree of arrays whose last axis is that of the lanes as one matrix, and the way back.

    XLA's CPU compiler in jaxlib 0.10 fails at a loop that scatters arrays of several shapes.
    """
    leaves, structure = jax.tree.flatten(tree)
    parts = [leaf.reshape(-1, leaf.shape[-1]) for leaf in leaves]
    dtype = jnp.result_type(*(leaf.dtype for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.floating)))
    ends = np.cumsum([part.shape[0] for part in parts])[:-1].tolist()

    def unpack(matrix: Array) -> Any:
        rows = jnp.split(matrix, ends)
        whole = [
            row.reshape(*leaf.shape[:-1], matrix.shape[-1]).astype(leaf.dtype)
            for row, leaf in zip(rows, leaves, strict=True)
        ]
        return jax.tree.unflatten(structure, whole)

    return jnp.concatenate([part.astype(dtype) for part in parts]), unpack


def _deliver(lanes: _Lanes, results: Float[Array, "numbers rows"]) -> Float[Array, "numbers rows"]:
    """The results with those of the lanes that have ended."""
    row = jnp.where(lanes.running, results.shape[-1], lanes.row)
    return results.at[:, row].set(_packing(_ended(lanes))[0], mode="drop")


def _take(method: Method, rows: Rows, row: Int[Array, " lanes"], observers: Mapping[str, AbstractObserver]) -> _Lanes:
    """Lanes at the start of rows; idle where there is no such row."""
    problem, lanes = rows.take(row), row.shape[0]
    end, memory = begin(method.controller, problem.limits, problem.t0, method.error_order)
    modes = method.modes
    return _Lanes(
        row=row,
        running=(row < rows.t0.shape[-1]) & (problem.t0 < problem.t1),
        problem=problem,
        start=problem.t0,
        end=jnp.minimum(end, problem.t1),
        x=problem.x,
        slope=jnp.zeros_like(problem.x),
        fresh=jnp.ones(lanes, bool),
        memory=memory,
        steps=jnp.zeros(lanes, jnp.int32),
        rejected=jnp.zeros(lanes, jnp.int32),
        finite=jnp.ones(lanes, bool),
        observed={name: item.begin(problem.observers[name]) for name, item in observers.items()},
        course=None if modes is None else modes.begin(problem.t0, problem.x, jnp.minimum(end, problem.t1)),
    )


def _advance_until_idle(
    method: Method,
    lanes: _Lanes,
    observers: Mapping[str, AbstractObserver],
    more: Bool[Array, ""],
    executed: Int[Array, ""],
    record: Any,
) -> tuple[_Lanes, Int[Array, ""], Any]:
    """Steps until an eighth of the lanes is idle, or all of them if there are no ``more`` rows."""
    size = lanes.row.shape[0]
    enough = jnp.where(more, max(size // IDLE, 1), size)

    # What a loop only reads is not part of what it carries, or else it would be copied in each step; parameters that
    # are separate arrays are read where they are needed, and rows of a matrix would first be copied, too.
    whole = lanes.problem
    assert whole is not None
    problem = whole._replace(parameters=tuple(whole.parameters))

    def busy(carry):
        return jnp.sum(~carry[0].running) < enough

    def advance(carry):
        lanes, executed, record = carry
        if method.modes is not None:
            lanes, record = _settled(method.modes, problem, lanes, record)
        return _advance(method, problem, lanes, observers), executed + jnp.int32(size), record

    lanes, executed, record = jax.lax.while_loop(busy, advance, (lanes._replace(problem=None), executed, record))
    return lanes._replace(problem=whole), executed, record


def _settled(modes: Modes, problem: Rows, lanes: _Lanes, record: Array) -> tuple[_Lanes, Array]:
    """Lanes with what follows modes that have ended; and steps that end no later than they may."""
    changing = {name: getattr(lanes, name) for name in SwitchingLanes._fields}
    assert problem.modes is not None
    after, record = modes.settled(SwitchingLanes(**changing), problem.modes, record)
    lanes = lanes._replace(**after._asdict())
    return lanes._replace(end=jnp.minimum(lanes.end, modes.latest_end(lanes.start, lanes.x))), record


def _advance(method: Method, problem: Rows, lanes: _Lanes, observers: Mapping[str, AbstractObserver]) -> _Lanes:
    """Lanes after a step; those that are idle are as they were, and so are those whose mode has ended."""
    running, course = lanes.running, lanes.course
    if course is not None:
        running = running & (course.pending == NONE)
    asks = (
        item.asks(lanes.observed[name], problem.observers[name], lanes.start, lanes.end)
        for name, item in observers.items()
    )
    taken = step(
        method.tableau,
        lambda t, x: method.field(problem.parameters, t, x),
        lanes.start,
        lanes.end,
        lanes.x,
        lanes.slope,
        lanes.fresh & running,
        method.within,
        jnp.any(running & functools.reduce(jnp.logical_or, asks, False)),
    )
    verdict = judge(method.controller, problem.limits, taken, lanes.memory, method.error_order)
    if method.modes is not None:
        assert course is not None
        assert problem.modes is not None
        verdict, course = method.modes.judged(
            course, problem.modes, taken, lanes.fresh & running, verdict, lanes.memory
        )
    kept, observed = verdict.kept, lanes.observed
    steps, finite = lanes.steps + running.astype(jnp.int32), lanes.finite & (verdict.fine | ~running)
    lanes = lanes._replace(observed={})
    advanced = lanes._replace(
        running=running & finite & (verdict.start < problem.t1) & (steps < method.max_steps),
        start=verdict.start,
        end=jnp.minimum(verdict.end, problem.t1),
        x=jnp.where(kept[None], taken.y, lanes.x),
        slope=jnp.where(kept[None], taken.last, taken.slopes[0]),
        fresh=kept & verdict.jumped,
        memory=verdict.memory,
        steps=steps,
        rejected=lanes.rejected + (~kept).astype(jnp.int32),
        finite=finite,
        course=course,
    )
    advanced = jax.tree.map(lambda old, new: jnp.where(running, new, old), lanes, advanced)
    return advanced._replace(
        observed={
            name: item.observe(observed[name], problem.observers[name], taken, kept & running)
            for name, item in observers.items()
        }
    )
