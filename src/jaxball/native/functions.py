"""Functions that are not inlined: written once as functions of LLVM IR, and called."""

from collections.abc import Sequence

import numpy as np

from .builder import BOOL
from .elements import LANES, Lanes, Name, llvm_type, vector_type
from .lowering import Function
from .program import Block
from .storage import joined, parts, parts_of
from .values import Array, Buffer, Memory, registers


class Signature:
    """How a function of LLVM's is called.

    - ``name``: its name, which is that of the function and of what is known of its arguments.
    - ``arguments``, ``results``: of each whether it is in registers, and whether lanes have each their own.
    - ``masked``: whether it is called in some lanes only, which are then its last argument in a register.
    """

    def __init__(self, function: Function, name: str, block: Block, varying: Sequence[bool]):
        compiler = function.compiler
        self.masked = function.builder.mask is not None
        results = function.varying().call(name, varying) if function.in_lanes else [False] * len(block.results)
        self.arguments = [
            (compiler.in_registers(value), own) for value, own in zip(block.arguments, varying, strict=True)
        ]
        self.results = [(compiler.in_registers(value), own) for value, own in zip(block.results, results, strict=True)]
        pattern = "".join("v" if own else "s" for own in varying) + ("m" if self.masked else "")
        self.name = f"{name}.{pattern}" if function.in_lanes else name
        kinds = [vector_type(dtype) if own else llvm_type(dtype) for dtype, own in self.returned(block)]
        self.type = f"{{ {', '.join(kinds)} }}" if kinds else "void"

    def returned(self, block: Block) -> list[tuple[np.dtype, bool]]:
        """The types of the numbers that are returned, and whether they are vectors."""
        return [
            (dtype, own)
            for value, (small, own) in zip(block.results, self.results, strict=True)
            if small
            for dtype in parts_of(value.dtype, value.size)
        ]


def compile_function(caller: Function, name: str, varying: Sequence[bool]) -> Signature:
    """A function of the program as an LLVM function, written when it is first needed."""
    compiler = caller.compiler
    block = compiler.functions[name]
    signature = Signature(caller, name, block, varying)
    if signature.name in compiler.compiled:
        return signature
    function = Function(compiler, "ret void" if signature.type == "void" else f"ret {signature.type} zeroinitializer")
    function.in_lanes = caller.in_lanes
    given, arguments = ["ptr %control", "ptr %workspace"], []
    for position, (value, (small, own)) in enumerate(zip(block.arguments, signature.arguments, strict=True)):
        if not small:
            given.append(f"ptr noalias readonly %a{position}")
            buffer = Buffer(f"%a{position}", 0, writable=False, lanes=own)
            arguments.append(Memory(value.shape, value.dtype, buffer))
            continue
        kinds = parts_of(value.dtype, value.size)
        names = [_named(f"%a{position}.{k}", own) for k in range(len(kinds))]
        given += [
            f"{vector_type(kind) if own else llvm_type(kind)} {name}" for kind, name in zip(kinds, names, strict=True)
        ]
        arguments.append(registers(value.dtype, joined([value.dtype] * value.size, names), value.shape))
    if signature.masked:
        given.append(f"{vector_type(BOOL)} %mask")
        function.builder.mask, function.builder.level = Lanes("%mask"), 1
    b, storage = function.builder, function.storage
    with function.executed(block, arguments) as results:
        returned = []
        for position, (array, (small, own)) in enumerate(zip(results, signature.results, strict=True)):
            if small:
                flat = list(storage.to_registers(array).objects().reshape(-1))
                returned += [number for _, number in parts([array.dtype] * len(flat), flat)]
            else:
                given.append(f"ptr noalias %r{position}")
                target = Buffer(f"%r{position}", 0, lanes=own, level=b.level)
                storage.fill(Memory(array.shape, array.dtype, target), array)
    result = "undef"
    for position, ((dtype, own), number) in enumerate(zip(signature.returned(block), returned, strict=True)):
        item = f"{vector_type(dtype) if own else llvm_type(dtype)} {b.operand(dtype, number, LANES * own)}"
        result = b.effect(f"insertvalue {signature.type} {result}, {item}, {position}")
    b.write("ret void" if signature.type == "void" else f"ret {signature.type} {result}")
    compiler.module.functions.append(b.function(f"internal {signature.type} @{signature.name}({', '.join(given)})"))
    compiler.compiled[signature.name] = b.cost
    return signature


def _named(name: str, varying: bool) -> Name:
    return Lanes(name) if varying else name


def call_function(function: Function, name: str, block: Block, operands: Sequence[Array]) -> list[Array]:
    """The results of a call."""
    signature = compile_function(function, name, [array.varying for array in operands])
    b, storage = function.builder, function.storage
    given = ["ptr %control", "ptr %workspace"]
    for array, (small, own) in zip(operands, signature.arguments, strict=True):
        if small:
            flat = list(storage.to_registers(array).objects().reshape(-1))
            for dtype, number in parts([array.dtype] * len(flat), flat):
                given.append(
                    f"{vector_type(dtype) if own else llvm_type(dtype)} {b.operand(dtype, number, LANES * own)}"
                )
        else:
            given.append(f"ptr {storage.to_memory(array).buffer.name}")
    if signature.masked:
        given.append(f"{vector_type(BOOL)} {b.mask}")
    memory: list[Array] = []
    for value, (small, own) in zip(block.results, signature.results, strict=True):
        if not small:
            target = storage.allocate(value.shape, value.dtype, own)
            given.append(f"ptr {target.buffer.name}")
            memory.append(target)
    call = f"call {signature.type} @{signature.name}({', '.join(given)})"
    b.cost += function.compiler.compiled[signature.name]
    if signature.type == "void":
        b.write(call)
        return memory
    returned = b.effect(call)
    numbers = iter(
        [
            b.effect(f"extractvalue {signature.type} {returned}, {k}", LANES * own)
            for k, (_, own) in enumerate(signature.returned(block))
        ]
    )
    in_memory, results = iter(memory), []
    for value, (small, _) in zip(block.results, signature.results, strict=True):
        if not small:
            results.append(next(in_memory))
            continue
        own = [next(numbers) for _ in parts_of(value.dtype, value.size)]
        results.append(registers(value.dtype, joined([value.dtype] * value.size, own), value.shape))
    return results
