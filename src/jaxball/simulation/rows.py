"""Arrays of which the steps of a loop write rows."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..compat import evaluate, unvmap_any
from ..numerics.reverse_rules import added, chosen, replaced, with_rule

Index = Int[Array, ""]


def put(buffer: Array, index: Index, row: Array, counts: Bool[Array, ""]) -> Array:
    """``buffer`` with one more row, if that ``counts``. Nothing of it is read, so that it can be written in place."""
    return buffer.at[jnp.where(counts, index, buffer.shape[0])].set(row, mode="drop")


def put_while(
    due: Callable[[Index], Bool[Array, ""]],
    row_of: Callable[[Index], Array],
    buffer: Array,
    first: Index,
    *,
    reverse: bool,
) -> tuple[Array, Index]:
    """``buffer`` with more rows from ``first`` on, as long as they are ``due``, and the index of the next.

    - ``reverse``: whether derivatives are those of reverse mode, or else those of forward mode.
    """
    if not reverse:
        return _written(due, row_of, buffer, first)
    condition, row = jax.make_jaxpr(due)(first), jax.make_jaxpr(row_of)(first)

    def forward(operands: tuple[list[Any], list[Any], Array, Index]) -> tuple[Array, Index]:
        conditions, constants, buffer, first = operands

        def due(k: Index) -> Array:
            return evaluate(condition, conditions, [k])[0]

        return _written(due, lambda k: evaluate(row, constants, [k])[0], buffer, first)

    def kept(operands: tuple[list[Any], list[Any], Array, Index]) -> tuple[Any, Any]:
        _, constants, _, first = operands
        written, stop = forward(operands)
        return (written, stop), (constants, first, stop)

    def pull(kept: Any, cotangents: Any, varies: Any) -> Any:
        (constants, first, stop), (cotangent, _), (_, which, _, _) = kept, cotangents, varies
        moving = chosen(constants, which)

        def back(at: tuple[Index, list[Array]]) -> tuple[Index, list[Array]]:
            k, summed = at
            _, pull = jax.vjp(lambda moving: evaluate(row, replaced(constants, which, moving), [k])[0], moving)
            return k + 1, added(summed, pull(jnp.where(k < stop, cotangent[k], 0.0))[0])

        summed = [jnp.zeros_like(x) for x in moving]
        if cotangent is not None:
            _, summed = jax.lax.while_loop(lambda at: unvmap_any(at[0] < stop), back, (first, summed))
        nothing = [None] * len(condition.consts)
        return nothing, replaced([None] * len(constants), which, summed), cotangent, None

    return with_rule(forward, kept, pull)((list(condition.consts), list(row.consts), buffer, first))


def _written(due: Callable, row_of: Callable, buffer: Array, first: Index) -> tuple[Array, Index]:
    def write(at: tuple[Array, Index]) -> tuple[Array, Index]:
        buffer, k = at
        counts = due(k)
        return put(buffer, k, row_of(k), counts), k + jnp.where(counts, 1, 0)

    return jax.lax.while_loop(lambda at: unvmap_any(due(at[1])), write, (buffer, first))
