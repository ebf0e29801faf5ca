"""Operations on single numbers, each of them written down once."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

COMMUTATIVE = frozenset({"add", "mul", "max", "min", "and", "or", "eq", "ne"})


@dataclasses.dataclass(frozen=True, eq=False)
class Node:
    """A number that is known when a program runs: an operation and what it acts on.

    - ``act``: what computes it, from operands that have all the shape of the lanes; None for an input.
    - ``operands``: nodes, and NumPy scalars where a number is known already.
    - ``changing``: whether it depends on something other than parameters.
    """

    act: Callable[..., Any] | None
    operands: tuple[Any, ...]
    dtype: np.dtype
    changing: bool


def is_node(value: Any) -> bool:
    """Whether a number is known only when the program runs."""
    return isinstance(value, Node)


class Graph:
    """The nodes of one program. The same operation on the same operands is the same node."""

    def __init__(self):
        self._nodes: dict[Any, Node] = {}

    def input(self, dtype: np.dtype, changing: bool) -> Node:
        """A new input."""
        return Node(None, (), dtype, changing)

    def operation(
        self, primitive: Any, params: Mapping[str, Any], operands: Sequence[Any], dtype: np.dtype
    ) -> Node | np.generic:
        """The number that an elementwise primitive makes of numbers."""
        name = primitive.name
        if not any(is_node(item) for item in operands):
            return _now(primitive, params, operands)
        if name == "integer_pow" and params["y"] == 2:
            return self.operation(lax.mul_p, {}, (operands[0], operands[0]), dtype)
        simpler = _simpler(name, operands)
        if simpler is not None:
            return simpler
        keys = [id(item) if is_node(item) else (item.dtype.name, item.item()) for item in operands]
        if name in COMMUTATIVE:
            keys.sort(key=str)
        key = (name, tuple(keys), *sorted((k, str(v)) for k, v in params.items()))
        return self.node(key, lambda *x: primitive.bind(*x, **params), operands, dtype)

    def node(self, key: Any, act: Callable[..., Any], operands: Sequence[Any], dtype: np.dtype) -> Node:
        """The node that ``key`` names, made if there is none."""
        if key not in self._nodes:
            changing = any(item.changing for item in operands if is_node(item))
            self._nodes[key] = Node(act, tuple(operands), dtype, changing)
        return self._nodes[key]


def _now(primitive: Any, params: Mapping[str, Any], operands: Sequence[Any]) -> np.generic:
    with jax.ensure_compile_time_eval():
        found = np.asarray(primitive.bind(*(jnp.asarray(item) for item in operands), **params))
    return found.dtype.type(found.item())


def _simpler(name: str, operands: Sequence[Any]) -> Any:
    """The result of an operation that is none, or None. A product with a zero that is known is zero."""
    known = [None if is_node(item) else item for item in operands]
    if name in ("add", "add_any", "mul"):
        neutral = 1 if name == "mul" else 0
        for item, other in ((known[0], operands[1]), (known[1], operands[0])):
            if item is not None and item == neutral:
                return other
            if item is not None and item == 0:
                return item
    if name in ("sub", "div") and known[1] is not None and known[1] == (name == "div"):
        return operands[0]
    if name == "select_n" and known[0] is not None:
        return operands[1 + int(known[0])]
    if name in ("copy", "copy_p"):
        return operands[0]
    return None


def in_order(wanted: Iterable[Any], stop_at: frozenset[Node] = frozenset()) -> Iterator[Node]:
    """The nodes that ``wanted`` need, each after those that it needs itself; ``stop_at`` are not looked into."""
    seen = set(stop_at)
    for root in wanted:
        stack = [root] if is_node(root) else []
        while stack:
            node = stack[-1]
            if node in seen:
                stack.pop()
                continue
            missing = [item for item in node.operands if is_node(item) and item not in seen]
            if missing:
                stack.extend(reversed(missing))
                continue
            seen.add(node)
            stack.pop()
            yield node
