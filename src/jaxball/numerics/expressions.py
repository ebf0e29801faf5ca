"""Expressions of numbers as a graph of operations, in which equal operations on equal operands are one node."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..compat import primitives

COMMUTATIVE = frozenset({"add", "mul", "max", "min", "and", "or", "eq", "ne"})


class Elementwise(NamedTuple):
    """An elementwise primitive of JAX with its parameters, to be called on arrays of one shape."""

    primitive: Any
    params: Mapping[str, Any]

    def __call__(self, *operands: Any) -> Any:
        return self.primitive.bind(*operands, **self.params)


@dataclasses.dataclass(frozen=True, eq=False)
class Node:
    """A number that is known when a program runs: an operation and what it acts on.

    - ``operation``: what computes it, from operands of one shape; None for an input.
    - ``operands``: nodes, and NumPy scalars where a number is known already.
    """

    operation: Callable[..., Any] | None
    operands: tuple[Any, ...]
    dtype: np.dtype


def is_node(value: Any) -> bool:
    """Whether a number is known only when the program runs."""
    return isinstance(value, Node)


class Graph:
    """The nodes of one program. The same operation on the same operands is the same node."""

    def __init__(self):
        self._nodes: dict[Any, Node] = {}

    def operation(
        self, primitive: Any, params: Mapping[str, Any], operands: Sequence[Any], dtype: np.dtype
    ) -> Node | np.generic:
        """The number that an elementwise primitive makes of numbers."""
        name = primitive.name
        if not any(is_node(item) for item in operands):
            return _folded(primitive, params, operands)
        if name == "integer_pow" and params["y"] == 2:
            return self.operation(primitives.mul_p, {}, (operands[0], operands[0]), dtype)
        simpler = _simplified(name, operands, dtype)
        if simpler is not None:
            return simpler
        keys = [id(item) if is_node(item) else (item.dtype.name, item.item()) for item in operands]
        if name in COMMUTATIVE:
            keys.sort(key=str)
        key = (name, tuple(keys), *sorted((k, str(v)) for k, v in params.items()))
        return self.node(key, Elementwise(primitive, params), operands, dtype)

    def node(self, key: Any, operation: Callable[..., Any], operands: Sequence[Any], dtype: np.dtype) -> Node:
        """The node that ``key`` names, made if there is none."""
        if key not in self._nodes:
            self._nodes[key] = Node(operation, tuple(operands), dtype)
        return self._nodes[key]


def _folded(primitive: Any, params: Mapping[str, Any], operands: Sequence[Any]) -> np.generic:
    """The result of an operation on constants."""
    with jax.ensure_compile_time_eval():
        result = np.asarray(primitive.bind(*(jnp.asarray(item) for item in operands), **params))
    return result.dtype.type(result.item())


def _simplified(name: str, operands: Sequence[Any], dtype: np.dtype) -> Any:
    """The result of a trivial operation, or None. A product with a known zero is zero."""
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
    if name in ("copy", "copy_p") or (name == "convert_element_type" and operands[0].dtype == dtype):
        return operands[0]
    return None


def in_order(results: Iterable[Any], stop_at: frozenset[Node] = frozenset()) -> Iterator[Node]:
    """The nodes that ``results`` need, each after those that it needs itself, not beyond ``stop_at``."""
    seen = set(stop_at)
    for root in results:
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
