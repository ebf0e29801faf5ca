"""Functions of small arrays, compiled for many lanes side by side."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .elements import as_objects, evaluated
from .nodes import Graph, Node, in_order, is_node

Numbers = list[Any]  # arrays of the shape of the lanes, or scalars that all lanes share, one an element


class LaneProgram:
    """A function of parameters and of what changes, on elements whose axes are those of the lanes.

    ``prepare`` computes what depends on the parameters alone, once; a call then computes the function. Elements are
    those of one array after the other, each in C order, and those that all lanes share may be scalars.

    - ``function(parameters, *changing)``: on PyTrees of small arrays, with arrays of the same shapes for result.
    """

    def __init__(self, function: Callable[..., Any], parameters: Any, *changing: Any):
        program = jax.make_jaxpr(function)(parameters, *changing)
        graph, count = Graph(), len(jax.tree.leaves(parameters))
        inputs = [_inputs(graph, aval, k >= count) for k, aval in enumerate(program.in_avals)]
        flat = [x.reshape(-1).tolist() for x in inputs]
        self._parameters = [node for x in flat[:count] for node in x]
        self._changing = [node for x in flat[count:] for node in x]
        self._outputs = [item for x in evaluated(graph, program, inputs) for item in as_objects(x).reshape(-1)]
        changes = [node for node in in_order(self._outputs) if node.changing]
        used = [*self._outputs, *(item for node in changes for item in node.operands)]
        self._prepared = list(dict.fromkeys(item for item in used if is_node(item) and not item.changing))

    def prepare(self, parameters: Numbers) -> Numbers:
        """What calls need of the parameters; scalars where no lane has numbers of its own."""
        return _run(self._prepared, self._parameters, parameters)

    def __call__(self, prepared: Numbers, changing: Numbers) -> Array:
        """The elements of the function's results along the first axis of one array."""
        found = _run(self._outputs, [*self._prepared, *self._changing], [*prepared, *changing])
        shape = np.broadcast_shapes(*(jnp.shape(item) for item in [*changing, *prepared]))
        return jnp.stack([jnp.broadcast_to(item, shape) for item in found])


def elements_of(*arrays: Any) -> Numbers:
    """The elements of arrays whose last axis is that of the lanes."""
    return [item for x in arrays for item in x.reshape(-1, x.shape[-1])]


def _inputs(graph: Graph, aval: Any, changing: bool) -> np.ndarray:
    found = np.empty(aval.shape, dtype=object)
    for index in np.ndindex(*aval.shape):
        found[index] = graph.input(aval.dtype, changing)
    return found


def _run(wanted: Sequence[Any], inputs: Sequence[Node], values: Numbers) -> Numbers:
    found: dict[Node, Any] = dict(zip(inputs, values, strict=True))
    for node in in_order(wanted, frozenset(inputs)):
        assert node.act is not None
        operands = [found[item] if is_node(item) else item for item in node.operands]
        if not isinstance(operands[0], tuple):
            shape = np.broadcast_shapes(*(jnp.shape(item) for item in operands))
            operands = [_spread(item, shape) for item in operands]
        found[node] = node.act(*operands)
    return [found[item] if is_node(item) else jnp.asarray(item) for item in wanted]


def _spread(value: Any, shape: tuple[int, ...]) -> Any:
    return value if jnp.shape(value) == shape else jnp.broadcast_to(jnp.asarray(value), shape)
