"""Functions that are not inlined: written once as functions of LLVM IR, and called, for ``operations.control``."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ir.elements import Element, Vector, vector_type
from ..ir.program import Block, Value
from ..limits import LANES
from .buffers import Buffer
from .builder import Builder
from .instructions import BOOL
from .lowering import Function
from .passing import Passing
from .values import Array, Memory


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
        kinds = [vector_type(dtype, LANES * wide) for dtype, wide in self.types_of_results()]
        self.type = f"{{ {', '.join(kinds)} }}" if kinds else "void"

    def types_of_results(self) -> list[tuple[np.dtype, bool]]:
        """Returns the types of the numbers that are returned, and whether they are vectors."""
        return [kind for form in self.results for kind in form.kinds]


def compile_function(caller: Function, name: str, varying: Sequence[bool]) -> Signature:
    """Compiles a function of the program to an LLVM function, written when it is first needed."""
    compiler = caller.compiler
    block = compiler.functions[name]
    signature = Signature(caller, name, block, varying)
    if signature.name in compiler.compiled:
        return signature
    function = Function(compiler, "ret void" if signature.type == "void" else f"ret {signature.type} zeroinitializer")
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
