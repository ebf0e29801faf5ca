"""Programs on small arrays as expressions of their elements.

A jaxpr is read operation by operation. Moving elements (stacking, slicing, transposing) then costs nothing, and
operations on known numbers (unit matrices, zero tangents) are carried out immediately.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..compat import Literal, Program, argument, branches, called, function_of, loop, primitives
from .expressions import Graph, Node
from .trigonometry import sine_cosine_p, written_out

# Arrays of NumPy scalars and nodes. Those of a dtype other than `object` are known at once.
Elements = np.ndarray

# fmt: off
ELEMENTWISE = frozenset({
    "abs", "acos", "add", "add_any", "and", "asin", "atan", "atan2", "ceil", "clamp", "convert_element_type",
    "copy", "copy_p", "cos", "cosh", "div", "eq", "erf", "exp", "exp2", "expm1", "floor", "ge", "gt",
    "integer_pow", "is_finite", "le", "log", "log1p", "logistic", "lt", "max", "min", "mul", "ne", "neg",
    "nextafter", "not", "or", "pow", "rem", "round", "rsqrt", "select_n", "sign", "sin", "sinh", "sqrt", "square",
    "stop_gradient", "sub", "tan", "tanh", "xor",
})
# fmt: on
# Functions whose derivatives follow from their operations, which may replace them.
WRITTEN_OUT: Mapping[Any, Callable[..., Any]] = {sine_cosine_p: written_out}
REDUCTIONS: Mapping[str, Any] = {
    "reduce_sum": primitives.add_p,
    "reduce_max": primitives.max_p,
    "reduce_min": primitives.min_p,
    "reduce_prod": primitives.mul_p,
    "reduce_and": primitives.and_p,
    "reduce_or": primitives.or_p,
}


def inputs(like: Any) -> Elements:
    """The elements of an array that is not known yet, of the shape and dtype of ``like``."""
    return _each(like.shape, lambda: Node(None, (), like.dtype))


def evaluated(graph: Graph, program: Program, given: Sequence[Elements]) -> list[Elements]:
    """The outputs of a program for the inputs given."""
    jaxpr = program.jaxpr
    values: dict[Any, Elements] = dict(zip(jaxpr.constvars, map(np.asarray, program.consts), strict=True))
    values |= dict(zip(jaxpr.invars, given, strict=True))

    def read(variable: Any) -> Elements:
        return np.asarray(variable.val) if isinstance(variable, Literal) else values[variable]

    for equation in jaxpr.eqns:
        results = _equation(graph, equation, [read(variable) for variable in equation.invars])
        values |= dict(zip(equation.outvars, results, strict=True))
    return [read(variable) for variable in jaxpr.outvars]


def _equation(graph: Graph, equation: Any, operands: list[Elements]) -> Sequence[Elements]:
    name = equation.primitive.name
    inner = _program_within(equation)
    if inner is not None:
        return evaluated(graph, inner, operands)
    if all(map(_known, operands)):
        return _at_once(equation, operands)
    if name in ELEMENTWISE:
        return [_elementwise(graph, equation, operands)]
    if name == "scan":
        return _unrolled(graph, equation, operands)
    if name == "cond":
        return _chosen(graph, equation, *operands)
    if name == "dot_general":
        return [_product(graph, equation, *operands)]
    if name in REDUCTIONS:
        return [_reduced(graph, REDUCTIONS[name], [int(axis) for axis in argument(equation, "axes")], operands[0])]
    if (name in MOVES and all(map(_known, operands[1:]))) or name in ("concatenate", "stack"):
        return MOVES[name](equation, operands)
    if name == "scatter" and _known(operands[1]):
        return _replaced(equation, *operands)
    return _as_arrays(graph, equation, operands)


def _program_within(equation: Any) -> Program | None:
    """The program that an equation stands for."""
    if equation.primitive in WRITTEN_OUT:
        return jax.make_jaxpr(WRITTEN_OUT[equation.primitive])(*(variable.aval for variable in equation.invars))
    return called(equation)


def _known(x: Elements) -> bool:
    """Whether all numbers are known at once; there may be none."""
    return x.dtype != object or x.size == 0


def as_objects(x: Elements) -> Elements:
    """The same elements, those that are known as NumPy scalars, which keep their dtypes."""
    return x if x.dtype == object else _each(x.shape, lambda item: item, x)


def _at_once(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    with jax.ensure_compile_time_eval():
        arrays = [
            jnp.asarray(x, variable.aval.dtype) if x.size else jnp.zeros(x.shape, variable.aval.dtype)
            for x, variable in zip(operands, equation.invars, strict=True)
        ]
        results = function_of(equation)(*arrays)
    return [np.asarray(x) for x in (results if equation.primitive.multiple_results else [results])]


def _elementwise(graph: Graph, equation: Any, operands: Sequence[Elements]) -> Elements:
    aval = equation.outvars[0].aval
    return _each(
        aval.shape,
        lambda *x: graph.operation(equation.primitive, equation.params, x, aval.dtype),
        *(np.broadcast_to(x, aval.shape) for x in operands),
    )


def _each(shape: tuple[int, ...], function: Callable[..., Any], *operands: Elements) -> Elements:
    results = np.empty(shape, dtype=object)
    for index in np.ndindex(*shape):
        results[index] = function(*(x[index] for x in operands))
    return results


def _reduced(graph: Graph, primitive: Any, axes: Sequence[int], x: Elements) -> Elements:
    rest = [axis for axis in range(x.ndim) if axis not in axes]
    rows = x.transpose([*rest, *axes]).reshape([*(x.shape[axis] for axis in rest), -1])
    results = np.empty(rows.shape[:-1], dtype=object)
    for index in np.ndindex(*results.shape):
        results[index] = functools.reduce(lambda x, y: graph.operation(primitive, {}, (x, y), x.dtype), rows[index])
    return results


def _unrolled(graph: Graph, equation: Any, operands: list[Elements]) -> list[Elements]:
    """A scan, step by step."""
    body, constants, carried, length, backwards = loop(equation)
    carry, sequences = operands[constants : constants + carried], operands[constants + carried :]
    rows = []
    for k in reversed(range(length)) if backwards else range(length):
        step = [*operands[:constants], *carry, *(np.asarray(x[k]) for x in sequences)]
        results = evaluated(graph, body, step)
        carry = results[:carried]
        rows.append(results[carried:])
    if backwards:
        rows.reverse()
    return [*carry, *(np.stack([as_objects(x) for x in column]) for column in zip(*rows, strict=True))]


def _chosen(graph: Graph, equation: Any, which: Elements, *operands: Elements) -> list[Elements]:
    """One of several programs: lanes may choose differently, so all of them are computed, and one is selected."""
    programs = branches(equation)
    if _known(which):
        return evaluated(graph, programs[int(which)], operands)
    results = zip(*(evaluated(graph, program, operands) for program in programs), strict=True)
    chosen = which.item()
    if len(programs) == 2:
        chosen = graph.operation(primitives.ne_p, {}, (chosen, np.int32(0)), np.dtype(bool))

    def select(dtype: np.dtype, *x: Any) -> Any:
        same = all(item is x[0] for item in x)
        return x[0] if same else graph.operation(primitives.select_n_p, {}, (chosen, *x), dtype)

    return [
        _each(variable.aval.shape, functools.partial(select, variable.aval.dtype), *map(as_objects, each))
        for each, variable in zip(results, equation.outvars, strict=True)
    ]


def _product(graph: Graph, equation: Any, a: Elements, b: Elements) -> Elements:
    """A product of matrices, as products and sums of elements."""
    (a_sum, b_sum), (a_batch, b_batch) = argument(equation, "dimension_numbers")
    a_rest = [axis for axis in range(a.ndim) if axis not in (*a_sum, *a_batch)]
    b_rest = [axis for axis in range(b.ndim) if axis not in (*b_sum, *b_batch)]
    shape, dtype = equation.outvars[0].aval.shape, equation.outvars[0].aval.dtype
    batch, summed = [a.shape[k] for k in a_batch], [a.shape[k] for k in a_sum]
    left, right = [a.shape[k] for k in a_rest], [b.shape[k] for k in b_rest]
    whole = [*batch, *left, *right, *summed]
    a = a.transpose([*a_batch, *a_rest, *a_sum]).reshape([*batch, *left, *(1 for _ in right), *summed])
    b = b.transpose([*b_batch, *b_rest, *b_sum]).reshape([*batch, *(1 for _ in left), *right, *summed])
    multiply = functools.partial(graph.operation, primitives.mul_p, {})
    products = _each(
        tuple(whole), lambda x, y: multiply((x, y), dtype), np.broadcast_to(a, whole), np.broadcast_to(b, whole)
    )
    return _reduced(graph, primitives.add_p, range(len(shape), len(whole)), products)


def _broadcast(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    shape, places = argument(equation, "shape"), argument(equation, "broadcast_dimensions")
    spread = [1] * len(shape)
    for place, size in zip(places, operands[0].shape, strict=True):
        spread[place] = size
    return [np.broadcast_to(operands[0].reshape(spread), shape)]


def _sliced(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    strides = argument(equation, "strides") or [1] * operands[0].ndim
    places = zip(argument(equation, "start_indices"), argument(equation, "limit_indices"), strides, strict=True)
    return [operands[0][tuple(slice(*place) for place in places)]]


def _reshaped(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    return [operands[0].reshape(equation.outvars[0].aval.shape)]


def _split(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    ends = list(itertools.accumulate(argument(equation, "sizes")))
    return np.split(operands[0], ends[:-1], axis=argument(equation, "axis"))


def _concatenated(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    return [np.concatenate([as_objects(x) for x in operands], axis=argument(equation, "dimension"))]


def _stacked(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    return [np.stack([as_objects(x) for x in operands], axis=argument(equation, "axis"))]


def _picked(equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    """What moves elements to places known at once, found by moving their numbers."""
    x = operands[0]
    numbers = np.arange(x.size).reshape(x.shape)
    with jax.ensure_compile_time_eval():
        places = equation.primitive.bind(jnp.asarray(numbers), *map(jnp.asarray, operands[1:]), **equation.params)
    # A place outside an array, which some programs fill with NaN, is never asked for by the indices that are known.
    assert np.all((np.asarray(places) >= 0) & (np.asarray(places) < x.size))
    return [x.reshape(-1)[np.asarray(places)]]


def _replaced(equation: Any, x: Elements, indices: Elements, updates: Elements) -> list[Elements]:
    """An array in which elements at places known at once are others, found by moving their numbers."""
    both = np.concatenate([as_objects(x).reshape(-1), as_objects(updates).reshape(-1)])
    old, new = np.split(np.arange(both.size), [x.size])
    arrays = old.reshape(x.shape), indices, new.reshape(updates.shape)
    with jax.ensure_compile_time_eval():
        places = equation.primitive.bind(*map(jnp.asarray, arrays), **equation.params)
    return [both[np.asarray(places)]]


MOVES: Mapping[str, Callable[[Any, Sequence[Elements]], Sequence[Elements]]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": _concatenated,
    "dynamic_slice": _picked,
    "expand_dims": _reshaped,
    "gather": _picked,
    "reshape": _reshaped,
    "rev": lambda equation, operands: [np.flip(operands[0], argument(equation, "dimensions"))],
    "slice": _sliced,
    "split": _split,
    "squeeze": _reshaped,
    "stack": _stacked,
    "transpose": lambda equation, operands: [operands[0].transpose(argument(equation, "permutation"))],
}


def _as_arrays(graph: Graph, equation: Any, operands: Sequence[Elements]) -> list[Elements]:
    """Any other operation, on arrays, with the lanes as batch."""
    shapes = [x.shape for x in operands]
    dtypes = [variable.aval.dtype for variable in equation.invars]
    ends = np.cumsum([x.size for x in operands]).tolist()

    def whole(*numbers):
        lanes = numbers[0].shape
        arrays = [
            jnp.stack(numbers[end - math.prod(shape) : end], axis=-1).reshape(*lanes, *shape)
            if math.prod(shape)
            else jnp.zeros((*lanes, *shape), dtype)
            for end, shape, dtype in zip(ends, shapes, dtypes, strict=True)
        ]
        results = functools.reduce(lambda f, _: jax.vmap(f), lanes, function_of(equation))(*arrays)
        return tuple(results) if equation.primitive.multiple_results else (results,)

    flat = [item for x in operands for item in as_objects(x).reshape(-1)]
    call = graph.node(object(), whole, flat, np.dtype(object))
    parts = []
    for k, variable in enumerate(equation.outvars):
        part = np.empty(variable.aval.shape, dtype=object)
        for index in np.ndindex(*part.shape):
            entry = functools.partial(_entry, k, index)
            part[index] = graph.node((call, k, index), entry, (call,), variable.aval.dtype)
        parts.append(part)
    return parts


def _entry(k: int, index: tuple[int, ...], arrays: tuple[jax.Array, ...]) -> jax.Array:
    return arrays[k][(..., *index)]
