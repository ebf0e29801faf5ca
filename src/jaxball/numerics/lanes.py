"""Functions of small arrays, compiled for many lanes side by side."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .elements import as_objects, evaluated, inputs
from .expressions import Graph, Node, in_order, is_node
from .pieces import pieces, separately

Numbers = list[Any]  # arrays of the shape of the lanes, or scalars that all lanes share, one an element


class LaneProgram:
    """A function of parameters and of changing arguments, on elements whose axes are those of the lanes.

    ``prepare`` computes once what depends only on the parameters; a call then computes the function. Elements are those
    of the arrays in sequence, each in C order, and those that all lanes share may be scalars.

    - ``function(parameters, *changing)``: on PyTrees of small arrays, with arrays of the same shapes as result.
    """

    def __init__(self, function: Callable[..., Any], parameters: Any, *changing: Any):
        program = jax.make_jaxpr(function)(parameters, *changing)
        given, count = [inputs(aval) for aval in program.in_avals], len(jax.tree.leaves(parameters))
        flat = [x.reshape(-1).tolist() for x in given]
        self._parameters = [node for x in flat[:count] for node in x]
        self._changing = [node for x in flat[count:] for node in x]
        self._outputs = [item for x in evaluated(Graph(), program, given) for item in as_objects(x).reshape(-1)]
        changes, used = set(self._changing), list(self._outputs)
        for node in in_order(self._outputs):
            if not changes.isdisjoint(node.operands):
                changes.add(node)
                used += node.operands
        self._prepared = list(dict.fromkeys(item for item in used if is_node(item) and item not in changes))

    def prepare(self, parameters: Numbers) -> Numbers:
        """What calls need of the parameters; scalars where no lane has numbers of its own."""
        return _run(self._prepared, self._parameters, parameters)

    def __call__(self, prepared: Numbers, changing: Numbers) -> Array:
        """The elements of the function's results along the first axis of one array."""
        results = _run(self._outputs, [*self._prepared, *self._changing], [*prepared, *changing])
        shape = np.broadcast_shapes(*(jnp.shape(item) for item in [*changing, *prepared]))
        return jnp.stack([jnp.broadcast_to(item, shape) for item in results])


def elements_of(*arrays: Any) -> Numbers:
    """The elements of arrays whose last axis is that of the lanes."""
    return [item for x in arrays for item in x.reshape(-1, x.shape[-1])]


def _run(results: Sequence[Any], inputs: Sequence[Node], given: Numbers) -> Numbers:
    values: dict[Node, Any] = dict(zip(inputs, given, strict=True))
    separate = pieces(results, inputs)
    for node in in_order(results, frozenset(inputs)):
        assert node.operation is not None
        operands = [values[item] if is_node(item) else item for item in node.operands]
        if not isinstance(operands[0], tuple):
            shape = np.broadcast_shapes(*(jnp.shape(item) for item in operands))
            operands = [_spread(item, shape) for item in operands]
        value = node.operation(*operands)
        values[node] = separately(value) if node in separate and value.ndim else value
    return [values[item] if is_node(item) else jnp.asarray(item) for item in results]


def _spread(value: Any, shape: tuple[int, ...]) -> Any:
    return value if jnp.shape(value) == shape else jnp.broadcast_to(jnp.asarray(value), shape)
