"""Functions of LLVM IR, and how arrays are passed to them and back.

Those of a program that are not inlined are written once, and called; the main one reads its arguments and writes its
results where it is told. Small arrays are passed on in registers, as they are to a loop's next turn and from branches,
whose rules ask here; larger ones in memory.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ir.elements import Element, Vector, vector_type
from ..ir.program import Block, Value
from ..limits import ALIGNMENT, LANES
from .buffers import Buffer
from .builder import Builder
from .instructions import BOOL
from .lowering import Compiler, Function
from .storage import join_parts, parts, parts_of
from .values import Array, Memory, Registers, registers, size_of
from .vectors import are_handed_on, in_vectors, number_of_vectors, one_by_one


class Passing:
    """How an array is passed on: number by number, the parts of complex ones apart, or in vectors along its first axis.

    - ``varying``: whether each lane of a loop has an array of its own; then each number is a vector.
    - ``stacked``: whether it is in vectors along its first axis, which otherwise would be taken apart and made again.
    - ``kinds``: the types of the registers, and whether they are vectors.
    """

    def __init__(self, function: Function, shape: tuple[int, ...], dtype: np.dtype, varying: bool = False):
        self.function, self.shape, self.dtype, self.varying = function, shape, dtype, varying
        self.stacked = function.uses_vectors and are_handed_on(shape, dtype)
        self.kinds = [(kind, varying) for kind in parts_of(dtype, size_of(shape))]
        # Phis of single numbers would make LLVM take the vectors apart in every turn.
        if self.stacked:
            self.kinds = [(dtype, True)] * number_of_vectors(shape)

    def within(self, function: Function) -> "Passing":
        """Returns the same for another function, one that is called, where the numbers that it reads and returns are
        written.
        """
        other = copy.copy(self)
        other.function = function
        return other

    def split(self, array: Array) -> list[Element]:
        """Returns the numbers of the registers. Where lanes have each their own, a single one may stand for all."""
        flat = list(self.function.storage.to_registers(array).objects().reshape(-1))
        if self.stacked:
            return in_vectors(self.function.builder, self.dtype, self.shape, flat)
        return [number for _, number in parts([self.dtype] * len(flat), flat)]

    def spread(self, array: Array) -> list[Element]:
        """Returns the numbers of the registers, each a vector where lanes have each their own."""
        spread, numbers = self.function.builder.spread, self.split(array)
        return [spread(kind, x) if wide else x for (kind, wide), x in zip(self.kinds, numbers, strict=True)]

    def join(self, numbers: Sequence[Element]) -> Registers:
        """Returns the array of these numbers."""
        if self.stacked:
            numbers = one_by_one(self.function.builder, self.dtype, self.shape, numbers)
        return registers(self.dtype, join_parts([self.dtype] * size_of(self.shape), numbers), self.shape)


class _Form(NamedTuple):
    """How an argument or a result is handed over.

    - ``varying``: whether lanes have each their own.
    - ``passing``: how it is passed in registers; None where it is passed by its address.
    """

    varying: bool
    passing: Passing | None

    @property
    def kinds(self) -> list[tuple[np.dtype, bool]]:
        """The types of the registers, and whether they are vectors."""
        return self.passing.kinds if self.passing else []


def _with_type(builder: Builder, kind: tuple[np.dtype, bool], number: Element) -> str:
    dtype, wide = kind
    return f"{vector_type(dtype, LANES * wide)} {builder.operand(dtype, number, LANES * wide)}"


class Signature:
    """How a function of LLVM's is called.

    - ``name``: its name, made of the function's and of the properties of its arguments.
    - ``arguments``, ``results``: the form of each.
    - ``mask_writes``: whether it is called in some lanes only, which are then its last argument in a register.
    - ``type``: the name of the type of what it returns.
    """

    def __init__(self, function: Function, name: str, block: Block, varying: Sequence[bool]):
        def form(value: Value, varies: bool) -> _Form:
            small = function.compiler.in_registers(value)
            return _Form(varies, Passing(function, value.shape, value.dtype, varies) if small else None)

        self.mask_writes = function.builder.mask is not None
        results = function.varying().call(name, varying) if function.in_lanes else [False] * len(block.results)
        self.arguments = list(map(form, block.arguments, varying))
        self.results = list(map(form, block.results, results))
        # In lanes there is one function of LLVM's for each choice of operands that differ between them: what all lanes
        # have in common stays a single number.
        pattern = "".join("v" if varies else "s" for varies in varying) + ("m" if self.mask_writes else "")
        self.name = f"{name}.{pattern}" if function.in_lanes else name
        # By a name: were all types listed in each line about one of hundreds of results, the text would be quadratic.
        self.type = f"%{self.name}.results" if self.types_of_results() else "void"

    def types_of_results(self) -> list[tuple[np.dtype, bool]]:
        """Returns the types of the numbers that are returned, and whether they are vectors."""
        return [kind for form in self.results for kind in form.kinds]

    def declaration(self) -> str:
        """Returns the line that says what its type is."""
        kinds = [vector_type(dtype, LANES * wide) for dtype, wide in self.types_of_results()]
        return f"{self.type} = type {{ {', '.join(kinds)} }}"


def compile_function(caller: Function, name: str, varying: Sequence[bool]) -> Signature:
    """Compiles a function of the program to an LLVM function, written when it is first needed."""
    compiler = caller.compiler
    block = compiler.functions[name]
    signature = Signature(caller, name, block, varying)
    if signature.name in compiler.compiled:
        return signature
    if signature.type == "void":
        function = Function(compiler, "ret void")
    else:
        compiler.module.declared[signature.type] = signature.declaration()
        function = Function(compiler, f"ret {signature.type} zeroinitializer")
    # Where it computes one number of each lane, its own loops cannot be in lanes.
    function.in_lanes = caller.in_lanes
    b, storage = function.builder, function.storage
    parameters, arguments = ["ptr %control", "ptr %workspace"], []
    # A function never writes to its arguments: it copies what it overwrites, since callers may still read them.
    for position, (value, form) in enumerate(zip(block.arguments, signature.arguments, strict=True)):
        if form.passing is None:
            # The caller passes memory of its own for results, in which no argument lies, and LLVM may know that.
            parameters.append(f"ptr noalias readonly %a{position}")
            buffer = Buffer(f"%a{position}", 0, writable=False, lanes=form.varying)
            arguments.append(Memory(value.shape, value.dtype, buffer))
            continue
        numbers: list[Element] = []
        for k, (dtype, wide) in enumerate(form.kinds):
            kind, name = vector_type(dtype, LANES * wide), f"%a{position}.{k}"
            parameters.append(f"{kind} {name}")
            # Lanes can be taken out of a vector that has a line of its own.
            name = b.effect(f"bitcast {kind} {name} to {kind}", LANES) if form.passing.stacked else name
            numbers.append(Vector(name) if wide else name)
        arguments.append(form.passing.within(function).join(numbers))
    if signature.mask_writes:
        parameters.append(f"{vector_type(BOOL)} %mask")
        b.mask, b.level = Vector("%mask"), 1
    with function.write_block(block, arguments) as results:
        returned: list[Element] = []
        for position, (array, form) in enumerate(zip(results, signature.results, strict=True)):
            if form.passing is not None:
                returned += form.passing.within(function).split(array)
            else:
                parameters.append(f"ptr noalias %r{position}")
                target = Buffer(f"%r{position}", 0, lanes=form.varying, level=b.level)
                storage.fill(Memory(array.shape, array.dtype, target), array)
    # LLVM returns such a structure in registers as far as these go.
    result = "undef"
    for position, (kind, number) in enumerate(zip(signature.types_of_results(), returned, strict=True)):
        result = b.effect(f"insertvalue {signature.type} {result}, {_with_type(b, kind, number)}, {position}")
    b.write("ret void" if signature.type == "void" else f"ret {signature.type} {result}")
    head = f"internal {signature.type} @{signature.name}({', '.join(parameters)})"
    compiler.module.functions.append(b.function(head))
    compiler.compiled[signature.name] = b.cost
    return signature


def call_function(function: Function, name: str, block: Block, operands: Sequence[Array]) -> list[Array]:
    """Writes a call of a function, and returns its results."""
    signature = compile_function(function, name, [array.varying for array in operands])
    b, storage = function.builder, function.storage
    operand_texts = ["ptr %control", "ptr %workspace"]
    for array, form in zip(operands, signature.arguments, strict=True):
        if form.passing is not None:
            numbers = form.passing.split(array)
            operand_texts += [_with_type(b, kind, number) for kind, number in zip(form.kinds, numbers, strict=True)]
        else:
            operand_texts.append(f"ptr {storage.to_memory(array).buffer.name}")
    if signature.mask_writes:
        operand_texts.append(f"{vector_type(BOOL)} {b.mask}")
    # Large results are written where the caller has room, so that nothing is copied behind the call.
    memory: list[Array] = []
    for value, form in zip(block.results, signature.results, strict=True):
        if form.passing is None:
            target = storage.allocate(value.shape, value.dtype, form.varying)
            operand_texts.append(f"ptr {target.buffer.name}")
            memory.append(target)
    call = f"call {signature.type} @{signature.name}({', '.join(operand_texts)})"
    # A loop of calls looks for signals as often as one of the instructions that they execute.
    b.cost += function.compiler.compiled[signature.name]
    if signature.type == "void":
        b.write(call)
        return memory
    returned = b.effect(call)
    numbers = iter(
        [
            b.effect(f"extractvalue {signature.type} {returned}, {k}", LANES * wide)
            for k, (_, wide) in enumerate(signature.types_of_results())
        ]
    )
    in_memory, results = iter(memory), []
    for form in signature.results:
        passed = [next(numbers) for _ in form.kinds]
        results.append(next(in_memory) if form.passing is None else form.passing.join(passed))
    return results


class Result(NamedTuple):
    """A result of a program: its offset in bytes, where all results lie in one array; its shape and type."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype


