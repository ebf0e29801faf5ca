"""Calls of a compiled program: arrays in, arrays out, and a workspace for each running call."""

import ctypes
import functools
import hashlib
import itertools
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np

from ...interface.compat import array_type, put
from .arguments import is_of_numpy
from .limits import ALIGNMENT
from .targets.machine import Code

_spare = threading.local()
_targets: dict[str, Code] = {}  # the programs that XLA may call at any time
_lock = threading.Lock()


Given: TypeAlias = tuple[tuple[int, ...], np.dtype, bool]  # shape, type, and whether the type is weak, of a result


class Form(NamedTuple):
    """A compiled program as plain data, of which a :class:`Executable` is made, in this process or in another one.

    Nothing here needs the compiler, which a process that finds its programs in a store never imports.

    - ``code``: the machine code from :func:`~.machine.object_code`; ``routines``: those of libraries that it calls.
    - ``takes``: the types of the arrays that it takes; ``gives``: the arrays that it gives.
    - ``offsets``: in bytes, of each result in the array in which all of them lie; ``size``: the bytes of that array.
    - ``workspace``: the bytes of the memory to work in.
    - ``refuses``: whether it may stop at a callback of Python.
    - ``block``: how many rows it computes at once; 0 if it computes a single one, without an axis of rows.
    """

    code: bytes
    routines: tuple[tuple[str, str], ...]
    takes: tuple[np.dtype, ...]
    gives: tuple[Given, ...]
    offsets: tuple[int, ...]
    size: int
    workspace: int
    refuses: bool
    block: int


class CallbackReachedError(Exception):
    """A native run reached a callback in a branch, such as an error to be raised: XLA runs it, from the beginning."""


class Executable:
    """A program for arrays of certain types: called with such arrays, it returns JAX arrays.

    It holds Python's lock only while it checks for signals, so that several threads can run it at once, and Ctrl-C
    raises ``KeyboardInterrupt`` from within.

    **Raises:** :class:`CallbackReachedError`.
    """

    def __init__(self, form: Form):
        self.form = form
        self._code = Code(form.code, form.routines)
        # Of the kind that looks, after the call, for an exception; the code releases Python's lock itself.
        kind = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
        self._run = kind(self._code.address("run"))
        self._run_rows = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(self._code.address("rows"))
        self._addresses = ctypes.c_void_p * len(form.takes)
        self._places = [
            (offset, shape, dtype) for offset, (shape, dtype, _) in zip(form.offsets, form.gives, strict=True)
        ]
        self._size, self._workspace = form.size, form.workspace
        self._as_jax = _AsJax([array_type(*result) for result in form.gives])

    def __call__(self, arrays: Sequence[Any]) -> list[jax.Array]:
        arguments = self._as_taken(arrays)
        addresses = self._addresses(*map(_address, arguments))
        block = np.empty(self._size + ALIGNMENT, np.uint8)
        outputs = _address(block)
        start = -outputs % ALIGNMENT
        workspace = _take_workspace(self._workspace)
        try:
            refused = self._run(addresses, outputs + start, workspace.start)
        finally:
            _give_back(workspace)
        if refused:
            raise CallbackReachedError
        return self._as_jax([np.ndarray(shape, dtype, block, start + place) for place, shape, dtype in self._places])

    def _as_taken(self, arrays: Sequence[Any]) -> list[np.ndarray | jax.Array]:
        """Returns the arrays with the compiled types, computed and row by row in memory."""
        taken = [
            np.asarray(array, dtype, order="C") if is_of_numpy(type(array)) else array
            for array, dtype in zip(arrays, self.form.takes, strict=True)
        ]
        return jax.block_until_ready(taken)  # all at once: one by one they take longer than the rest of a call

    def of_rows(
        self, arrays: Sequence[Any], in_rows: Sequence[bool], weak: Sequence[bool], threads: int
    ) -> list[jax.Array]:
        """Computes the results of all rows in ``threads`` threads, which changes none of their bits.

        Only a program with a :attr:`target` has this. Ctrl-C ends it.

        - ``in_rows``: which arrays have rows as leading axis; ``weak``: which results have a weak type.
        """
        arguments = self._as_taken(arrays)
        rows = next(len(array) for array, many in zip(arguments, in_rows, strict=True) if many)
        results = [
            _empty((rows, *(shape[1:] if self.form.block else shape)), dtype) for _, shape, dtype in self._places
        ]
        blocks = -(-rows // max(self.form.block, 1))
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
            # No block is left to take, and who computes one stops at its next look for signals.
            shared[0], shared[5] = blocks, 1
            raise
        finally:
            # They write into the results and read the table, which must not be freed before.
            for thread in others:
                thread.join()
        avals = [array_type(array.shape, array.dtype, is_weak) for array, is_weak in zip(results, weak, strict=True)]
        return _AsJax(avals)(results)

    @functools.cached_property
    def target(self) -> str | None:
        """The name by which XLA calls the program, while the process lives; None if it may stop at a callback.

        The name is that of the code, so that what JAX itself keeps of a compiled function calls the same code later.
        """
        if self.form.refuses:
            return None
        described = self.form.code, repr(self.form.routines).encode()
        name = f"jaxball_{hashlib.blake2b(b''.join(described), digest_size=16).hexdigest()}"
        with _lock:
            if name not in _targets:
                handler = ctypes.cast(self._code.address("call"), ctypes.c_void_p)
                jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(handler), platform="cpu")
                _targets[name] = self._code
        return name


def _address(array: np.ndarray | jax.Array) -> int:
    if not isinstance(array, np.ndarray):
        return array.unsafe_buffer_pointer()
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, BufferError):  # an array that is read-only, or empty
        return array.__array_interface__["data"][0]  # which takes three times as long


def _empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Makes room for an array that JAX takes without a copy."""
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


def _take_workspace(size: int) -> _Workspace:
    """Returns memory to work in, which the thread keeps: a handler of signals may run another program meanwhile."""
    workspace = getattr(_spare, "workspace", None)
    _spare.workspace = None
    return _Workspace(size) if workspace is None or workspace.size < size else workspace


def _give_back(workspace: _Workspace) -> None:
    _spare.workspace = workspace


class _AsJax:
    """Makes JAX arrays of the given types, copied only if necessary."""

    def __init__(self, avals: Sequence[Any]):
        self._avals = avals
        self._device = jax.local_devices(backend="cpu")[0]
        self._sharding = jax.sharding.SingleDeviceSharding(self._device)

    def __call__(self, arrays: Sequence[np.ndarray]) -> list[Any]:
        sharding, device = self._sharding, self._device
        return [put(array, aval, sharding, device) for array, aval in zip(arrays, self._avals, strict=True)]
