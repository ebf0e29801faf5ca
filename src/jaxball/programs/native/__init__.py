"""A compiler for small programs: from StableHLO, to which JAX lowers functions, to machine code, by LLVM.

XLA is built for large arrays: it takes seconds to compile a program of a few thousand operations on single numbers, and
turns it into many small loops. Here such a program is written as LLVM IR, number by number, in tenths of a second.

From the bottom up, each module is a step:

- ``elements``: types, known numbers, and names of unknown ones.
- ``folding``, ``module``, ``scopes``, ``builder``: LLVM IR as text, with constant folding, common subexpressions
  written once, and loop-invariant code moved before loops.
- ``values``, ``storage``: arrays in registers, in memory, or as formulas of an index; ownership of memory.
- ``program``: StableHLO as data, with the last use of each value.
- ``extent``: whether XLA would run a program faster.
- ``lanes``: loops whose iterations are computed side by side, in vectors; ``vectors``: short axes in vectors.
- ``ranges``: bounds of integers.
- ``rules``, ``operations``: what each operation computes, one file for each family.
- ``targets``: what the processors can do that programs are written for.
- ``lowering``, ``functions``, ``entry``: functions, operation by operation; functions that are not inlined; the entry
  function.
- ``table``, ``handler``, ``row_threads``, ``grid``: where the rows of a call lie; the function that XLA calls; threads
  of a CPU, or of a GPU, that compute rows.
- ``machine``: LLVM passes, machine code or PTX, and loading code into memory; ``cuda``: the driver of a GPU.
- ``executable``, ``gpu``: arguments, results, threads and Ctrl-C; kernels.
- ``jitting``, ``choice``: functions traced and compiled, and the choice of compiler; ``collecting``: garbage, while
  it works.

It contains nothing specific to mechanics.
"""

from .calls.table import Rows
from .choice import asked_for, chosen, compiler
from .gpu import GridForm, GridProgram
from .ir.elements import LANES
from .ir.lanes import FEWEST
from .jitting import (
    CallbackReachedError,
    Form,
    Lowered,
    Program,
    Refusal,
    allowed,
    allowed_on_gpu,
    are_numbers,
    as_keys,
    identity_on_gpu,
    implementation,
    kind,
    numbers,
    on_one_cpu,
    settings,
    some_traced,
    traced_natively,
    type_of,
    usable,
    warn_if_asked_for,
)
from .targets.cuda import CudaError
from .targets.machine import identity

__all__ = [
    "FEWEST",
    "LANES",
    "CallbackReachedError",
    "CudaError",
    "Form",
    "GridForm",
    "GridProgram",
    "Lowered",
    "Program",
    "Refusal",
    "Rows",
    "allowed",
    "allowed_on_gpu",
    "are_numbers",
    "as_keys",
    "asked_for",
    "chosen",
    "compiler",
    "identity",
    "identity_on_gpu",
    "implementation",
    "kind",
    "numbers",
    "on_one_cpu",
    "settings",
    "some_traced",
    "traced_natively",
    "type_of",
    "usable",
    "warn_if_asked_for",
]
