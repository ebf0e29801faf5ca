"""A StableHLO module as plain data, with what the compiler needs: the uses of each value, and the last use."""

import re
from collections.abc import Callable, Container, Iterator, Sequence
from typing import Any

import numpy as np

from ....interface.compat import stablehlo_bindings, stablehlo_passes
from .elements import UnsupportedError, dtype_named, part_of

ir, stablehlo = stablehlo_bindings()

_OF_STABLEHLO: dict[str, Callable[[Any], Any]] = {
    "comparison_direction": lambda attribute: stablehlo.ComparisonDirectionAttr(attribute).value,
    "compare_type": lambda attribute: stablehlo.ComparisonTypeAttr(attribute).value,
    "dimension_numbers": stablehlo.GatherDimensionNumbers,
    "scatter_dimension_numbers": stablehlo.ScatterDimensionNumbers,
    "dot_dimension_numbers": stablehlo.DotDimensionNumbers,
}


class Value:
    """An array that an operation makes or a block is given.

    - ``reads``: how often operations have it as an operand, those within regions included.
    - ``captured``: whether an operation within a region of its own block reads it.
    """

    __slots__ = ("block", "captured", "dtype", "reads", "shape")

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, block: "Block"):
        self.shape, self.dtype, self.block = shape, dtype, block
        self.reads, self.captured = 0, False

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))


class Operation:
    """An operation: a name, operands, results, attributes, and regions of one block each.

    - ``reads``: the values that it and the operations in its regions read, each with how often.
    - ``last``: those that nothing reads after it.
    """

    __slots__ = ("_attributes", "_read", "_text", "last", "name", "operands", "reads", "regions", "results")

    def __init__(self, name: str, source: Any, operands: list[Value]):
        self.name = name
        self._attributes, self._text = source.attributes, source.__str__
        self._read: dict[str, Any] = {}
        self.operands = operands
        self.results: list[Value] = []
        self.regions: list[Block] = []
        self.reads: dict[Value, int] = {}
        for value in operands:
            self.reads[value] = self.reads.get(value, 0) + 1
        self.last: list[Value] = []

    @property
    def short_name(self) -> str:
        """The name without the dialect."""
        return self.name.partition(".")[2]

    def has(self, name: str) -> bool:
        return name in self._attributes

    def attribute(self, name: str) -> Any:
        """Returns an attribute: a number, a text, a list of integers, a dictionary, an array of NumPy, or
        StableHLO's.
        """
        if name not in self._read:
            self._read[name] = self._attribute(name)
        return self._read[name]

    def _attribute(self, name: str) -> Any:
        attribute = self._attributes[name]
        kind = type(attribute).__name__
        if kind in ("IntegerAttr", "BoolAttr", "StringAttr", "FlatSymbolRefAttr", "FloatAttr"):
            return attribute.value
        if kind in ("DenseI64ArrayAttr", "DenseBoolArrayAttr"):
            return list(attribute)
        if kind == "DictAttr":
            return {item.name: item.attr.value for item in attribute}
        if kind in ("DenseIntElementsAttr", "DenseElementsAttr"):
            return np.array(attribute)
        return _OF_STABLEHLO[name](attribute)

    def has_effects(self) -> bool:
        """Returns whether it does more than to make its results, or something within it does."""
        acts_itself = not self.results or (self.has("has_side_effect") and self.attribute("has_side_effect"))
        return acts_itself or any(inner.has_effects() for region in self.regions for inner in region.operations)

    def constant(self) -> np.ndarray:
        """Returns the array of a ``stablehlo.constant``, which views one number where all are equal."""
        if "value" not in self._read:
            self._read["value"] = self._constant()
        return self._read["value"]

    def _constant(self) -> np.ndarray:
        shape, dtype = self.results[0].shape, self.results[0].dtype
        if dtype.kind == "c":  # whose attributes the bindings do not read
            return _complex_constant(self._text(), shape, dtype)
        attribute = self._attributes["value"]
        if attribute.is_splat:
            number = np.asarray(attribute.get_splat_value().value)
            return np.broadcast_to(number.astype(dtype), shape)
        if dtype.kind == "b":
            return np.array([bool(attribute[k]) for k in range(len(attribute))]).reshape(shape)
        return np.array(attribute).astype(dtype, copy=False).reshape(shape)


class Block:
    """A function's body, or an operation's region: ``operations`` make ``results`` of ``arguments``."""

    __slots__ = ("arguments", "operations", "results")

    def __init__(self) -> None:
        self.arguments: list[Value] = []
        self.operations: list[Operation] = []
        self.results: list[Value] = []

    def reads(self) -> dict[Value, int]:
        """Returns the values of blocks around this one that it reads, with how often."""
        return {value: times for value, times in self.reads_within().items() if value.block is not self}

    def reads_within(self) -> dict[Value, int]:
        """Returns all values that it reads, its own too, with how often."""
        reads: dict[Value, int] = {}
        for value in self.results:
            reads[value] = reads.get(value, 0) + 1
        for operation in self.operations:
            _add(reads, operation.reads)
        return reads

    def makers(self) -> dict[Value, Operation]:
        """Returns the operation that makes each value."""
        return {result: operation for operation in self.operations for result in operation.results}

    def every_operation(self) -> Iterator[Operation]:
        """Yields the operations, and the operations within them."""
        for operation in self.operations:
            yield operation
            for region in operation.regions:
                yield from region.every_operation()


def _add(reads: dict[Value, int], others: dict[Value, int]) -> None:
    for value, times in others.items():
        reads[value] = reads.get(value, 0) + times


