"""A loop of an unknown number of steps that is differentiated in reverse mode by going back over the steps taken.

On the way forward, what a step begins with is recorded: of every step, or of every second, fourth, … as soon as there
are more steps than rows. On the way back, the steps in between are taken again from there, and each is pulled back: the
cotangents of what it led to become those of what it began with. This is the derivative of the steps taken, to rounding.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..compat import Program, evaluate, unvmap_any
from ..numerics.dependence import varying

Carry = TypeVar("Carry")
ROOM = 2**18  # bytes of the rows in which steps are recorded, if all are


def while_loop(
    unfinished: Callable[[Carry], Bool[Array, ""]],
    advance: Callable[[Carry, Bool[Array, ""]], Carry],
    initial: Carry,
    *,
    max_steps: int,
    buffers: Callable[[Carry], Any],
    reverse: bool,
    rows: int | None = None,
) -> Carry:
    """What is carried when ``unfinished`` says no, or after ``max_steps``.

    - ``advance``: a step. Its second argument says whether it counts: in a batch, steps go on until all are finished.
    - ``buffers``: the arrays of a carry of which steps write rows, by :func:`put` alone, each row once, and read none.
    - ``reverse``: whether derivatives are those of reverse mode, or else those of forward mode.
    - ``rows``: how many steps are recorded at most, for reverse mode. If not given, all of them where that needs little
      memory, and at least the square root of ``max_steps``.
    """
    leaves, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, initial))
    is_buffer = _marks(buffers, structure)

    def goes_on(leaves: list[Array]) -> Bool[Array, ""]:
        return unvmap_any(unfinished(structure.unflatten(leaves)))

    def step(leaves: list[Array]) -> list[Array]:
        carry = structure.unflatten(leaves)
        counts = unfinished(carry)
        new = jax.tree.leaves(advance(carry, counts))
        return [
            jax.lax.convert_element_type(x if written else jnp.where(counts, x, old), old.dtype)
            for x, old, written in zip(new, leaves, is_buffer, strict=True)
        ]

    if not reverse:
        taken, last = jax.lax.while_loop(
            lambda at: goes_on(at[1]) & (at[0] < max_steps), lambda at: (at[0] + 1, step(at[1])), (0, leaves)
        )
        return structure.unflatten(last)
    loop = _Loop(jax.make_jaxpr(goes_on)(leaves), jax.make_jaxpr(step)(leaves), is_buffer, max_steps, rows)
    return structure.unflatten(loop(leaves))


def _marks(buffers, structure):
    numbered = structure.unflatten(range(structure.num_leaves))
    chosen = set(jax.tree.leaves(buffers(numbered)))
    return [k in chosen for k in range(structure.num_leaves)]


def put(buffer: Array, index: Int[Array, ""], row: Array, counts: Bool[Array, ""]) -> Array:
    """``buffer`` with one more row, if it ``counts``."""
    return buffer.at[jnp.where(counts, index, buffer.shape[0])].set(row, mode="drop")


def put_rows(
    buffer: Array,
    first: Int[Array, ""],
    due: Callable[[Int[Array, ""]], Bool[Array, ""]],
    row_of: Callable[[Int[Array, ""]], Array],
    *,
    reverse: bool,
) -> tuple[Array, Int[Array, ""]]:
    """``buffer`` with more rows, from ``first`` on for as long as they are ``due``, and the index of the next."""

    def written(due: Callable, row_of: Callable, buffer: Array, first: Array) -> tuple[Array, Array]:
        def write(at: tuple[Array, Array]) -> tuple[Array, Array]:
            buffer, k = at
            counts = due(k)
            return put(buffer, k, row_of(k), counts), k + counts

        return jax.lax.while_loop(lambda at: unvmap_any(due(at[1])), write, (buffer, first))

    if not reverse:
        return written(due, row_of, buffer, first)
    condition, row = jax.make_jaxpr(due)(first), jax.make_jaxpr(row_of)(first)

    def forward(constants, of_condition, buffer, first):
        def due(k):
            return evaluate(condition, of_condition, [k])[0]

        return written(due, lambda k: evaluate(row, constants, [k])[0], buffer, first)

    rows = jax.custom_vjp(forward)

    def kept_forward(constants, *others):
        varies = [_varies(x) for x in constants]
        constants, others = jax.tree.map(lambda x: x.value, (constants, others), is_leaf=lambda x: hasattr(x, "value"))
        buffer, stop = forward(constants, *others)
        return (buffer, stop), (constants, _as_tree(varies), others[-1], stop)

    def backward(kept, cotangents):
        constants, varies, first, stop = kept
        cotangent, _ = cotangents
        if isinstance(cotangent, jax.custom_derivatives.SymbolicZero):
            return [None] * len(constants), [None] * len(condition.consts), None, None
        changing, joined = _parted(constants, _as_flags(varies))

        def body(at):
            k, summed = at
            _, pull = jax.vjp(lambda changing: evaluate(row, joined(changing), [k])[0], changing)
            (own,) = pull(jnp.where(k < stop, cotangent[k], 0.0))
            return k + 1, [x + y for x, y in zip(summed, own, strict=True)]

        _, summed = jax.lax.while_loop(
            lambda at: unvmap_any(at[0] < stop), body, (first, [jnp.zeros_like(x) for x in changing])
        )
        return joined(summed, [None] * len(constants)), [None] * len(condition.consts), cotangent, None

    rows.defvjp(kept_forward, backward, symbolic_zeros=True)
    return rows(list(row.consts), list(condition.consts), buffer, first)


def _parted(arrays, varies):
    """Those arrays that vary, and what joins such arrays with the others, or with ``rest``."""

    def joined(changing, rest=arrays):
        remaining = iter(changing)
        return [next(remaining) if does else x for x, does in zip(rest, varies, strict=True)]

    return [x for x, does in zip(arrays, varies, strict=True) if does], joined


class _Loop:
    """The programs of a loop, of flat lists of arrays."""

    def __init__(self, goes_on: Program, step: Program, is_buffer: list[bool], max_steps: int, rows: int | None):
        self.goes_on, self.step, self.is_buffer, self.max_steps = goes_on, step, is_buffer, max_steps
        if rows is None:
            size = sum(
                aval.size * aval.dtype.itemsize for aval, no in zip(step.in_avals, is_buffer, strict=True) if not no
            )
            rows = max(ROOM // max(size, 1), math.isqrt(max_steps - 1) + 1)
        self.rows = min(rows, max_steps)

    def __call__(self, leaves: list[Array]) -> list[Array]:
        @jax.custom_vjp
        def loop(constants, conditions, leaves):
            return self.forward(constants, conditions, leaves)

        def forward(constants, conditions, leaves):
            perturbed = [_varies(x) for x in constants], [_varies(x) for x in leaves]
            constants, conditions, leaves = ([x.value for x in given] for given in (constants, conditions, leaves))
            last, kept = self.recorded(constants, conditions, leaves)
            return last, (kept, constants, _as_tree(perturbed))

        def backward(kept, cotangents):
            kept, constants, perturbed = kept
            return self.backward(kept, constants, _as_flags(perturbed), cotangents)

        loop.defvjp(forward, backward, symbolic_zeros=True)
        return loop(list(self.step.consts), list(self.goes_on.consts), leaves)

    def forward(self, constants, conditions, leaves):
        def goes_on(at):
            return evaluate(self.goes_on, conditions, at[1])[0] & (at[0] < self.max_steps)

        def step(at):
            return at[0] + 1, evaluate(self.step, constants, at[1])

        return jax.lax.while_loop(goes_on, step, (0, leaves))[1]

    def recorded(self, constants, conditions, leaves):
        def goes_on(at):
            return evaluate(self.goes_on, conditions, at[1])[0] & (at[0] < self.max_steps)

        def step(at):
            k, leaves, (every, kept) = at
            if self.rows < self.max_steps:
                full = k == every * self.rows
                kept = jax.lax.fori_loop(0, jnp.where(full, self.rows // 2, 0), _halve, kept)
                every = jnp.where(full, 2 * every, every)
                records = k % every == 0
                kept = [put(rows, k // every, row, records) for rows, row in zip(kept, _packed(self.unwritten(leaves)))]
            else:
                kept = [
                    rows.at[k].set(row) for rows, row in zip(kept, _packed(self.unwritten(leaves)), strict=True)
                ]
            return k + 1, evaluate(self.step, constants, leaves), (every, kept)

        rows = [jnp.zeros((self.rows, row.size), row.dtype) for row in _packed(self.unwritten(leaves))]
        steps, last, (every, rows) = jax.lax.while_loop(goes_on, step, (0, leaves, (1, rows)))
        return last, (steps, every, rows)

    def unwritten(self, leaves):
        return [leaf for leaf, written in zip(leaves, self.is_buffer, strict=True) if not written]

    def with_buffers(self, leaves):
        """All leaves, those of buffers zero, which no derivative depends on."""
        rest = iter(leaves)
        return [
            jnp.zeros(aval.shape, aval.dtype) if written else next(rest)
            for aval, written in zip(self.step.in_avals, self.is_buffer, strict=True)
        ]

    def backward(self, kept, constants, perturbed, cotangents):
        steps, every, rows = kept
        of_constants, of_leaves = perturbed
        of_leaves = self.lasting(of_constants, of_leaves)
        avals = self.unwritten(self.step.in_avals)
        changing = [x for x, p in zip(constants, of_constants, strict=True) if p]
        summed = [jnp.zeros_like(x) for x in changing]
        cotangents = [
            jnp.zeros(x.aval.shape, x.aval.dtype) if isinstance(x, jax.custom_derivatives.SymbolicZero) else x
            for x, p in zip(cotangents, of_leaves, strict=True)
            if p
        ]

        def pulled(leaves, cotangents, summed):
            def following(changing, moving):
                c, m = iter(changing), iter(moving)
                own = [next(c) if p else x for x, p in zip(constants, of_constants, strict=True)]
                begun = [next(m) if p else x for x, p in zip(leaves, of_leaves, strict=True)]
                new = evaluate(self.step, own, begun)
                return [x for x, p in zip(new, of_leaves, strict=True) if p]

            moving = [x for x, p in zip(leaves, of_leaves, strict=True) if p]
            _, pull = jax.vjp(following, changing, moving)
            own, cotangents = pull(cotangents)
            return cotangents, [x + y for x, y in zip(summed, own, strict=True)]

        def at(rows, k):
            return self.with_buffers(_unpacked([row[k] for row in rows], avals))

        def back(rows):
            def body(at_step):
                k, cotangents, summed = at_step
                cotangents, summed = pulled(at(rows, k - 1), cotangents, summed)
                return k - 1, cotangents, summed

            return body

        if self.rows == self.max_steps:
            _, cotangents, summed = jax.lax.while_loop(lambda s: s[0] > 0, back(rows), (steps, cotangents, summed))
        else:
            between = -(-self.max_steps // (self.rows // 2))
            fine = [jnp.zeros((between, row.shape[1]), row.dtype) for row in rows]

            def segment(at_segment):
                end, cotangents, summed, fine = at_segment
                first = (end - 1) // every * every
                leaves = at(rows, first // every)

                def again(at_step):
                    k, leaves, fine = at_step
                    fine = [f.at[k].set(row) for f, row in zip(fine, _packed(self.unwritten(leaves)), strict=True)]
                    return k + 1, self.with_buffers(self.unwritten(evaluate(self.step, constants, leaves))), fine

                count = end - first
                fine = [f.at[0].set(r[first // every]) for f, r in zip(fine, rows, strict=True)]
                _, leaves, fine = jax.lax.while_loop(lambda s: s[0] < count - 1, again, (0, leaves, fine))
                fine = [f.at[count - 1].set(row) for f, row in zip(fine, _packed(self.unwritten(leaves)), strict=True)]
                _, cotangents, summed = jax.lax.while_loop(lambda s: s[0] > 0, back(fine), (count, cotangents, summed))
                return first, cotangents, summed, fine

            _, cotangents, summed, _ = jax.lax.while_loop(
                lambda s: s[0] > 0, segment, (steps, cotangents, summed, fine)
            )
        summed, cotangents = iter(summed), iter(cotangents)
        return (
            [next(summed) if p else None for p in of_constants],
            [None] * len(self.goes_on.consts),
            [next(cotangents) if p else None for p in of_leaves],
        )

    def lasting(self, of_constants, of_leaves):
        """Which leaves depend on what is differentiated, at the start or after any number of steps."""
        while True:
            new = [x or y for x, y in zip(of_leaves, varying(self.step, of_constants, of_leaves), strict=True)]
            if new == of_leaves:
                return new
            of_leaves = new


def _halve(j, rows):
    return [x.at[j].set(x[2 * j]) for x in rows]


def _varies(x):
    return x.perturbed and jnp.issubdtype(x.value.dtype, jnp.inexact)


def _as_tree(perturbed):
    return jax.tree.map(lambda p: () if p else None, perturbed)


def _as_flags(tree):
    return jax.tree.map(lambda x: x is not None, tree, is_leaf=lambda x: x is None or x == ())


def _packed(leaves: list[Array]) -> list[Array]:
    """One array for each type of number."""
    kinds = sorted({leaf.dtype for leaf in leaves}, key=str)
    return [jnp.concatenate([jnp.ravel(leaf) for leaf in leaves if leaf.dtype == kind]) for kind in kinds]


def _unpacked(packed: list[Array], avals: list[Any]) -> list[Array]:
    kinds = sorted({aval.dtype for aval in avals}, key=str)
    places, rows = dict.fromkeys(kinds, 0), dict(zip(kinds, packed, strict=True))
    leaves = []
    for aval in avals:
        start = places[aval.dtype]
        places[aval.dtype] = start + aval.size
        leaves.append(jax.lax.slice(rows[aval.dtype], (start,), (start + aval.size,)).reshape(aval.shape))
    return leaves
