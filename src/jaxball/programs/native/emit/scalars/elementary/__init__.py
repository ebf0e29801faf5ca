"""Elementary functions in double precision, written with the same instructions for a number or a vector of numbers.

The C library computes one number after another, and a GPU has none. These functions have no tables but for angles
above 2³⁰, and no branches but for these and a loop for remainders, so that they work equally for all lanes of a
vector. Each is an LLVM function, written when it is first called. Where a comment says exact, this relies on fused
multiply-adds, and on no operation being contracted.

``writer`` writes instructions and parts of formulas; the other modules have the functions of a theme each.

Sources: W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980, for reductions in several parts;
FDLIBM (Sun Microsystems, 1993) for the coefficients of sin, cos, log, atan and erf; T. J. Dekker, Numer. Math. 18,
1971, for sums and products of pairs.
"""

import functools

from ....ir.elements import Element, Name, vector_type, width_of
from ...builder import Builder
from . import errors, exponentials, roots, trigonometric
from .writer import DOUBLE, Function, Writer

# With how many arguments.
FUNCTIONS: dict[str, tuple[Function, int]] = {
    "sincos": (trigonometric.sin_and_cos, 1),
    "tan": (trigonometric.tan, 1),
    "asin": (trigonometric.asin, 1),
    "acos": (trigonometric.acos, 1),
    "atan": (trigonometric.atan, 1),
    "atan2": (trigonometric.atan2, 2),
    "exp": (exponentials.exp, 1),
    "expm1": (exponentials.expm1, 1),
    "log": (exponentials.log, 1),
    "log1p": (exponentials.log1p, 1),
    "pow": (exponentials.pow, 2),
    "sinh": (exponentials.sinh, 1),
    "cosh": (exponentials.cosh, 1),
    "tanh": (exponentials.tanh, 1),
    "asinh": (exponentials.asinh, 1),
    "acosh": (exponentials.acosh, 1),
    "atanh": (exponentials.atanh, 1),
    "cbrt": (roots.cbrt, 1),
    "hypot": (roots.hypot, 2),
    "log_hypot": (roots.log_hypot, 2),
    "erf": (errors.erf, 1),
    "erfc": (errors.erfc, 1),
    "fmod": (roots.fmod, 2),
}


def name_of(name: str, lanes: int = 1) -> str:
    """Returns the name of a function in LLVM's IR."""
    return f"@elementary.{name}.f64" if lanes == 1 else f"@elementary.{name}.v{lanes}f64"


def definition(name: str, lanes: int = 1) -> str:
    """Returns a function in LLVM's IR, without the functions that it calls."""
    return _write_function(name, lanes)[0]


def declarations(name: str, lanes: int = 1) -> dict[str, str]:
    """Returns the functions that a function calls, by name: declarations of LLVM's own, and definitions."""
    return _write_function(name, lanes)[1]


@functools.cache
def _write_function(name: str, lanes: int) -> tuple[str, dict[str, str]]:
    compute, count = FUNCTIONS[name]
    w = Writer(lanes)
    arguments = [w.argument(f"%x{k}") for k in range(count)]
    kind = vector_type(DOUBLE, width_of(*arguments))
    results = compute(w, arguments)
    returned = kind if len(results) == 1 else f"{{ {', '.join([kind] * len(results))} }}"
    result = results[0]
    if len(results) > 1:
        result = "undef"
        for k, number in enumerate(results):
            result = w.effect(f"insertvalue {returned} {result}, {kind} {w.operand(DOUBLE, number)}, {k}")
    w.write(f"ret {returned} {w.operand(DOUBLE, result)}")
    head = f"internal {returned} {name_of(name, lanes)}({', '.join(f'{kind} {x}' for x in arguments)})"
    return w.function(f"{head} nounwind memory(none)"), w.module.declared


def write_call(b: Builder, name: str, *operands: Element, part: int | None = None) -> Name:
    """Writes a call, for vectors where an operand is one, once for equal operands; ``part`` chooses one of several
    results.
    """
    width = width_of(*operands)
    lanes = width or 1
    # Written once in a process, and part of each module that calls it.
    for symbol, line in declarations(name, lanes).items():
        b.module.declared.setdefault(symbol, line)
    b.module.declared.setdefault(name_of(name, lanes), definition(name, lanes))
    kind = vector_type(DOUBLE, width)
    returned = kind if part is None else f"{{ {kind}, {kind} }}"
    operand_texts = ", ".join(f"{kind} {b.operand(DOUBLE, x, width)}" for x in operands)
    result = b.pure(f"call {returned} {name_of(name, lanes)}({operand_texts})", width)
    return result if part is None else b.pure(f"extractvalue {returned} {result}, {part}", width)
