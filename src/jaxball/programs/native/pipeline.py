"""A module compiled, with the functions by which it is called: from Python, by XLA, or by the threads of a GPU."""

from typing import Any

import numpy as np

from .calls import grid
from .calls.handler import handler
from .calls.row_threads import PATIENCE, rows_in_threads
from .calls.table import Rows, bytes_of_table, part_of
from .emit.lowering import INTERRUPTED_CODE, REFUSED, Compiler, Function
from .emit.rules import RULES
from .emit.values import Array, Buffer, Memory, size_of
from .executable import ALIGNMENT, Form
from .gpu import GridForm, compile_for_gpus
from .ir.elements import UnsupportedError
from .ir.extent import loops_over_large_arrays
from .ir.program import Value, functions_of
from .targets.machine import object_code, ptx, routines_in, triple
from .targets.processors import HOST, THREAD, Target, host_for

# The control data of a program: the instructions left until it next checks for signals, whether it must stop, the state
# of Python's thread, which has released Python's lock, and where it says that all threads must stop, if it has several.
SUPPORT = f"""
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
declare i32 @PyErr_CheckSignals()

define internal i1 @looks_for_signals(ptr %control) noinline cold {{
entry:
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %before = load i8, ptr %place
  %stopped = icmp ne i8 %before, 0
  br i1 %stopped, label %stop, label %look
look:
  store i64 {PATIENCE}, ptr %control
  %state = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %state)
  %raised = call i32 @PyErr_CheckSignals()
  %new = call ptr @PyEval_SaveThread()
  store ptr %new, ptr %state.place
  %interrupted = icmp ne i32 %raised, 0
  br i1 %interrupted, label %interrupt, label %others
others:
  %all.place = getelementptr i8, ptr %control, i64 24
  %all = load ptr, ptr %all.place
  %alone = icmp eq ptr %all, null
  br i1 %alone, label %continue, label %together
together:
  %all.stopped = load atomic i64, ptr %all seq_cst, align 8
  %stop.all = icmp ne i64 %all.stopped, 0
  br i1 %stop.all, label %interrupt, label %continue
interrupt:
  store i8 {INTERRUPTED_CODE}, ptr %place
  br label %stop
stop:
  store i64 -1, ptr %control
  ret i1 true
continue:
  ret i1 false
}}

define i32 @run(ptr %inputs, ptr %block, ptr %workspace) {{
OUTPUTS
  %control = alloca [32 x i8], align 8
  %all.place = getelementptr i8, ptr %control, i64 24
  store ptr null, ptr %all.place
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %state = call ptr @PyEval_SaveThread()
  store i64 {PATIENCE}, ptr %control
  store i8 0, ptr %place
  store ptr %state, ptr %state.place
  call void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)
  %last = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %last)
  %stopped = load i8, ptr %place
  %refused = icmp eq i8 %stopped, {REFUSED}
  %result = zext i1 %refused to i32
  ret i32 %result
}}
"""


