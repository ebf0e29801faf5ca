"""Programs on elements in pieces that XLA's CPU compiler makes one loop each, so that nothing is computed twice.

It puts elementwise operations into loops over the lanes, each with one result, and recomputes a number that several of
these loops need in each of them: ten times the work, in a program as long as equations of motion. So shared values are
made the results of separate loops, unless recomputing them is cheaper.
"""

from collections.abc import Sequence, Set
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .expressions import Elementwise, Node, in_order, is_node

# What XLA considers cheap, and recomputes where several loops need it; other operations it never duplicates.
# fmt: off
CHEAP = frozenset({
    "abs", "add", "add_any", "and", "ceil", "clamp", "convert_element_type", "copy", "copy_p", "eq", "floor", "ge",
    "gt", "is_finite", "le", "lt", "max", "min", "mul", "ne", "neg", "not", "or", "round", "select_n", "sign", "square",
    "stop_gradient", "sub", "xor",
})
# fmt: on
# How many operations done again cost as much as a loop: 4 to 16 gave the fastest equations of motion.
LOOP = 8


def separately(x: Array) -> Array:
    """The same array, on a CPU as the result of a loop of its own; only the sign of a zero may change.

    A sum over an axis is computed in one place. XLA has a barrier of its own, but removes it before it makes loops.
    """
    if jax.default_backend() != "cpu":
        return x
    nothing = jnp.zeros((), x.dtype)
    padded = jax.lax.pad(x[None], nothing, [(0, 1, 0), *((0, 0, 0) for _ in x.shape)])
    return jnp.sum(padded, axis=0).astype(x.dtype)


def pieces(results: Sequence[Any], inputs: Sequence[Node]) -> frozenset[Node]:
    """The nodes of a program to compute separately: results, and values that several of these need."""
    order = list(in_order(results, frozenset(inputs)))
    chosen = {item for item in results if is_node(item) and isinstance(item.operation, Elementwise)}
    uses: dict[Node, list[Node]] = {node: [] for node in order}
    for node in order:
        for operand in filter(is_node, node.operands):
            if operand in uses:
                uses[operand].append(node)
    known = chosen.union(inputs)
    for node in order:
        again = len(uses[node]) - 1
        shared = again > 0 and isinstance(node.operation, Elementwise)
        if shared and (_expensive(node) or again * _operations(node, known) >= LOOP):
            known.add(node)
    # A value needed by only one loop, however often, is computed once in it.
    loops: dict[Node, set[Node]] = {}
    for node in reversed(order):
        loops[node] = set().union(*({user} if user in known else loops[user] for user in uses[node]))
        if node not in chosen and len(loops[node]) == 1 and not _expensive(node):
            known.discard(node)
    return frozenset(known.difference(inputs))


def _expensive(node: Node) -> bool:
    return isinstance(node.operation, Elementwise) and node.operation.primitive.name not in CHEAP


def _operations(node: Node, known: Set[Node]) -> int:
    """How many operations compute a node from what is known; not counted beyond those of a loop."""
    counted, open_ones = {node}, [node]
    while open_ones and len(counted) < LOOP:
        new = {item for item in open_ones.pop().operands if is_node(item) and item not in known} - counted
        counted |= new
        open_ones += new
    return len(counted)
