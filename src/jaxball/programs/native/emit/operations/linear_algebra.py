"""Factorisations and solutions of small matrices: calls of LAPACK and BLAS, as SciPy contains them.

JAX asks for them by ``stablehlo.custom_call``, one for each routine, whose arrays may have dimensions in front, over
which there is a loop here. A routine works on columns, one behind the other: each matrix is copied, transposed.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...ir.elements import Element, Index, Name, Pair, UnsupportedError, part_of
from ...ir.program import Operation
from ...limits import COLUMNS_OF_BLOCK
from ...targets import machine
from ..builder import INDEX
from ..instructions import BOOL
from ..lowering import Function, is_callback, rule
from ..storage import parts
from ..values import Array, Memory, Registers

INTEGER = np.dtype(np.int32)
_LETTERS = {"s": np.dtype("f4"), "d": np.dtype("f8"), "c": np.dtype("c8"), "z": np.dtype("c16")}


class _Routine:
    """One call: of a routine for numbers of a type."""

    def __init__(self, function: Function, operation: Operation, letter: str):
        self.function, self.operation, self.letter = function, operation, letter
        self.dtype = _LETTERS[letter]

    def option(self, name: str) -> str:
        """Returns a letter that JAX gives as its code."""
        return chr(self.operation.attribute("mhlo.backend_config")[name])

    def memory(self, dtype: np.dtype, *lengths: int) -> Memory:
        """Allocates memory for one matrix, as the transposed one, or for numbers to work in."""
        return self.function.storage.allocate([max(length, 1) for length in lengths[::-1]], dtype)

    def call(self, name: str, *arguments: Any, library: str = "lapack") -> None:
        """Calls a routine: its arguments are letters, integers, numbers of a type, which are passed by their addresses,
        and memory.
        """
        b, symbol = self.function.builder, f"scipy.{library}.{self.letter}{name}"
        if not b.module.target.has_routines or machine.routine(library, f"{self.letter}{name}") is None:
            raise UnsupportedError(f"{self.letter}{name} of SciPy's {library.upper()}")
        head = f"declare void @{symbol}({', '.join(['ptr'] * len(arguments))}) nounwind"
        b.module.declared.setdefault(f"@{symbol}", head)
        b.write(f"call void @{symbol}({', '.join(f'ptr {self._address(argument)}' for argument in arguments)})")

    def _address(self, argument: Any) -> Name:
        if isinstance(argument, Memory):
            return argument.buffer.name
        if isinstance(argument, str):
            argument = np.frombuffer(argument.encode(), np.uint8)
        return self.function.builder.module.constant(
            np.asarray(argument, INTEGER if isinstance(argument, int) else None)
        )


# Each of these writes the call for one matrix. It is given the operands and gives the results, in memory of columns.
Factorisation = Callable[[_Routine, "list[Memory]"], "list[Memory]"]


def _lu(r: _Routine, operands: list[Memory]) -> list[Memory]:
    (a,) = operands
    n, m = a.shape
    pivots, info = r.memory(INTEGER, min(m, n)), r.memory(INTEGER, 1)
    r.call("getrf", m, n, a, m, pivots, info)
    return [a, pivots, info]


def _triangular_solution(r: _Routine, operands: list[Memory]) -> list[Memory]:
    a, x = operands
    options = [r.option(name) for name in ("side", "uplo", "trans_x", "diag")]
    n, m = x.shape
    r.call("trsm", *options, m, n, r.dtype.type(1), a, a.shape[1], x, m, library="blas")
    return [x]


def _cholesky(r: _Routine, operands: list[Memory]) -> list[Memory]:
    (a,) = operands
    info = r.memory(INTEGER, 1)
    r.call("potrf", r.option("uplo"), a.shape[0], a, a.shape[0], info)
    return [a, info]


def _qr(r: _Routine, operands: list[Memory]) -> list[Memory]:
    (a,) = operands
    n, m = a.shape
    scales, work, info = r.memory(r.dtype, min(m, n)), r.memory(r.dtype, COLUMNS_OF_BLOCK * n), r.memory(INTEGER, 1)
    r.call("geqrf", m, n, a, m, scales, work, COLUMNS_OF_BLOCK * n, info)
    return [a, scales]


def _q(r: _Routine, operands: list[Memory]) -> list[Memory]:
    a, scales = operands
    n, m = a.shape
    work, info = r.memory(r.dtype, COLUMNS_OF_BLOCK * n), r.memory(INTEGER, 1)
    name = "ungqr" if r.dtype.kind == "c" else "orgqr"
    r.call(name, m, n, scales.shape[0], a, m, scales, work, COLUMNS_OF_BLOCK * n, info)
    return [a]


def _eigenvalues_of_symmetric(r: _Routine, operands: list[Memory]) -> list[Memory]:
    (a,) = operands
    n = a.shape[0]
    values, info = r.memory(part_of(r.dtype), n), r.memory(INTEGER, 1)
    integers = r.memory(INTEGER, 3 + 5 * n)
    options, reals = (r.option("mode"), r.option("uplo")), 1 + 6 * n + 2 * n * n
    work = [r.memory(part_of(r.dtype), reals), reals, integers, 3 + 5 * n]
    if r.dtype.kind == "c":
        count = 2 * n + n * n
        r.call("heevd", *options, n, a, n, values, r.memory(r.dtype, count), count, *work, info)
    else:
        r.call("syevd", *options, n, a, n, values, *work, info)
    return [a, values, info]


def _eigenvalues(r: _Routine, operands: list[Memory]) -> list[Memory]:
    """Computes eigenvalues and vectors: for a real matrix, LAPACK gives the parts of a complex vector as the vectors of
    it and of the next value.
    """
    (a,), b, storage = operands, r.function.builder, r.function.storage
    n, info = a.shape[0], r.memory(INTEGER, 1)
    count = 4 * max(n, 1)
    options = [r.option("compute_left"), r.option("compute_right")]
    vectors = [r.memory(r.dtype, n, n) for _ in options]
    values = [r.memory(r.dtype, n) for _ in range(1 if r.dtype.kind == "c" else 2)]
    work: list[Any] = [r.memory(r.dtype, count), count]
    if r.dtype.kind == "c":
        work.append(r.memory(part_of(r.dtype), 2 * n))
    left, right = vectors
    # Where it is not 0, JAX returns NaN; −4 is LAPACK's for its fourth argument, which is the matrix.
    with storage.every_index(info.shape) as index:
        storage.put(info, index, np.int32(-4))
    with b.where(_all_finite(r, a)):  # a search for eigenvalues may not end
        r.call("geev", *options, n, a, n, *values, left, n, right, n, *work, info)
    if r.dtype.kind == "c":
        return [*values, left, right, info]
    pairs = [r.memory(np.dtype(f"c{2 * r.dtype.itemsize}"), n, n) for _ in vectors]
    zero = r.dtype.type(0)
    for target, source in zip(pairs, vectors, strict=True):
        with storage.every_index((n, n)) as (j, i):
            turned = values[1].element(b, (j,))
            second = b.compare("olt", r.dtype, turned, zero)
            back = b.as_index(b.select(INDEX, second, np.int64(1), np.int64(0)), INDEX)
            k = b.clamp(b.plus(j, b.times(back, -1)), n - 1)
            # Moved into the array for the last vector, which has no next one: its value is real, and `other` is not
            # used.
            real, other = (source.element(b, (b.clamp(b.plus(k, d), n - 1), i)) for d in (0, 1))
            imaginary = b.select(r.dtype, second, b.negative(r.dtype, other), other)
            imaginary = b.select(r.dtype, b.compare("oeq", r.dtype, turned, zero), zero, imaginary)
            storage.put(target, (j, i), Pair(real, imaginary))
    return [*values, *pairs, info]


def _all_finite(r: _Routine, a: Memory) -> Element:
    b = r.function.builder

    def step(index: list[Index], numbers: list[Element]) -> list[Element]:
        element = a.element(b, index)
        total = numbers[0]
        for part, number in parts([a.dtype], [element]):
            finite = b.compare("olt", part, b.call(f"llvm.fabs.f{8 * part.itemsize}", part, number), part.type(np.inf))
            total = b.binary("and", BOOL, total, finite)
        return [total]

    return r.function.storage.accumulate(a.shape, [(BOOL, np.bool_(True))], step)[0]


def _singular_values(r: _Routine, operands: list[Memory]) -> list[Memory]:
    (a,) = operands
    n, m = a.shape
    less, more = min(m, n), max(m, n)
    u, v = (tuple(result.shape[-2:]) for result in r.operation.results[2:4])
    values, info = r.memory(part_of(r.dtype), less), r.memory(INTEGER, 1)
    left, right = r.memory(r.dtype, *u), r.memory(r.dtype, *v)
    count = 4 * less * less + 7 * less + COLUMNS_OF_BLOCK * more
    work: list[Any] = [r.memory(r.dtype, count), count]
    if r.dtype.kind == "c":
        work.append(r.memory(part_of(r.dtype), less * (5 * less + 5 + 2 * more + 2 * less + 1)))
    integers = r.memory(INTEGER, 8 * less)
    r.call("gesdd", r.option("mode"), m, n, a, m, values, left, u[0], right, v[0], *work, integers, info)
    return [a, values, left, right, info]


def _tridiagonal_solution(r: _Routine, operands: list[Memory]) -> list[Memory]:
    """Solves a tridiagonal system, whose lower diagonal has a first element without a meaning."""
    low, middle, high, x = operands
    (m,), info = middle.shape, r.memory(INTEGER, 1)
    lower = r.memory(r.dtype, m)
    with r.function.storage.every_index((m - 1,)) as (i,):
        number = low.element(r.function.builder, (r.function.builder.plus(i, 1),))
        r.function.storage.put(lower, (i,), number)
    r.call("gtsv", m, x.shape[0], lower, middle, high, x, m, info)
    return [low, middle, high, x, info]


_ROUTINES: dict[str, Factorisation] = {
    "getrf": _lu,
    "trsm": _triangular_solution,
    "potrf": _cholesky,
    "geqrf": _qr,
    "orgqr": _q,
    "ungqr": _q,
    "syevd": _eigenvalues_of_symmetric,
    "heevd": _eigenvalues_of_symmetric,
    "geev": _eigenvalues,
    "gesdd": _singular_values,
    "gtsv": _tridiagonal_solution,
}


@rule("stablehlo.custom_call")
def custom_call(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Calls a routine of LAPACK; a callback ends the program, which is then run by XLA."""
    if is_callback(operation):
        function.refuse()
        return [Registers(result.dtype, np.zeros(result.shape, result.dtype)) for result in operation.results]
    target = operation.attribute("call_target_name")
    routine = _routine_named(target)
    if routine is None:
        raise UnsupportedError(f"{operation.name} of {target}")
    return _call(function, operation, operands, *routine)


