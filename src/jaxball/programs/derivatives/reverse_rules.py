"""Gives functions rules of their own for reverse mode, which are told what varies and need not compute anything else.

Among them are loops that write rows of arrays, and loops that add them up.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Int

from ...interface.compat import evaluate, unvmap_any
from .. import native
from ..batches import map_rows
from .differentiation import without_derivatives

Forward = Callable[[Any, Any], tuple[Any, Any]]
Pull = Callable[[Any, Any, Any], Any]
CarryOut = Callable[[Callable[[Any], Any], Pull, Any], Any]  # a function, a pull of it, and operands: the results
Index = Int[Array, ""]


def at_once(function: Callable[[Any], Any], pull: Pull, operands: Any) -> Any:
    """Returns the results of a function, with its own derivatives."""
    return function(operands)


def with_rule(function: Callable[[Any], Any], forward: Forward, pull: Pull) -> Callable[[Any], Any]:
    """Returns ``function`` of a PyTree of arrays, with a rule for derivatives in reverse mode.

    - ``forward``: of the same PyTree, and one that says of each array whether it varies, the results and what is kept
      for the way back.
    - ``pull``: the cotangents of the arrays, None for those that do not vary. It takes what ``forward`` kept, the
      cotangents of the results, in which None is zero, and a PyTree that says of each array whether it varies.
    """

    def record(operands: Any) -> tuple[Any, Any]:
        varies = jax.tree.map(_varies, operands)
        results, residuals = forward(jax.tree.map(lambda x: x.value, operands), varies)
        # Only arrays can be kept, but in structures that may differ.
        return results, (residuals, jax.tree.map(lambda does: () if does else None, varies))

    def backward(recording: tuple[Any, Any], cotangents: Any) -> tuple[Any]:
        residuals, marks = recording
        varies = jax.tree.map(lambda mark: mark is not None, marks, is_leaf=lambda x: x is None or x == ())
        return (pull(residuals, jax.tree.map(_unless_zero, cotangents), varies),)

    ruled = jax.custom_vjp(function)
    ruled.defvjp(record, backward, symbolic_zeros=True)
    return ruled


class PullByForwardMode:
    """The pull of ``function``, of a PyTree of arrays, by forward mode; it keeps the operands and the results.

    For a function of a few numbers that is long, or has loops of unknown length. It is computed, with its derivative in
    one direction, for each number that varies. These have one type.

    - ``happens``: of the operands, whether the results are not just zeros; None if they never are.
    """

    def __init__(self, function: Callable[[Any], Any], happens: Callable[[Any], Bool[Array, ""]] | None = None):
        self.function, self.happens = function, happens

        def along(which: tuple[bool, ...], operands: Any, direction: Array) -> tuple[list[Array], list[Array]]:
            leaves, structure = jax.tree.flatten(operands)
            x, unravel = ravel_pytree(choose(leaves, which))

            def results(x: Array) -> list[Array]:
                return jax.tree.leaves(function(structure.unflatten(replace_chosen(leaves, which, unravel(x)))))

            values, rates = jax.jvp(results, (x,), (direction,))
            return values, [rate for value, rate in zip(values, rates, strict=True) if _is_inexact(value)]

        @functools.partial(jax.jit, static_argnums=0)
        def products(which: tuple[bool, ...], operands: Any, cotangents: list[Array | None]) -> list[Array]:
            x, unravel = ravel_pytree(choose(jax.tree.leaves(operands), which))

            def product(direction: Array) -> Array:
                values, rates = along(which, operands, direction)
                of_rates = [ct for ct, value in zip(cotangents, values, strict=True) if _is_inexact(value)]
                pairs = zip(of_rates, rates, strict=True)
                return sum((jnp.sum(cotangent * rate) for cotangent, rate in pairs if cotangent is not None), 0 * x[0])

            return unravel(map_rows(product, jnp.eye(x.size, dtype=x.dtype)))

        # Traced, and written for lanes, once: for the way back, in many directions, and for the way forward, in one.
        along.__name__ = native.FOR_LANES
        along = jax.jit(along, static_argnums=0)
        self._along, self._products = along, products

    def __call__(self, recording: tuple[Any, Any], cotangents: Any, varies: Any) -> Any:
        which, structure = jax.tree.flatten(varies)
        if not any(which):
            return structure.unflatten([None] * len(which))
        cotangents = jax.tree.leaves(cotangents, is_leaf=lambda leaf: leaf is None)
        gradients = self._products(tuple(which), recording[0], cotangents)
        return structure.unflatten(replace_chosen([None] * len(which), which, gradients))

    def carry_out(self, operands: Any) -> list[Array]:
        """Computes the results on a way forward that has a probe, whose tangents come from the program of the way back.

        That is written for many directions, in lanes. With one for a single direction besides, a gradient with a law of
        contact had a third more instructions.
        """
        leaves, structure = jax.tree.flatten(operands)

        @jax.custom_jvp
        def results(leaves: list[Array]) -> list[Array]:
            return jax.tree.leaves(self.function(structure.unflatten(leaves)))

        def moved(primals: Any, tangents: Any) -> tuple[list[Array], list[Any]]:
            (leaves,), (tangents,) = primals, tangents
            which = tuple(not isinstance(tangent, jax.custom_derivatives.SymbolicZero) for tangent in tangents)
            operands = structure.unflatten(leaves)

            def push() -> tuple[list[Array], list[Array]]:
                direction, _ = ravel_pytree(choose(tangents, which))
                # Twice, because a single one would be the same in all lanes, and so no direction of lanes.
                rows = jnp.broadcast_to(direction, (2, direction.size))
                return jax.tree.map(lambda x: x[0], map_rows(functools.partial(self._along, which, operands), rows))

            def nothing() -> tuple[list[Array], list[Array]]:
                return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(push))

            if not any(which):
                values, rates = results(leaves), []
            elif self.happens is None:
                values, rates = push()
            else:
                values, rates = jax.lax.cond(self.happens(operands), push, nothing)
            remaining = iter(rates)
            return values, [
                next(remaining, jnp.zeros_like(value)) if _is_inexact(value) else _no_tangent(value) for value in values
            ]

        results.defjvp(moved, symbolic_zeros=True)
        return results(leaves)


def _is_inexact(array: Any) -> bool:
    return jnp.issubdtype(array.dtype, jnp.inexact)


def _no_tangent(array: Any) -> np.ndarray:
    return np.zeros(array.shape, jax.dtypes.float0)


def _varies(operand: Any) -> bool:
    return operand.perturbed and _is_inexact(operand.value)


def _unless_zero(cotangent: Any) -> Array | None:
    return None if isinstance(cotangent, jax.custom_derivatives.SymbolicZero) else cotangent


def choose(arrays: Sequence[Any], which: Sequence[bool]) -> list[Any]:
    """Returns the arrays that are chosen."""
    return [array for array, is_chosen in zip(arrays, which, strict=True) if is_chosen]


def replace_chosen(arrays: Sequence[Any], which: Sequence[bool], by: Sequence[Any]) -> list[Any]:
    """Returns the arrays with others in the place of the chosen ones."""
    remaining = iter(by)
    return [next(remaining) if is_chosen else array for array, is_chosen in zip(arrays, which, strict=True)]


def or_zeros(cotangent: Array | None, like: Any) -> Array:
    """Returns a cotangent; zeros in the place of None."""
    return jnp.zeros(like.shape, like.dtype) if cotangent is None else cotangent


def add_arrays(one: Sequence[Array], other: Sequence[Array]) -> list[Array]:
    """Computes the sums of arrays one by one."""
    return [x + y for x, y in zip(one, other, strict=True)]


def put(buffer: Array, index: Index, row: Array, counts: Bool[Array, ""]) -> Array:
    """Returns ``buffer`` with one more row, if that ``counts``. Nothing of it is read, so that it can be written in
    place.
    """
    return buffer.at[jnp.where(counts, index, buffer.shape[0])].set(row, mode="drop")


def put_while(
    due: Callable[[Index], Bool[Array, ""]],
    row_of: Callable[[Index], Array],
    buffer: Array,
    first: Index,
    *,
    reverse: bool,
    place_of: Callable[[Index], Index] = lambda k: k,
) -> tuple[Array, Index]:
    """Returns ``buffer`` with more rows from number ``first`` on, as long as they are ``due``, and the number of the
    next.

    - ``reverse``: whether derivatives are those of reverse mode, or else those of forward mode.
    - ``place_of``: where in the buffer the row with a number is; by default there.
    """
    if not reverse:
        return _write_rows(due, row_of, place_of, buffer, first)
    condition, row, place = (jax.make_jaxpr(function)(first) for function in (due, row_of, place_of))

    def forward(operands: tuple[list[Any], list[Any], list[Any], Array, Index]) -> tuple[Array, Index]:
        conditions, constants, places, buffer, first = operands

        def due(k: Index) -> Array:
            return evaluate(condition, conditions, [k])[0]

        def place_of(k: Index) -> Array:
            return evaluate(place, places, [k])[0]

        return _write_rows(due, lambda k: evaluate(row, constants, [k])[0], place_of, buffer, first)

    def record(operands: tuple[list[Any], list[Any], list[Any], Array, Index], varies: Any) -> tuple[Any, Any]:
        _, constants, places, _, first = operands
        written, stop = forward(operands)
        return (written, stop), (constants, places, first, stop)

    def pull(recording: Any, cotangents: Any, varies: Any) -> Any:
        (constants, places, first, stop), (cotangent, _), (_, which, *_) = recording, cotangents, varies
        moving = choose(constants, which)

        def back(carry: tuple[Index, list[Array]]) -> tuple[Index, list[Array]]:
            k, summed = carry
            _, pull = jax.vjp(lambda moving: evaluate(row, replace_chosen(constants, which, moving), [k])[0], moving)
            of_row = cotangent[evaluate(place, places, [k])[0]]
            return k + 1, add_arrays(summed, pull(jnp.where(k < stop, of_row, 0.0))[0])

        summed = [jnp.zeros_like(x) for x in moving]
        if cotangent is not None:
            _, summed = jax.lax.while_loop(lambda carry: unvmap_any(carry[0] < stop), back, (first, summed))
        nothing, nowhere = [None] * len(condition.consts), [None] * len(places)
        return nothing, replace_chosen([None] * len(constants), which, summed), nowhere, cotangent, None

    operands = list(condition.consts), list(row.consts), list(place.consts), buffer, first
    return with_rule(forward, record, pull)(operands)


def sum_while(
    unfinished: Callable[[Any], Bool[Array, ""]],
    points_of: Callable[[Any], Array],
    rows_of: Callable[[Array], Array],
    advance: Callable[[Any, Array], tuple[Any, Array]],
    carry: Any,
    total: Array,
    *,
    reverse: bool,
) -> tuple[Any, Array]:
    """Adds weighted rows to ``total`` as long as a loop is ``unfinished``, and returns what it carries then, and the
    total.

    In a turn the rows at a few points are computed; ``advance`` returns what is carried next and the weights of these
    rows, 0 for those that do not count. The rows and the total have derivatives; what is carried, points and weights
    are constants.

    - ``unfinished``, ``points_of``, ``advance``: functions of the carry, and of no other traced arrays.
    - ``rows_of``: of points, one row for each.
    - ``reverse``: as for :func:`put_while`.
    """
    carry = without_derivatives(carry)

    def turn(rows_of: Callable[[Array], Array], state: tuple[Any, Array]) -> tuple[Any, Array]:
        carry, total = state
        rows = rows_of(points_of(carry))
        carry, weights = advance(carry, without_derivatives(rows))
        return carry, total + jnp.sum(_weigh(weights, rows), axis=0)

    def repeat(rows_of: Callable[[Array], Array], carry: Any, total: Array) -> tuple[Any, Array]:
        return jax.lax.while_loop(lambda state: unfinished(state[0]), lambda x: turn(rows_of, x), (carry, total))

    if not reverse:
        return repeat(rows_of, carry, total)
    program = jax.make_jaxpr(rows_of)(points_of(carry))

    def forward(operands: tuple[list[Any], Any, Array]) -> tuple[Any, Array]:
        constants, carry, total = operands
        return repeat(lambda points: evaluate(program, constants, [points])[0], carry, total)

    def pull(operands: tuple[list[Any], Any], cotangents: Any, varies: Any) -> Any:
        (constants, carry), (_, cotangent), (which, *_) = operands, cotangents, varies
        moving = choose(constants, which)

        def back(state: tuple[Any, list[Array]]) -> tuple[Any, list[Array]]:
            # The turns are taken once more, which needs no room for what they were.
            carry, summed = state
            points = points_of(carry)

            def rows_of(moving: list[Array]) -> Array:
                return evaluate(program, replace_chosen(constants, which, moving), [points])[0]

            rows, pull = jax.vjp(rows_of, moving)
            carry, weights = advance(carry, rows)
            of_rows = _weigh(weights, jnp.broadcast_to(cotangent, rows.shape))
            return carry, add_arrays(summed, pull(of_rows)[0])

        summed = [jnp.zeros_like(x) for x in moving]
        if cotangent is not None and moving:
            _, summed = jax.lax.while_loop(lambda state: unfinished(state[0]), back, (carry, summed))
        nothing = jax.tree.map(lambda _: None, carry)
        return replace_chosen([None] * len(constants), which, summed), nothing, cotangent

    operands = list(program.consts), carry, total
    return with_rule(forward, lambda operands, _: (forward(operands), operands[:2]), pull)(operands)


def _weigh(weights: Array, rows: Array) -> Array:
    counts = (weights != 0)[:, None]
    return jnp.where(counts, weights[:, None] * rows, 0.0)


def _write_rows(
    due: Callable, row_of: Callable, place_of: Callable, buffer: Array, first: Index
) -> tuple[Array, Index]:
    def write(carry: tuple[Array, Index]) -> tuple[Array, Index]:
        buffer, k = carry
        counts = due(k)
        return put(buffer, place_of(k), row_of(k), counts), k + jnp.where(counts, 1, 0)

    return jax.lax.while_loop(lambda carry: unvmap_any(due(carry[1])), write, (buffer, first))