class Entry:
    """A compiled program as LLVM IR: a function ``main(control, workspace, inputs, outputs)``.

    ``inputs`` and ``outputs`` are lists of the addresses of the arguments and of the results.

    - ``body``: its text, with all that it calls.
    - ``results``: offset in bytes, shape and type of each result, where all lie in one array of ``size`` bytes.
    - ``workspace``: bytes to work in.
    - ``refuses``: whether it may stop at a callback of Python, so that XLA cannot call it.
    - ``longest_map``: how often its longest loop of independent turns is turned, one turn after another.
    - ``takes``, ``gives``: arguments and results, as a row of each is.
    """

    def __init__(self, compiler: Compiler, rows: Rows | None = None):
        block = compiler.functions["main"]
        function = Function(compiler, "ret void")
        arguments = [_argument(function, compiler, value, position) for position, value in enumerate(block.arguments)]
        self.results: list[tuple[int, tuple[int, ...], np.dtype]] = []
        self.size = 0
        with function.executed(block, arguments) as results:
            for position, array in enumerate(results):
                self.results.append((self.size, array.shape, array.dtype))
                address = _listed(function, "%outputs", position)
                function.storage.fill(Memory(array.shape, array.dtype, Buffer(address, 0)), array)
                self.size += -(-max(size_of(array.shape) * array.dtype.itemsize, 1) // ALIGNMENT) * ALIGNMENT
        function.builder.write("ret void")
        head = "internal void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)"
        compiler.module.functions.append(function.builder.function(head))
        self.body = compiler.module.text()
        self.workspace = compiler.module.workspace
        self.refuses = compiler.refuses
        self.longest_map = compiler.longest_map
        self.takes = [part_of(value, rows is not None and rows.taken[k]) for k, value in enumerate(block.arguments)]
        self.gives = [part_of(value, rows is not None) for value in block.results]
        self.block = rows.block if rows else 1

    def text(self) -> str:
        """The module for this processor.

        Its functions are ``run(inputs, block, workspace)``, for a call from Python, with one array in which all results
        lie; ``rows(shared)``, for many; and ``call(frame)``, for XLA.
        """
        parts = self.takes, self.gives
        return "".join(
            (
                SUPPORT.replace("OUTPUTS", self._outputs()),
                handler(*parts, self.block),
                rows_in_threads(*parts, self.block, self.workspace, triple()),
                self.body,
            )
        )

    def _outputs(self) -> str:
        """The list of the places of all results in one array."""
        lines = [f"%outputs = alloca [{max(len(self.results), 1)} x ptr], align 8"]
        for position, (offset, *_) in enumerate(self.results):
            lines.append(f"%output.{position} = getelementptr i8, ptr %block, i64 {offset}")
            lines.append(f"%output.place.{position} = getelementptr i8, ptr %outputs, i64 {8 * position}")
            lines.append(f"store ptr %output.{position}, ptr %output.place.{position}")
        return "  " + "\n  ".join(lines)


def compiled(
    module: Any,
    arguments: int,
    large: bool = True,
    quickly: bool = False,
    rows: Rows | None = None,
) -> Form:
    """Compiles a StableHLO module with a number of ``arguments``.

    - ``large``: even if its loops are over large arrays; ``quickly``: as for :func:`~.machine.object_code`.
    - ``rows``: the rows that it computes at once, if it does.

    **Raises:** :class:`UnsupportedError`.
    """
    entry = written(module, arguments, large, rows, host_for(rows is not None))
    text = entry.text()
    code, routines = object_code(text, quickly), routines_in(text)
    return Form(
        code,
        tuple(entry.results),
        entry.size,
        entry.workspace,
        arguments,
        routines,
        entry.refuses,
        rows.block if rows else 0,
    )


def written(module: Any, arguments: int, large: bool = True, rows: Rows | None = None, target: Target = HOST) -> Entry:
    """The same as LLVM IR, before LLVM compiles it; ``target``: the kind of processor.

    **Raises:** :class:`UnsupportedError`.
    """
    functions = functions_of(module, RULES)
    if not large and loops_over_large_arrays(functions):
        raise UnsupportedError("A program of loops over large arrays")
    if len(functions["main"].arguments) != arguments:
        raise UnsupportedError("A program with arguments of JAX's own")
    return Entry(Compiler(functions, target), rows)


def compile_for_gpu(module: Any, gives: Any, arguments: int, large: bool) -> GridForm:
    """Compiles a StableHLO module for the GPUs of this machine.

    - ``gives``: the arrays that a run gives, see :class:`GridForm`; ``arguments``: how many arrays it takes.
    - ``large``: even if its loops are over large arrays.

    **Raises:** :class:`UnsupportedError` for what only a CPU can do, and :class:`~.cuda.CudaError` where the driver
    cannot compile it.
    """
    entry = written(module, arguments, large, target=THREAD)
    kernel = compile_for_gpus(ptx(kernel_text(entry)))
    return GridForm(kernel, object_code(launcher_text(entry)), gives, entry.longest_map)


def kernel_text(entry: Entry) -> str:
    """The module of the kernel.

    **Raises:** :class:`UnsupportedError` for more arrays than a kernel can take.
    """
    if bytes_of_table([*entry.takes, *entry.gives]) > grid.MOST_BYTES_OF_TABLE:
        raise UnsupportedError(f"A program of {len(entry.takes) + len(entry.gives)} arrays on a GPU")
    return grid.kernel(entry.takes, entry.gives, entry.workspace) + entry.body


def launcher_text(entry: Entry) -> str:
    """The module of the handler that starts the kernel."""
    return handler(entry.takes, entry.gives, 1) + grid.launcher(entry.workspace)


def _argument(function: Function, compiler: Compiler, value: Value, position: int) -> Array:
    memory = Memory(value.shape, value.dtype, Buffer(_listed(function, "%inputs", position), 0, writable=False))
    return function.storage.to_registers(memory) if compiler.in_registers(value) else memory


def _listed(function: Function, addresses: str, position: int) -> str:
    b = function.builder
    return b.effect(f"load ptr, ptr {b.address(addresses, 8 * position)}")
