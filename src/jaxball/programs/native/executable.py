"""Calls of a compiled program: arrays in, arrays out, and a workspace for each running call."""

import ctypes
import hashlib
import itertools
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ...compat import put
from .ir.module import ALIGNMENT
from .targets.machine import Code

_spare = threading.local()
_targets: dict[str, Code] = {}  # the programs that XLA may call at any time
_lock = threading.Lock()


class Form(NamedTuple):
    """A compiled program as plain data, of which an :class:`Executable` is made, in this process or in another one.

    Nothing here needs the compiler, which a process that finds its programs in a store never imports.

    - ``code``: the machine code from :func:`~.machine.object_code`.
    - ``results``: offset in bytes, shape and type of each result in the array in which all of them lie.
    - ``size``: the bytes of that array; ``workspace``: those of the memory to work in.
    - ``takes``: how many arrays it takes; ``routines``: those of libraries that the code calls.
    - ``refuses``: whether it may stop at a callback of Python.
    - ``block``: how many rows it computes at once; 0 if it computes a single one, without an axis of rows.
    """

    code: bytes
    results: tuple[tuple[int, tuple[int, ...], np.dtype], ...]
    size: int
    workspace: int
    takes: int
    routines: tuple[tuple[str, str], ...]
    refuses: bool
    block: int


class Executable:
    """A program: called with the arrays of its arguments, it returns those of its results.

    It holds Python's lock only while it checks for signals, so that several threads can run it at once, and Ctrl-C
    raises ``KeyboardInterrupt`` from within.
    """

    def __init__(self, form: Form):
        self._form = form
        self._code = Code(form.code, form.routines)
        # Of the kind that looks, after the call, for an exception; the code releases Python's lock itself.
        kind = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
        self._run = kind(self._code.address("run"))
        self._run_rows = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(self._code.address("rows"))
        self._addresses = ctypes.c_void_p * form.takes
        self._results, self._size, self._workspace = form.results, form.size, form.workspace

    def __call__(self, arguments: Sequence[np.ndarray | jax.Array]) -> list[np.ndarray] | None:
        """The results; None if the program reached a callback. The arguments have the compiled types, row by row."""
        addresses = self._addresses(*map(_address, arguments))
        block = np.empty(self._size + ALIGNMENT, np.uint8)
        outputs = _address(block)
        start = -outputs % ALIGNMENT
        workspace = _taken(self._workspace)
        try:
            refused = self._run(addresses, outputs + start, workspace.start)
        finally:
            _given_back(workspace)
        if refused:
            return None
        return [np.ndarray(shape, dtype, block, start + offset) for offset, shape, dtype in self._results]

    def of_rows(
        self, arguments: Sequence[np.ndarray | jax.Array], in_rows: Sequence[bool], threads: int
    ) -> list[np.ndarray]:
        """The results of all rows, computed in ``threads`` threads, which changes none of their bits.

        - ``in_rows``: which arguments have rows as leading axis.
        """
        rows = next(len(array) for array, many in zip(arguments, in_rows, strict=True) if many)
        results = [
            _aligned((rows, *(shape[1:] if self._form.block else shape)), dtype) for _, shape, dtype in self._results
        ]
        blocks = -(-rows // max(self._form.block, 1))
        parts = [
            (_address(array), array.nbytes // rows if many else 0)
            for array, many in zip(arguments, in_rows, strict=True)
        ]
        parts += [(_address(array), array.nbytes // rows) for array in results]
        header = 0, 0, 1, rows, blocks, 0  # as `handler` has them
        shared = (ctypes.c_int64 * (len(header) + 2 * len(parts)))(*header, *itertools.chain(*parts))
        address = ctypes.addressof(shared)
        others = [threading.Thread(target=self._run_rows, args=(address,)) for _ in range(min(threads, blocks) - 1)]
        for thread in others:
            thread.start()
        try:
            self._run_rows(address)
        except BaseException:
            shared[0], shared[5] = blocks, 1
            raise
        finally:
            for thread in others:
                thread.join()
        return results

    def target(self) -> str | None:
        """The name under which XLA finds the program, for as long as the process lives; None if it may refuse to run.

        The name is that of the code, so that what JAX itself keeps of a compiled function calls the same code later.
        """
        if self._form.refuses:
            return None
        described = self._form.code, repr(self._form.routines).encode()
        name = f"jaxball_{hashlib.blake2b(b''.join(described), digest_size=16).hexdigest()}"
        with _lock:
            if name not in _targets:
                handler = ctypes.cast(self._code.address("call"), ctypes.c_void_p)
                jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(handler), platform="cpu")
                _targets[name] = self._code
        return name


def _address(array: np.ndarray | jax.Array) -> int:
    if not isinstance(array, np.ndarray):
        return array.block_until_ready().unsafe_buffer_pointer()
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, BufferError):  # an array that is read-only, or empty
        return array.__array_interface__["data"][0]  # which takes three times as long


def _aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Room for an array that JAX takes without a copy."""
    size = int(np.prod(shape, dtype=int)) * dtype.itemsize
    memory = np.empty(size + ALIGNMENT, np.uint8)
    start = -_address(memory) % ALIGNMENT
    return memory[start : start + size].view(dtype).reshape(shape)


class _Workspace:
    """Memory to work in: its bytes from the aligned address ``start`` on."""

    def __init__(self, size: int):
        self.size = size
        self._memory = np.empty(size + ALIGNMENT, np.uint8)
        self.start = -(-_address(self._memory) // ALIGNMENT) * ALIGNMENT


def _taken(size: int) -> _Workspace:
    """Memory to work in, which the thread keeps: a handler of signals may run another program meanwhile."""
    workspace = getattr(_spare, "workspace", None)
    _spare.workspace = None
    return _Workspace(size) if workspace is None or workspace.size < size else workspace


def _given_back(workspace: _Workspace) -> None:
    _spare.workspace = workspace


class Results:
    """Makes JAX arrays of the given types, copied only if necessary."""

    def __init__(self, avals: Sequence[Any]):
        self._avals = avals
        self._device = jax.local_devices(backend="cpu")[0]
        self._sharding = jax.sharding.SingleDeviceSharding(self._device)

    def __call__(self, arrays: Sequence[np.ndarray]) -> list[Any]:
        sharding, device = self._sharding, self._device
        return [put(array, aval, sharding, device) for array, aval in zip(arrays, self._avals, strict=True)]
