"""The main function of a program as LLVM IR, which reads its arguments and writes its results where it is told."""

from typing import NamedTuple

import numpy as np

from ..ir.program import Block, Value
from ..limits import ALIGNMENT
from .buffers import Buffer
from .lowering import Compiler, Function
from .values import Array, Memory, size_of


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