def _routine_named(target: str) -> tuple[str, str] | None:
    """Returns the letter and the name of a routine that is known, from a name like ``lapack_dgetrf_ffi``."""
    letter, name = target[7:8], target[8:].removesuffix("_ffi")
    return (letter, name) if target.startswith("lapack_") and letter in _LETTERS and name in _ROUTINES else None


def _call(function: Function, operation: Operation, operands: list[Array], letter: str, name: str) -> list[Array]:
    """Calls a routine of LAPACK's or BLAS's, for each matrix."""
    storage, compute = function.storage, _ROUTINES[name]
    routine = _Routine(function, operation, letter)
    # LAPACK overwrites its matrices, and has them column by column: each is copied, its indices exchanged.
    arrays = [storage.anywhere(storage.evaluate(array)) for array in operands]
    targets = [storage.allocate(result.shape, result.dtype) for result in operation.results]
    batch = arrays[0].shape[: -1 if name == "gtsv" else -2]
    with storage.every_index(batch) as place:
        copies = [routine.memory(array.dtype, *array.shape[len(batch) :]) for array in arrays]
        for memory, array in zip(copies, arrays, strict=True):
            with storage.every_index(array.shape[len(batch) :]) as index:
                storage.put(memory, index[::-1], array.element(function.builder, [*place, *index]))
        for memory, target_ in zip(compute(routine, copies), targets, strict=True):
            with storage.every_index(target_.shape[len(batch) :]) as index:
                inside: Sequence[Index] = index[::-1] or [0]
                storage.put(target_, [*place, *index], memory.element(function.builder, inside))
    return list(targets)
