"""From StableHLO to machine code: the passes of the compiler, in their order."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .calls.grid import kernel, launcher
from .calls.handler import handler
from .calls.python import python_call
from .calls.row_threads import rows_in_threads
from .calls.table import Part, Rows, bytes_of_table, part_of
from .emit import operations  # noqa: F401 (whose rules are entered)
from .emit.lowering import Compiler
from .emit.main import Main, emit_main
from .emit.rules import RULES
from .executable import Form, Given
from .gpu import GridForm, compile_for_gpus
from .ir.elements import UnsupportedError
from .ir.extent import loops_over_large_arrays
from .ir.program import Block, functions_of
from .limits import MOST_BYTES_OF_TABLE
from .targets.machine import object_code, ptx, routines_in, triple
from .targets.processors import HOST, THREAD, Target, host_for


class Emitted(NamedTuple):
    """A program as LLVM IR, with its arguments and results as a row of each is.

    - ``block``: how many rows it computes at once.
    """

    main: Main
    takes: list[Part]
    gives: list[Part]
    block: int


def compile_for_cpu(
    module: Any,
    takes: Sequence[np.dtype],
    gives: Sequence[Given],
    *,
    large: bool = True,
    quickly: bool = False,
    rows: Rows | None = None,
) -> Form:
    """Compiles a StableHLO module for this processor.

    - ``takes``, ``gives``: the types of its arguments, and shapes and types of its results.
    - ``large``: even if its loops are over large arrays; ``quickly``: as for :func:`~.machine.object_code`.
    - ``rows``: the rows that it computes at once, if it does.

    **Raises:** :class:`UnsupportedError`.
    """
    functions = read_functions(module, len(takes), large)  # StableHLO as data: uses, last uses, nothing unread
    emitted = emit(functions, host_for(rows is not None), rows)  # LLVM IR, operation by operation
    text = cpu_text(emitted)  # with the functions by which it is called
    code = object_code(text, quickly)  # LLVM's passes, and machine code
    main = emitted.main
    offsets = tuple(result.offset for result in main.results)
    return Form(
        code,
        routines_in(text),
        tuple(takes),
        tuple(gives),
        offsets,
        main.size,
        main.workspace,
        main.refuses,
        rows.block if rows else 0,
    )


def compile_for_gpu(module: Any, takes: int, gives: Sequence[Given], large: bool) -> GridForm:
    """Compiles a StableHLO module for the GPUs of this machine.

    - ``takes``: how many arrays it takes; ``gives``: shapes and types of its results.
    - ``large``: even if its loops are over large arrays.

    **Raises:** :class:`UnsupportedError` for what only a CPU can do, and :class:`~.cuda.CudaError` where the driver
    cannot compile it.
    """
    functions = read_functions(module, takes, large)
    emitted = emit(functions, THREAD)
    code = compile_for_gpus(ptx(kernel_text(emitted)))
    return GridForm(code, object_code(launcher_text(emitted)), tuple(gives), emitted.main.longest_map)


def read_functions(module: Any, takes: int, large: bool = True) -> dict[str, Block]:
    """Reads the functions of a StableHLO module that takes this number of arrays.

    **Raises:** :class:`UnsupportedError`, also for loops over large arrays, unless they are allowed by ``large``.
    """
    functions = functions_of(module, RULES)
    if not large and loops_over_large_arrays(functions):
        raise UnsupportedError("A program of loops over large arrays")
    if len(functions["main"].arguments) != takes:
        raise UnsupportedError("A program with arguments of JAX's own")
    return functions


def emit(functions: dict[str, Block], target: Target = HOST, rows: Rows | None = None) -> Emitted:
    """Writes functions as LLVM IR for a kind of processor.

    **Raises:** :class:`UnsupportedError`.
    """
    main = emit_main(Compiler(functions, target))
    takes = [part_of(value, rows is not None and rows.taken[k]) for k, value in enumerate(main.block.arguments)]
    gives = [part_of(value, rows is not None) for value in main.block.results]
    return Emitted(main, takes, gives, rows.block if rows else 1)


def cpu_text(emitted: Emitted) -> str:
    """Returns the module for this processor.

    Its functions are ``run(inputs, block, workspace)``, for a call from Python, with one array in which all results
    lie; ``rows(shared)``, for many; and ``call(frame)``, for XLA.
    """
    main, takes, gives, block = emitted
    by_xla = handler(takes, gives, block)
    by_threads = rows_in_threads(takes, gives, block, main.workspace, triple())
    return python_call(main.results) + by_xla + by_threads + main.body


def kernel_text(emitted: Emitted) -> str:
    """Returns the module of the kernel.

    **Raises:** :class:`UnsupportedError` for more arrays than a kernel can take.
    """
    main, takes, gives, _ = emitted
    if bytes_of_table([*takes, *gives]) > MOST_BYTES_OF_TABLE:
        raise UnsupportedError(f"A program of {len(takes) + len(gives)} arrays on a GPU")
    return kernel(takes, gives, main.workspace) + main.body


def launcher_text(emitted: Emitted) -> str:
    """Returns the module of the handler that starts the kernel."""
    return handler(emitted.takes, emitted.gives, 1) + launcher(emitted.main.workspace)
