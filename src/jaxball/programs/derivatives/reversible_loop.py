"""A loop of an unknown number of steps that is differentiated in reverse mode by going back over the steps taken.

The loop of a solve (``simulation.loop``) is one, where it is to have reverse mode.

On the way forward, what a step begins with is recorded: of every step, or of every second, fourth, … as soon as there
are more steps than rows. On the way back, the steps in between are taken again from there, and each is pulled back: the
cotangents at its end become those at its beginning. This is the derivative of the steps taken, to rounding.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from ...interface.compat import Program, argument, evaluate, program_within, unvmap_any
from ..native.emit.uninitialised import empty_array
from .dependence import evaluate_chosen, move_with, varying_in_loop
from .reverse_rules import PullByForwardMode, add_arrays, choose, or_zeros, replace_chosen, with_rule
from .steering import direction_of, error_of_size, is_control, is_steered_from_outside, judge, steer_from_outside

Carry = TypeVar("Carry")
BYTES_FOR_ALL = 2**18  # bytes in which all steps are recorded, if they fit


class Recorded:
    """A part of a step whose results are recorded: on the way back it is not carried out again, but only pulled back.

    A step calls it at most once, and not within a branch or a loop. Its parts have different names.
    """

    def __init__(self, name: str):
        self.name = f"recorded_{name}_of_a_step"
        self._pull: Callable[..., Any] | None = None
        self._structure: Any = None

    def __call__(self, function: Callable[[Any], list[Array]], pull: Callable[..., Any], operands: Any) -> list[Array]:
        """Computes ``function(operands)``, whose cotangents are ``pull((operands, results), cotangents, varies)``."""
        leaves, structure = jax.tree.flatten(operands)
        self._pull, self._structure = pull, structure

        def forward(operands: Any, varies: Any) -> tuple[list[Array], Any]:
            results = function(operands)
            return results, (operands, results)

        def compute(*leaves: Array) -> list[Array]:
            return with_rule(function, forward, pull)(structure.unflatten(leaves))

        compute.__name__ = self.name
        return jax.jit(compute)(*leaves)

    def carry_out(self, program: Program, operands: Sequence[Any], of_parts: Sequence[Any]) -> list[Array]:
        """Computes the results without rules for reverse mode: by the ``program`` of the step, or as the pull does.

        - ``of_parts``: the operands, with the list of the arrays of which the whole is made in the place of the whole.
        """
        if isinstance(self._pull, PullByForwardMode):
            return self._pull.carry_out(self._structure.unflatten(of_parts))
        return _without_rules(program, list(operands))

    def recall(self, operands: Sequence[Any], results: Sequence[Array]) -> list[Array]:
        """Returns results that were recorded, with their derivatives with respect to the operands."""
        pull = self._pull
        assert pull is not None

        def forward(arguments: Any, varies: Any) -> tuple[list[Array], Any]:
            return arguments[1], arguments

        def back(arguments: Any, cotangents: list[Any], varies: Any) -> Any:
            return pull(arguments, cotangents, varies[0]), [None] * len(results)

        rule = with_rule(lambda arguments: arguments[1], forward, back)
        return rule((self._structure.unflatten(operands), list(results)))


class Parts(NamedTuple):
    """An array that all steps read, and the ``arrays`` of which ``join`` made it, which may vary one by one."""

    whole: Array
    arrays: list[Array]
    join: Callable[[list[Array]], Array]


def while_loop(
    unfinished: Callable[[Carry], Bool[Array, ""]],
    advance: Callable[[Carry, Bool[Array, ""]], Carry],
    initial: Carry,
    *,
    max_steps: int,
    buffers: Callable[[Carry], Any],
    reverse: bool,
    rows: int | None = None,
    recorded: Sequence[Recorded] = (),
    parts: Parts | None = None,
    moved: Callable[[Carry], Any] | None = None,
) -> Carry:
    """Takes steps until ``unfinished`` says no, at most ``max_steps``, and returns what is carried then.

    - ``advance``: a step. Its second argument says whether it counts: in a batch, steps go on until all are finished.
    - ``buffers``: the arrays of a carry of which steps write rows, each once, by :func:`~.reverse_rules.put`, and read
      none.
    - ``reverse``: whether derivatives are those of reverse mode, once, or else those of forward mode.
    - ``rows``: how many steps are recorded at most, for reverse mode. If not given, all of them where that needs little
      memory, and at least the square root of ``max_steps``.
    - ``recorded``: parts of a step that are recorded, too. The operand that is the whole of the ``parts`` is given to
      them as the list of their arrays where they are pulled back.
    - ``moved``: of a carry, the arrays that a probe of the loop moves at its start, besides those of the ``parts``.
    """
    leaves, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, initial))
    places = structure.unflatten(range(len(leaves)))
    written = set(jax.tree.leaves(buffers(places)))
    is_buffer = [k in written for k in range(len(leaves))]
    probed = [] if moved is None else jax.tree.leaves(moved(places))

    def goes_on(leaves: list[Array]) -> Bool[Array, ""]:
        return unvmap_any(unfinished(structure.unflatten(leaves)))

    def step(leaves: list[Array]) -> list[Array]:
        carry = structure.unflatten(leaves)
        counts = unfinished(carry)
        new = jax.tree.leaves(advance(carry, counts))
        # An array with a weak type, like that of Python's numbers, keeps it.
        return [
            x if is_write_row else jnp.where(counts, x, old)
            for x, old, is_write_row in zip(new, leaves, is_buffer, strict=True)
        ]

    if not reverse:
        return structure.unflatten(_repeat(goes_on, lambda k, leaves: step(leaves), leaves, max_steps)[1])
    # Traced once: the way back needs the very operations of the way forward, to find the recorded parts among them.
    programs = jax.make_jaxpr(goes_on)(leaves), jax.make_jaxpr(step)(leaves)
    return structure.unflatten(_Loop(*programs, is_buffer, max_steps, rows, recorded, parts, probed)(leaves))


def _repeat(goes_on: Callable, step: Callable, carry: Any, most: int | Array) -> tuple[Array, Any]:
    """Counts the steps that are taken, and returns where they led to."""

    def condition(state: tuple[Array, Any]) -> Array:
        return goes_on(state[1]) & (state[0] < most)

    return jax.lax.while_loop(condition, lambda state: (state[0] + 1, step(*state)), (jnp.asarray(0), carry))


class _Recording(NamedTuple):
    """The recording of the way forward.

    - ``steps``: how many were taken; every ``every``-th of them has one of the ``rows``.
    - ``errors``: that of each step, by which it was judged.
    - ``constants``, ``arrays``: what all steps read.
    """

    steps: Int[Array, ""]
    every: Int[Array, ""]
    errors: Array
    rows: list[Array]
    constants: list[Any]
    arrays: list[Array]


class _Loop:
    """A loop of programs of flat lists of arrays."""

    def __init__(
        self,
        goes_on: Program,
        step: Program,
        is_buffer: list[bool],
        max_steps: int,
        rows: int | None,
        recorded: Sequence[Recorded],
        parts: Parts | None,
        probed: list[int],
    ):
        self.probed = probed
        self.goes_on, self.step, self.max_steps, self.parts = goes_on, step, max_steps, parts
        self.is_carried = [not is_write_row for is_write_row in is_buffer]
        self.place = None
        if parts is not None:
            self.place = next((k for k, constant in enumerate(step.consts) if constant is parts.whole), None)
        named = {part.name: part for part in recorded}
        self.recorded = [(e, named[e.params["name"]]) for e in step.jaxpr.eqns if e.params.get("name") in named]
        results = [variable.aval for equation, _ in self.recorded for variable in equation.outvars]
        self.packing = _Packing([*choose(step.in_avals, self.is_carried), *results])
        # With √n rows, each step is taken twice at most, in segments of some √n steps.
        least = math.isqrt(max(max_steps - 1, 0)) + 1
        self.rows = min(max(BYTES_FOR_ALL // max(self.packing.size, 1), least) if rows is None else rows, max_steps)
        # Steps that are taken twice are taken by the same program, so that they are the same to the last bit.
        self.take_step = self._take_step if self.rows == self.max_steps else jax.jit(self._take_step)
        places = {} if parts is None else {id(array): place for place, array in enumerate(parts.arrays)}
        # Which constants are one of the arrays of which the whole is made.
        self.shared = {k: places[id(x)] for k, x in enumerate(step.consts) if id(x) in places}
        controls = [equation for equation in step.jaxpr.eqns if is_control(equation)]
        estimate = controls[0].outvars[0].aval if controls else jax.ShapeDtypeStruct((1,), float)
        self.judged = jax.ShapeDtypeStruct(estimate.shape[:-1], estimate.dtype)

    def __call__(self, leaves: list[Array]) -> list[Array]:
        constants = list(self.step.consts)
        if self.place is not None:
            constants[self.place] = ()
        arrays = [] if self.parts is None else self.parts.arrays
        operands = constants, arrays, list(self.goes_on.consts), leaves
        return with_rule(lambda arguments: self.forward(*arguments), self.record_with_probe, self.back)(operands)

    def whole(self, constants: list[Any], arrays: list[Array]) -> list[Any]:
        """Joins the parts into the constant that they are."""
        return constants if self.parts is None else self.with_whole(constants, self.parts.join(arrays))

    def with_whole(self, constants: list[Any], whole: Any) -> list[Any]:
        """Returns what stands for the constants, with the ``whole`` in its place, if it has one."""
        if self.place is None:
            return constants
        return [*constants[: self.place], whole, *constants[self.place + 1 :]]

    def forward(self, constants, arrays, conditions, leaves) -> list[Array]:
        """Takes all steps, without a recording."""
        constants = self.whole(constants, arrays)

        def step(k: Array, leaves: list[Array]) -> list[Array]:
            return evaluate(self.step, constants, leaves)

        return _repeat(lambda leaves: evaluate(self.goes_on, conditions, leaves)[0], step, leaves, self.max_steps)[1]

    def record_with_probe(self, operands: Any, varies: Any) -> tuple[list[Array], _Recording]:
        """Takes all steps, as short as the derivatives with respect to what ``varies`` ask for, and records them."""
        constants, arrays, conditions, leaves = operands
        of_constants, of_arrays, _, of_leaves = varies
        of_probe = [k in self.probed and varies for k, varies in enumerate(of_leaves)]
        moving = choose(arrays, of_arrays), choose(leaves, of_probe)
        numbers = (
            [k for k, varies in enumerate(of_arrays) if varies],
            [len(arrays) + self.probed.index(k) for k, varies in enumerate(of_probe) if varies],
        )
        directions = tuple(list(map(direction_of, *both)) for both in zip(moving, numbers, strict=True))
        of_loop = varying_in_loop(self.step, self.with_whole(of_constants, any(of_arrays)), of_leaves)

        def record(moving: tuple[list[Array], list[Array]]) -> Any:
            moved_arrays = replace_chosen(arrays, of_arrays, moving[0])
            moved_constants = [moved_arrays[self.shared[k]] if k in self.shared else x for k, x in enumerate(constants)]
            moved_leaves = replace_chosen(leaves, of_probe, moving[1])
            moved_leaves = replace_chosen(moved_leaves, of_loop, move_with(choose(moved_leaves, of_loop), moving))
            return (), self.record(moved_constants, moved_arrays, conditions, moved_leaves)

        if is_steered_from_outside() or not any(moving):
            return record(moving)[1]
        with steer_from_outside():
            return jax.jvp(record, (moving,), (directions,), has_aux=True)[2]

    def record(self, constants, arrays, conditions, leaves) -> tuple[list[Array], _Recording]:
        """Takes all steps, and records what each begins with."""
        whole = self.whole(constants, arrays)

        def goes_on(carry: Any) -> Array:
            return evaluate(self.goes_on, conditions, carry[0])[0]

        def step(k: Array, carry: Any) -> Any:
            leaves, every, errors, rows = carry
            new, row, error = self.take_step(whole, arrays, leaves)
            errors = errors.at[k].set(error)
            if self.rows == self.max_steps:
                return new, every, errors, _write_row(rows, k, row)
            # How many steps there will be is not known: when the rows are full, every second one is dropped, and steps
            # are recorded half as often from there on.
            full = k == every * self.rows
            rows = jax.lax.fori_loop(0, jnp.where(full, (self.rows + 1) // 2, 0), _keep_every_second, rows)
            every = jnp.where(full, 2 * every, every)
            # A row beyond the last is not written.
            place = jnp.where(k % every == 0, k // every, self.rows)
            return new, every, errors, _write_row(rows, place, row)

        room = empty_array((self.max_steps, *self.judged.shape), self.judged.dtype)
        start = leaves, jnp.asarray(1), room, self.packing.room(self.rows)
        steps, (last, every, errors, rows) = _repeat(goes_on, step, start, self.max_steps)
        return last, _Recording(steps, every, errors, rows, constants, arrays)

    def _take_step(
        self, constants: list[Any], arrays: list[Array], leaves: list[Array], error: Array | None = None
    ) -> tuple[list[Array], list[Array], Array]:
        """Takes a step; returns the arrays after it, the row that is recorded, and the error by which it was judged.

        - ``arrays``: the parts of the whole; ``error``: that by which the step was judged when it was taken before.
        """
        seen: list[Array] = []
        judged = [jnp.zeros(self.judged.shape, self.judged.dtype)]

        def note(equation: Any, operands: list[Any]) -> list[Array] | None:
            if is_control(equation):
                if error is not None:
                    return _judge_again(operands, error)
                results, judged[0] = judge(operands)
                return results
            if equation.primitive.name.startswith("custom_vjp_call"):  # a loop that writes rows, which no step reads
                return _without_rules(program_within(equation), jax.lax.stop_gradient(operands))
            part = next((part for recorded, part in self.recorded if recorded is equation), None)
            if part is None:
                return None
            of_parts = self.with_parts(equation, operands, arrays)
            results = part.carry_out(argument(equation, "jaxpr"), operands, of_parts)
            seen.extend(results)
            return results

        new = evaluate_chosen(self.step, constants, leaves, [True] * len(leaves), note)
        row = self.packing.pack([*choose(leaves, self.is_carried), *seen])
        return new, *jax.lax.stop_gradient((row, judged[0]))

    def with_parts(self, equation: Any, operands: list[Any], arrays: list[Array]) -> list[Any]:
        """Returns the operands of an equation with the list of the ``arrays`` of the whole in its place."""
        if self.place is None:
            return operands
        whole = self.step.jaxpr.constvars[self.place]
        return [arrays if variable is whole else x for variable, x in zip(equation.invars, operands, strict=True)]

    def recall(self, equation: Any, known: list[Array]) -> tuple[Recorded | None, list[Array]]:
        """Looks up an equation among the recorded parts of a step; returns the part, if it is one, and its results."""
        remaining = iter(known)
        for recorded, part in self.recorded:
            results = list(itertools.islice(remaining, len(recorded.outvars)))
            if recorded is equation:
                return part, results
        return None, []

    def back(self, recording: _Recording, cotangents: list[Any], varies: Any) -> Any:
        """Pulls cotangents back over all steps, to the constants, the arrays of parts, conditions, and the start."""
        back = _WayBack(self, recording, varies)
        start = [or_zeros(cotangent, aval) for cotangent, aval in zip(cotangents, self.step.in_avals, strict=True)]
        carry, all_have_rows = (choose(start, back.which), back.nothing()), self.rows == self.max_steps
        return back.results(
            *(back.through(recording.rows, 0, recording.steps, carry) if all_have_rows else back.by_segments(carry))
        )


class _WayBack:
    """The way back over the steps that a loop took."""

    def __init__(self, loop: _Loop, recording: _Recording, varies: Any):
        self.loop, self.recording = loop, recording
        of_constants, self.of_arrays, self.of_conditions, of_leaves = varies
        # The whole varies if any of its parts does.
        self.of_constants = loop.with_whole(of_constants, any(self.of_arrays))
        self.which = varying_in_loop(loop.step, self.of_constants, of_leaves)
        self.constants = loop.whole(recording.constants, recording.arrays)

    def nothing(self) -> list[list[Array]]:
        """Returns zeros, to which the cotangents of the values that all steps read are added."""
        constants, arrays = choose(self.constants, self.of_constants), choose(self.recording.arrays, self.of_arrays)
        return [[jnp.zeros_like(x) for x in group] for group in (constants, arrays)]

    def by_segments(self, at: Any) -> Any:
        """Pulls cotangents back over all steps, and takes those without a row again."""
        loop, every = self.loop, self.recording.every
        # At most every ``every``-th step has a row: rows are at least half full, or all steps have one.
        longest = 2 * -(-loop.max_steps // loop.rows)

        def segment(at: Any) -> Any:
            end, cotangents, rows = at
            first = (end - 1) // every * every

            def again(k: Array, at: Any) -> Any:
                leaves, rows = at
                error = self.recording.errors[first + k]
                new, row, _ = loop.take_step(self.constants, self.recording.arrays, self.with_buffers(leaves), error)
                return choose(new, loop.is_carried), _write_row(rows, k, row)

            first_row = [row[first // every] for row in self.recording.rows]
            begun, count = loop.packing.unpack(first_row)[: sum(loop.is_carried)], end - first
            # The row of the first step is there; only those behind it are computed again.
            rows = _write_row(rows, jnp.asarray(0), first_row)
            _, (_, rows) = _repeat(lambda _: True, again, (begun, rows), jnp.where(count == 1, 0, count))
            return first, self.through(rows, first, end - first, cotangents), rows

        start = self.recording.steps, at, loop.packing.room(min(longest, loop.max_steps))
        return jax.lax.while_loop(lambda at: at[0] > 0, segment, start)[1]

    def through(self, rows: list[Array], first: Array | int, count: Array, at: Any) -> Any:
        """Pulls cotangents back over ``count`` steps from number ``first`` on, each of which has a row."""

        def step(at: Any) -> Any:
            k, (cotangents, summed) = at
            arrays = self.loop.packing.unpack([row[k - 1] for row in rows])
            carried, error = sum(self.loop.is_carried), self.recording.errors[first + k - 1]
            leaves = self.with_buffers(arrays[:carried])
            cotangents, new = self.pull_back(leaves, arrays[carried:], error, cotangents)
            return k - 1, (cotangents, [add_arrays(*both) for both in zip(summed, new, strict=True)])

        return jax.lax.while_loop(lambda at: at[0] > 0, step, (count, at))[1]

    def with_buffers(self, carried: list[Array]) -> list[Array]:
        """Returns all that a step begins with; buffers are empty, because no step reads them."""
        avals = self.loop.step.in_avals
        return replace_chosen([jnp.zeros(aval.shape, aval.dtype) for aval in avals], self.loop.is_carried, carried)

    def pull_back(
        self, leaves: list[Array], known: list[Array], error: Array, cotangents: list[Array]
    ) -> tuple[Any, Any]:
        """Pulls cotangents back over one step: to what it begins with, and to the values that all steps read."""
        loop = self.loop

        def following(moving: list[Array], constants: list[Array], arrays: list[Array]) -> list[Array]:
            arrays = replace_chosen(self.recording.arrays, self.of_arrays, arrays)

            def recall_part(equation: Any, operands: list[Any]) -> list[Array] | None:
                if is_control(equation):
                    return _judge_again(operands, error)
                part, results = loop.recall(equation, known)
                if part is None:
                    return None
                return part.recall(loop.with_parts(equation, operands, arrays), results)

            constants = replace_chosen(self.constants, self.of_constants, constants)
            return evaluate_chosen(
                loop.step, constants, replace_chosen(leaves, self.which, moving), self.which, recall_part
            )

        arguments = (
            choose(leaves, self.which),
            choose(self.constants, self.of_constants),
            choose(self.recording.arrays, self.of_arrays),
        )
        _, pull = jax.vjp(following, *arguments)
        cotangents, *summed = pull(cotangents)
        return cotangents, summed

    def results(self, cotangents: list[Array], summed: list[list[Array]]) -> Any:
        """Arranges the cotangents as the operands of the loop; None where there are none."""
        loop, (constants, arrays) = self.loop, summed
        all_constants: list[Any] = replace_chosen([None] * len(self.of_constants), self.of_constants, constants)
        if loop.place is not None and loop.parts is not None:
            whole, all_constants[loop.place] = all_constants[loop.place], ()
            if whole is not None:
                _, pull = jax.vjp(loop.parts.join, self.recording.arrays)
                arrays = add_arrays(arrays, choose(pull(whole)[0], self.of_arrays))
        of_arrays = replace_chosen([None] * len(self.of_arrays), self.of_arrays, arrays)
        of_leaves = replace_chosen([None] * len(self.which), self.which, cotangents)
        return all_constants, of_arrays, [None] * len(self.of_conditions), of_leaves


class _Packing:
    """Puts arrays together in one for each type of number."""

    def __init__(self, avals: Sequence[Any]):
        self.avals = list(avals)
        self.dtypes = sorted({np.dtype(aval.dtype) for aval in avals}, key=str)
        self.counts = [sum(aval.size for aval in avals if aval.dtype == dtype) for dtype in self.dtypes]
        self.size = sum(aval.size * aval.dtype.itemsize for aval in avals)

    def room(self, rows: int) -> list[Array]:
        """Makes room for ``rows`` rows."""
        return [empty_array((rows, count), dtype) for count, dtype in zip(self.counts, self.dtypes, strict=True)]

    def pack(self, arrays: Sequence[Any]) -> list[Array]:
        """Packs arrays into a row; among them may be constants of a trace, which are no arrays of JAX."""
        return [
            jnp.concatenate([jnp.ravel(array) for array in arrays if array.dtype == dtype]) for dtype in self.dtypes
        ]

    def unpack(self, row: Sequence[Array]) -> list[Array]:
        """Unpacks the arrays of a row."""
        places, arrays = [0] * len(self.dtypes), []
        for aval in self.avals:
            kind = self.dtypes.index(aval.dtype)
            start = places[kind]
            places[kind] = start + aval.size
            arrays.append(row[kind][start : start + aval.size].reshape(aval.shape))
        return arrays


def _judge_again(operands: list[Any], error: Array) -> list[Array]:
    """Returns the results of a ``control_error`` for the error of a step by which it was judged before."""
    estimate, _, _, weights, _, size = jax.lax.stop_gradient(operands)
    return [error_of_size(estimate, weights, error), size]


def _without_rules(program: Program | None, operands: list[Any]) -> list[Any]:
    """Computes the results of a program whose equations may have rules for reverse mode, without these."""
    assert program is not None

    def instead(equation: Any, operands: list[Any]) -> list[Array] | None:
        has_rule = equation.primitive.name.startswith("custom_vjp_call")
        return _without_rules(program_within(equation), operands) if has_rule else None

    return evaluate_chosen(program, program.consts, operands, [True] * len(program.jaxpr.outvars), instead)


def _write_row(rows: list[Array], place: Array, row: list[Array]) -> list[Array]:
    """Writes a row at a place; where there is no such place, nothing changes."""
    return [array.at[place].set(new, mode="drop") for array, new in zip(rows, row, strict=True)]


def _keep_every_second(k: Array, rows: list[Array]) -> list[Array]:
    """Moves row 2k to row k, so that every second row is kept."""
    return [array.at[k].set(array[2 * k]) for array in rows]