def functions_of(module: Any, known: Container[str]) -> dict[str, Block]:
    """Returns the functions of a module by name; the program's own is ``main``.

    - ``known``: names of operations; where a module has others that consist of simpler ones, it is changed so that
      these stand in their places.

    **Raises:** ``UnsupportedError`` for anything that is not an operation on arrays.
    """
    try:
        return _read(module, known)
    except _ComposedError:
        _write_out(module)
        return _read(module, known)


def _read(module: Any, operation_names: Container[str]) -> dict[str, Block]:
    functions, reader = {}, _Reader(operation_names)
    for function in module.body.operations:
        operation = function.operation
        if operation.name == "sdy.mesh":  # of devices: there is one
            continue
        if operation.name != "func.func":
            raise UnsupportedError(operation.name)
        functions[operation.attributes["sym_name"].value] = reader.block(operation.regions[0].blocks[0])
    return functions


class _ComposedError(Exception):
    """An operation that consists of simpler ones."""


_COMPOSED = ("chlo.", "stablehlo.composite")
_WRITTEN_OUT = "builtin.module(func.func(stablehlo-legalize-composite-to-call,chlo-legalize-to-stablehlo))"


def _write_out(module: Any) -> None:
    """Replaces special functions, the largest k, and composites by what StableHLO says they consist of."""
    with module.context:
        stablehlo_passes().parse(_WRITTEN_OUT).run(module.operation)


class _Reader:
    """Reads blocks of a module, each value and each type of values once."""

    def __init__(self, known: Container[str]) -> None:
        self._known = known
        self._values: dict[Any, Value] = {}
        self._types: dict[Any, tuple[tuple[int, ...], np.dtype]] = {}

    def block(self, source: Any) -> Block:
        block, values = Block(), self._values
        for argument in source.arguments:
            values[argument] = self._value(argument.type, block)
            block.arguments.append(values[argument])
        for view in source.operations:
            operation = view.operation
            operands = [values[operand] for operand in operation.operands]
            name = operation.name
            if name in ("func.return", "stablehlo.return"):
                block.results = operands
                break
            if name.startswith(_COMPOSED) and name not in self._known:
                raise _ComposedError(name)
            node = Operation(name, operation, operands)
            for result in operation.results:
                values[result] = value = self._value(result.type, block)
                node.results.append(value)
            for region in operation.regions:
                if len(region.blocks) != 1:
                    raise UnsupportedError(f"{name} of several blocks")
                # A region sees the values around it, so an operation reads what its regions read.
                inner = self.block(region.blocks[0])
                node.regions.append(inner)
                _add(node.reads, inner.reads())
            block.operations.append(node)
        # Derivatives leave much that nothing reads. It must go before reads are counted, or it would count as read.
        _drop_unread(block)
        _count(block)
        return block

    def _value(self, type: Any, block: Block) -> Value:
        if type not in self._types:
            self._types[type] = _shape_and_type(type)
        return Value(*self._types[type], block)


def _shape_and_type(type: Any) -> tuple[tuple[int, ...], np.dtype]:
    try:
        tensor = ir.RankedTensorType(type)
    except ValueError:  # as the order of effects
        raise UnsupportedError(f"A value of type {type}") from None
    shape = tuple(tensor.shape)
    if any(length < 0 for length in shape):
        raise UnsupportedError("an array whose shape is not known")
    return shape, dtype_named(str(tensor.element_type))


def _drop_unread(block: Block) -> None:
    """Leaves out pure operations whose results are not used."""
    read, operations = set(block.results), []
    for operation in reversed(block.operations):
        if any(result in read for result in operation.results) or operation.has_effects():
            operations.append(operation)
            read.update(operation.reads)
    block.operations = operations[::-1]


def _count(block: Block) -> None:
    """Notes, of the values of a block, how often each is read, and by whom last."""
    # A result of the block is read by whoever wrote the block, after all of its operations.
    remaining = set(block.results)
    for operation in reversed(block.operations):
        for value, times in operation.reads.items():
            if value.block is not block:
                continue
            value.reads += times
            value.captured |= value not in operation.operands or times > operation.operands.count(value)
            if value not in remaining:
                remaining.add(value)
                _note_last(operation, value)
    for value in block.results:
        if value.block is block:
            value.reads += 1


def _note_last(operation: Operation, value: Value) -> None:
    """Notes that nothing reads a value after an operation; within a branch, nothing after the last that reads it."""
    operation.last.append(value)
    if operation.name not in ("stablehlo.case", "stablehlo.if"):
        return
    for region in operation.regions:
        # Of a loop's body this would be wrong, because the next turn reads the value again.
        readers = (inner for inner in reversed(region.operations) if value in inner.reads)
        reader = next(readers, None)
        if reader is not None and value not in region.results:
            _note_last(reader, value)


_NUMBER = r"(-?[^\s,()\[\]]+)"


def _complex_constant(text: str, shape: Sequence[int], dtype: np.dtype) -> np.ndarray:
    part = part_of(dtype)
    within = text[text.index("dense<") + 6 : text.rindex("> :")]
    if within.startswith('"'):  # of all bytes
        numbers = np.frombuffer(bytes.fromhex(within.strip('"')[2:]), dtype)
    else:
        pairs = re.findall(rf"\({_NUMBER}\s*,\s*{_NUMBER}\)", within)
        numbers = np.empty(len(pairs), dtype)
        numbers.real = [_number(real, part) for real, _ in pairs]
        numbers.imag = [_number(imaginary, part) for _, imaginary in pairs]
    return np.broadcast_to(numbers[0], shape) if len(numbers) == 1 else numbers.reshape(shape)


def _number(text: str, dtype: np.dtype) -> Any:
    if text.startswith("0x"):
        return np.array(int(text, 16), f"u{dtype.itemsize}").view(dtype)[()]
    return dtype.type(text)
