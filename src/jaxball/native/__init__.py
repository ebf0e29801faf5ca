"""A compiler of small programs: StableHLO, as JAX lowers a function to it, to machine code, by LLVM.

XLA is built for large arrays: it takes seconds to compile a program of some thousand operations on single numbers,
and makes many small loops of it. Here such a program is written as LLVM's IR, number by number, in tenths of a second.

From the bottom up, each module a step of the way:

- ``elements``: types, numbers that are known and names of those that are not.
- ``folding``, ``module``, ``scopes``, ``builder``: LLVM's IR as text; what is known is folded, equal instructions are
  written once, and before a loop where each turn would compute the same.
- ``values``, ``storage``: arrays in registers, in memory, or as formulas of an index; who owns which memory.
- ``program``: StableHLO as data, with who reads a value last.
- ``extent``: whether XLA has a program faster.
- ``lanes``: loops whose turns are computed side by side, in vectors; ``vectors``: short axes in vectors.
- ``ranges``: within which bounds integers are.
- ``rules``, ``operations``: what each operation computes, one file for each family.
- ``lowering``, ``functions``, ``entry``: functions, operation by operation; those that stay functions; the first one.
- ``machine``: passes of LLVM, machine code, its place in memory.
- ``executable``: arguments, results, threads and Ctrl-C.
- ``jitting``, ``choice``: functions of users, and which compiler compiles them.

It knows nothing of balls.
"""

from .choice import asked_for, chosen, compiler
from .elements import LANES
from .jitting import (
    CallbackReachedError,
    Form,
    Lowered,
    Program,
    Refusal,
    allowed,
    jit,
    kind,
    on_one_cpu,
    settings,
    usable,
    warn_if_asked_for,
)
from .lanes import FEWEST
from .machine import identity

__all__ = [
    "FEWEST",
    "LANES",
    "CallbackReachedError",
    "Form",
    "Lowered",
    "Program",
    "Refusal",
    "allowed",
    "asked_for",
    "chosen",
    "compiler",
    "identity",
    "jit",
    "kind",
    "on_one_cpu",
    "settings",
    "usable",
    "warn_if_asked_for",
]