class Main(NamedTuple):
    """A program as LLVM IR: a function ``main(control, workspace, inputs, outputs)``.

    ``inputs`` and ``outputs`` are lists of the addresses of the arguments and of the results.

    - ``body``: its text, with all that it calls; ``block``: what it was written from.
    - ``results``, and ``size``: the bytes of the array in which all of them lie; ``workspace``: bytes to work in.
    - ``refuses``: whether it may stop at a callback of Python, so that XLA cannot call it.
    - ``longest_map``: how often its longest loop of independent turns is turned, one turn after another.
    """

    body: str
    block: Block
    results: tuple[Result, ...]
    size: int
    workspace: int
    refuses: bool
    longest_map: int


def emit_main(compiler: Compiler) -> Main:
    """Writes the operations of the main function, and of all that it calls.

    **Raises:** :class:`~.elements.UnsupportedError`.
    """
    block = compiler.functions["main"]
    function = Function(compiler, "ret void")
    arguments = [_argument(function, compiler, value, position) for position, value in enumerate(block.arguments)]
    results, size = [], 0
    with function.write_block(block, arguments) as arrays:
        for position, array in enumerate(arrays):
            results.append(Result(size, array.shape, array.dtype))
            address = _load_address(function, "%outputs", position)
            function.storage.fill(Memory(array.shape, array.dtype, Buffer(address, 0)), array)
            # Each begins at a multiple of the alignment, as JAX's arrays must to be taken without a copy.
            size += -(-max(size_of(array.shape) * array.dtype.itemsize, 1) // ALIGNMENT) * ALIGNMENT
    function.builder.write("ret void")
    module = compiler.module
    head = "internal void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)"
    module.functions.append(function.builder.function(head))
    return Main(module.text(), block, tuple(results), size, module.workspace, compiler.refuses, compiler.longest_map)


def _argument(function: Function, compiler: Compiler, value: Value, position: int) -> Array:
    # The caller's array, which JAX may share with other values.
    buffer = Buffer(_load_address(function, "%inputs", position), 0, writable=False)
    memory = Memory(value.shape, value.dtype, buffer)
    return function.storage.to_registers(memory) if compiler.in_registers(value) else memory


def _load_address(function: Function, addresses: str, position: int) -> str:
    b = function.builder
    return b.effect(f"load ptr, ptr {b.address(addresses, 8 * position)}")
